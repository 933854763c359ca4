"""Fit the body to the cloud, starting from the matched exemplars (Sec. 6).

Two methods, one interface: ``articulated`` fits joint angles of the skinned body
(`depth_pose.fit.articulated`); ``cpd`` is the paper's, non-rigid registration of the
exemplar's visible vertices, Laplacian completion of the mesh and joints from control vertices
(`depth_pose.fit.completion`). Two poses contend, and the one whose rendered depth agrees
best wins: the matcher's candidates, and the pose of the frame before. Tracking alone loses arms and
does not find them again; but a pose that has converged over many frames agrees better than any new
one, however wrong it is, until that is fitted as well. So each side is fitted by itself.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.core.config import FittingConfig, MatchConfig, RefineConfig
from depth_pose.core.errors import BankError
from depth_pose.core.rotations import matrix_to_quat
from depth_pose.core.skeleton import JOINT_NODES, Source
from depth_pose.core.stamps import StampGuard
from depth_pose.core.types import Candidate, PersonCloud, PoseMatch, Skeleton
from depth_pose.fit.articulated import BodyPose, FittedBody, candidate_pose
from depth_pose.fit.limbs import LimbSearch
from depth_pose.fit.rendered_depth import Comparison, DepthComparer
from depth_pose.fit.skeleton_pose import pose_from_skeleton
from depth_pose.people.identity import PersonGuard
from depth_pose.people.person import PersonView, view_person
from depth_pose.steps.confidence import report_joints, skeleton_confidence
from depth_pose.steps.fitters import FITTERS
from depth_pose.steps.warm_up import sample_cloud

_ROUGH = 2
"""Candidates, the best after a glance, that are fitted roughly."""

_FIRST_ROUNDS = 4
"""Rounds of the limb search while there is no previous pose to start from."""

_NEARLY = 0.04
"""The side that agrees less well is fitted finely as well if its score is at most this much higher."""


@dataclass(frozen=True)
class _Compared:
    """A fitted body, and how it compares with the input."""

    body: FittedBody
    comparison: Comparison


class Refiner:
    """The third stage: what `refine_node` runs."""

    def __init__(
        self, bank: Bank, config: RefineConfig, match: MatchConfig, fitting: FittingConfig | None = None
    ) -> None:
        self.bank = bank
        self.config = config
        self._band = match.score_band
        self._faces = bank.body.faces
        self._fitter = FITTERS[config.method](bank.body, fitting or FittingConfig())
        self._limbs = LimbSearch(bank)
        self._guard = StampGuard()
        self._identity = PersonGuard()
        self.reset()

    def reset(self) -> None:
        """Forget the previous pose."""
        self._previous: BodyPose | None = None
        self._recovered: BodyPose | None = None
        self._turn = 0
        self.mesh: NDArray[np.float64] | None = None

    def warm_up(self) -> None:
        """Compile every kernel."""
        start = Candidate(0, 0, np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.0, 0.0, 3.2]), 0.0, 0.0)
        self.refine(sample_cloud(self.bank), PoseMatch(0, "", self.bank.bank_id, 1.0, (start,)))
        self.reset()
        self._guard, self._identity = StampGuard(), PersonGuard()

    def take_answer(self, skeleton: Skeleton) -> None:
        """Learn what became of the frame before, after the failure check.

        A recovered pose is one more start for the next frame; a lost one ends the tracking.
        """
        if skeleton.source == Source.RECOVERED:
            self._recovered = pose_from_skeleton(self.bank.body, skeleton)
        elif skeleton.is_lost:
            self._previous = None

    def refine(self, cloud: PersonCloud, match: PoseMatch) -> Skeleton:
        """Fit the body to one frame.

        Parameters
        ----------
        cloud : PersonCloud
        match : PoseMatch
            The matcher's answer to the same cloud.

        Returns
        -------
        Skeleton
            Source REFINED, or LOST where there is nobody or no candidate.

        Raises
        ------
        BankError
            Where the match speaks of another bank.
        """
        if self._guard.is_break(cloud.stamp_ns):
            self.reset()
        if match.bank_id != self.bank.bank_id:
            raise BankError(
                f"the match refers to bank {match.bank_id}, but {self.bank.bank_id} is loaded here; "
                "give the matcher and the refiner the same bank file"
            )
        view = view_person(cloud)
        if view is None or not match.candidates:
            self.reset()
            return Skeleton.lost(cloud.stamp_ns, cloud.frame_id)
        if self._identity.is_other(view, cloud.stamp_ns):
            self.reset()
        self._identity.note(view, cloud.stamp_ns)
        best = self._fit_best(view, match)
        self._previous, self.mesh = best.body.pose, best.body.vertices
        return self._skeleton(cloud, view, best)

    def _fit_best(self, view: PersonView, match: PoseMatch) -> _Compared:
        """Fit fresh and kept starts roughly, try other limbs on one of both sides, finish, and choose."""
        comparer = DepthComparer(view.coarse, self._band)
        fitter = self._fitter.fit_to(view)

        def ranked(bodies: Iterable[FittedBody]) -> list[_Compared]:
            compared = (_Compared(b, comparer.compare(b.vertices, self._faces)) for b in bodies)
            return sorted(compared, key=_score)

        def search_limbs(found: _Compared, rounds: int) -> _Compared:
            for _ in range(rounds):
                proposals = self._limbs.propose(found.body.pose, found.body.vertices, comparer)
                if not proposals:
                    break
                glanced = ranked(fitter.glance(start) for start in proposals)[0]
                exchanged = ranked([fitter.rough(glanced.body.pose)])[0]
                if exchanged.comparison.score >= found.comparison.score:
                    break
                found = exchanged
            return found

        fresh = (candidate_pose(self.bank, c, match.scale) for c in match.candidates)
        glances = ranked(fitter.glance(start) for start in fresh)
        sides = [ranked(fitter.rough(g.body.pose) for g in glances[:_ROUGH])[0]]
        if kept := self._kept(match.scale):
            sides.append(ranked(fitter.rough(start) for start in kept)[0])
            self._turn = (self._turn + 1) % 2
            sides[self._turn] = search_limbs(sides[self._turn], 1)
        else:
            sides[0] = search_limbs(sides[0], _FIRST_ROUNDS)
        enough = min(map(_score, sides)) + _NEARLY
        return ranked(fitter.finish(s.body) for s in sides if _score(s) <= enough)[0]

    def _kept(self, scale: float) -> list[BodyPose]:
        """Give what is kept of the frame before: its pose, and the recovered one."""
        kept = [self._previous if self.config.track else None, self._recovered]
        self._recovered = None
        return [BodyPose(pose.rotations, pose.root, scale) for pose in kept if pose is not None]

    def _skeleton(self, cloud: PersonCloud, view: PersonView, fitted: _Compared) -> Skeleton:
        """Put a fitted pose into words."""
        confidence = skeleton_confidence(fitted.comparison.score)
        positions = fitted.body.nodes[JOINT_NODES]
        report = report_joints(positions, fitted.body.pose.scale, view, fitted.comparison.score)
        return Skeleton(
            stamp_ns=cloud.stamp_ns,
            frame_id=cloud.frame_id,
            body_id="",
            source=Source.REFINED,
            confidence=float(np.float32(confidence)),
            residual=float(np.float32(fitted.comparison.gap)),
            scale=float(np.float32(fitted.body.pose.scale)),
            positions=positions,
            quats_xyzw=matrix_to_quat(fitted.body.pose.rotations[JOINT_NODES]),
            joint_confidence=report.confidence.astype(np.float32),
            joint_states=report.states,
        )


def _score(fitted: _Compared) -> float:
    return fitted.comparison.score
