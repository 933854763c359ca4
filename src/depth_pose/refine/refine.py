"""Fit the body to the cloud, starting from the matched exemplars (Sec. 6).

Two methods, one interface: ``articulated`` fits joint angles of the skinned body
(`depth_pose.refine.articulated`); ``cpd`` is the paper's, non-rigid registration of the
exemplar's visible vertices, Laplacian completion of the mesh and joints from control vertices
(`depth_pose.paper.completion`). Some sides contend, and the one whose rendered depth agrees
best wins: the matcher's candidates, and a short beam from the frame before, which is its answer and,
with ``refine.beam``, the best poses that differed from it. Tracking alone loses arms and does not find
them again; but a pose that has converged over many frames agrees better than any new one, however wrong
it is, until that is fitted as well. So each side is fitted by itself. A pose that then is far from what
became of the answer before takes its place once it was better by enough, over as many frames as that takes.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.body.build import build_space
from depth_pose.body.rendered_depth import Comparison, DepthComparer
from depth_pose.core.config import MAX_STAMP_GAP_NS, FittingConfig, MatchConfig, RefineConfig
from depth_pose.core.errors import BankError
from depth_pose.core.rotations import matrix_to_quat
from depth_pose.core.skeleton import JOINT_NODES, Source
from depth_pose.core.types import Candidate, Fitted, PoseMatch, Skeleton
from depth_pose.recover.confidence import fit_confidence, report_joints
from depth_pose.refine.articulated import BodyPose, FittedBody, candidate_pose
from depth_pose.refine.build_learner import BuildLearner
from depth_pose.refine.fitters import FITTERS, FrameFitter
from depth_pose.refine.limbs import LimbSearch
from depth_pose.refine.pose_prior import PosePrior, usual_joints
from depth_pose.refine.proposals import aim_legs, from_proposals
from depth_pose.refine.skeleton_pose import pose_from_skeleton
from depth_pose.refine.unseen_legs import LegsBeyond
from depth_pose.track.memory import PerPerson
from depth_pose.track.person import People, Person
from depth_pose.track.sample_people import sample_people

_ROUGH = 2
"""Candidates, the best after a glance, that are fitted roughly."""

_FIRST_ROUNDS = 4
"""Rounds of the limb search while there is no previous pose to start from."""

_NEARLY = 0.04
"""The side that agrees less well is fitted finely as well if its score is at most this much higher."""

_LEAD = 0.04
"""A fresh pose that differs from the kept one answers once its score was so much lower, summed over frames
in a row. Of 0, 0.02 and 0.04 on people of our own (docs/accuracy.md)."""

_SAME_M = 0.05
"""Poses whose joints are less far apart than this, on average, do not differ; set by hand, not swept."""

_DIFFERS_M = 0.06
"""A pose is carried beside the answer if some joint lies this far from that of each better one, metres."""

_HOPELESS = 0.08
"""A pose whose score is this much higher than the answer's is not carried; set by hand, .08 and .2 alike."""

_AWAY_WEIGHT = 1.0
"""Score, per metre, of joints that lie away from where they are proposed (`from_proposals`).

Of 0, 0.3, 1 and 3 on 15 development clips (37.9, 37.7, 37.1, 38.2 mm), and office and corridor."""

_ODD_WEIGHT = 0.2
"""Score of a pose that is more unusual than poses are, for each standard deviation (`PosePrior.excess`)."""


@dataclass(frozen=True)
class _Compared:
    """A fitted body, how it compares with the input, how far it is from proposals, metres, and how odd."""

    body: FittedBody
    comparison: Comparison
    away: float
    odd: float


@dataclass
class _Kept:
    """What is kept of one person's last frame.

    Attributes
    ----------
    beam : tuple of BodyPose
        The answer, and the next best that differ from it and from one another.
    recovered : BodyPose or None
    turn : int
        Whose turn it is to try other limbs.
    lead : float
        By how much another pose that did not answer was better, summed over the last frames.
    """

    beam: tuple[BodyPose, ...] = ()
    recovered: BodyPose | None = None
    turn: int = 0
    lead: float = 0.0


class Refiner:
    """The third stage: what `refine_node` runs.

    Attributes
    ----------
    builds : BuildLearner
        What is known of everybody's proportions.
    limbs : LimbSearch
        Proposes other arms and legs.
    meshes : dict of str to (V, 3) float64
        The body as it was fitted to each person in the last frame, camera frame, metres.
    """

    def __init__(
        self, bank: Bank, config: RefineConfig, match: MatchConfig, fitting: FittingConfig | None = None
    ) -> None:
        self.bank = bank
        self.config = config
        self._match_config = match
        self._faces = bank.body.faces
        fitting = fitting or FittingConfig()
        self._fitter = FITTERS[config.method](bank.body, fitting)
        self.limbs = LimbSearch(bank)
        usual = usual_joints(bank)
        self._prior, self._beyond = PosePrior(usual), LegsBeyond(usual)
        self._space = build_space(bank.body)
        self.builds = BuildLearner(self._space, fitting.build, fitting.fit)
        self._kept = PerPerson(_Kept, MAX_STAMP_GAP_NS)
        self.reset()

    def reset(self) -> None:
        """Forget all poses."""
        self._kept.reset()
        self.builds.reset()
        self.meshes: dict[str, NDArray[np.float64]] = {}

    def warm_up(self) -> None:
        """Compile every kernel; forgets all poses."""
        people = sample_people(self.bank)
        start = Candidate(0, 0, np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.0, 0.0, 3.2]), 0.0, 0.0)
        matches = [PoseMatch(p.body_id, self.bank.bank_id, 1.0, (start,)) for p in people.persons]
        self.refine(people, matches)
        self.reset()

    def take_answer(self, skeletons: Iterable[Skeleton]) -> None:
        """Learn what became of the frame before, after the failure check.

        A recovered pose is one more start for the next frame; somebody without an answer is not
        tracked on.
        """
        answers = {s.body_id: s for s in skeletons}
        for body_id in self.meshes:
            kept, answer = self._kept.get(body_id), answers.get(body_id)
            if kept is None:
                continue
            if answer is None:
                kept.beam = ()
            elif answer.source == Source.RECOVERED:
                kept.recovered = pose_from_skeleton(self._space.body(answer.build), answer)

    def refine(self, people: People, matches: Iterable[PoseMatch]) -> tuple[Fitted, ...]:
        """Fit the body to everybody who was matched.

        Parameters
        ----------
        people : People
        matches : iterable of PoseMatch
            The matcher's answers to the same people; who has none is left out.

        Returns
        -------
        tuple of Fitted
            Source REFINED, or LOST without a candidate.

        Raises
        ------
        BankError
            Where a match speaks of another bank.
        """
        self._kept.begin(people.stamp_ns)
        self.builds.begin(people.stamp_ns)
        self.meshes = {}
        persons = {p.body_id: p for p in people.persons}
        return tuple(self._refine(persons[m.body_id], m) for m in matches if m.body_id in persons)

    def _refine(self, person: Person, match: PoseMatch) -> Fitted:
        """Fit the body to one person."""
        if match.bank_id != self.bank.bank_id:
            raise BankError(
                f"the match refers to bank {match.bank_id}, but {self.bank.bank_id} is loaded here; "
                "give the matcher and the refiner the same bank file"
            )
        if not match.candidates:
            self._kept.forget(person.body_id)
            return Fitted(Skeleton.lost(person.stamp_ns, person.frame_id, person.body_id), 1.0)
        kept = self._kept[person.body_id]
        personal = self.builds.of(person.body_id, match.scale, self._match_config.scale > 0.0)
        body = self._space.body(personal.build)
        fitter = self._fitter.fit_to(person, body, personal.build)
        best = self._fit_best(person, replace(match, scale=personal.scale), kept, fitter)
        seen = best.body
        best = replace(best, body=self._beyond.settle(body, best.body, person.camera))
        self.meshes[person.body_id] = best.body.vertices
        fitted = Fitted(self._skeleton(person, best, personal.build), best.comparison.score)
        self.builds.learn(personal, fitter.seen(), seen, fitted.score, person.stamp_ns)
        return fitted

    def _fit_best(self, person: Person, match: PoseMatch, kept: _Kept, fitter: FrameFitter) -> _Compared:
        """Fit fresh and kept starts roughly, try other limbs on one of both sides, finish, and choose."""
        comparer = DepthComparer(person.coarse, self._match_config.score_band)

        def ranked(bodies: Iterable[FittedBody]) -> list[_Compared]:
            compared = (
                _Compared(
                    b,
                    comparer.compare(b.vertices, self._faces),
                    from_proposals(b.nodes, person.found),
                    self._prior.excess(b.nodes, b.pose.scale),
                )
                for b in bodies
            )
            return sorted(compared, key=_score)

        def search_limbs(found: _Compared, rounds: int) -> _Compared:
            for _ in range(rounds):
                proposals = self.limbs.propose(found.body, comparer)
                aimed = aim_legs(self.bank.body, found.body.pose, person.found)
                proposals += [] if aimed is None else [aimed]
                if not proposals:
                    break
                glanced = ranked(fitter.glance(start) for start in proposals)[0]
                exchanged = ranked([fitter.rough(glanced.body.pose)])[0]
                if _score(exchanged) >= _score(found):
                    break
                found = exchanged
            return found

        fresh = [candidate_pose(self.bank, c, match.scale) for c in match.candidates]
        glances = ranked(fitter.glance(start) for start in fresh)
        sides = [ranked(fitter.rough(g.body.pose) for g in glances[:_ROUGH])[0]]
        starts = self._kept_starts(kept, match.scale)
        sides += [ranked(fitter.rough(start) for start in of_side)[0] for of_side in starts]
        kept.turn = (kept.turn + 1) % min(2, len(sides))
        sides[kept.turn] = search_limbs(sides[kept.turn], 1 if len(sides) > 1 else _FIRST_ROUNDS)
        sides[2:] = [search_limbs(side, 1) for side in sides[2:]]
        enough = min(map(_score, sides)) + _NEARLY
        finished = [ranked([fitter.finish(s.body)])[0] if _score(s) <= enough else None for s in sides]
        best = _settle(kept, *finished)
        kept.beam = _widen(best, [f or s for f, s in zip(finished, sides, strict=True)], self.config.beam)
        return best

    def _kept_starts(self, kept: _Kept, scale: float) -> list[list[BodyPose]]:
        """Give what is kept of the frame before, by side: the answer and the recovered, then the rest."""
        beam = kept.beam if self.config.track else ()
        recovered = () if kept.recovered is None else (kept.recovered,)
        kept.recovered = None
        sides = [(*beam[:1], *recovered), *((pose,) for pose in beam[1:])]
        return [[BodyPose(p.rotations, p.root, scale) for p in poses] for poses in sides if poses]

    def _skeleton(self, person: Person, fitted: _Compared, build: NDArray[np.float32]) -> Skeleton:
        """Put a fitted pose into words."""
        confidence = fit_confidence(fitted.comparison.score)
        positions = fitted.body.nodes[JOINT_NODES]
        report = report_joints(positions, fitted.body.pose.scale, person, fitted.comparison.score)
        return Skeleton(
            stamp_ns=person.stamp_ns,
            frame_id=person.frame_id,
            body_id=person.body_id,
            source=Source.REFINED,
            confidence=float(np.float32(confidence)),
            residual=float(np.float32(fitted.comparison.gap)),
            scale=float(np.float32(fitted.body.pose.scale)),
            positions=positions,
            quats_xyzw=matrix_to_quat(fitted.body.pose.rotations[JOINT_NODES]),
            joint_confidence=report.confidence.astype(np.float32),
            joint_states=report.states,
            build=build,
        )


def _settle(
    kept: _Kept, fresh: _Compared | None, old: _Compared | None = None, *others: _Compared | None
) -> _Compared:
    """Give the best of what became of fresh and kept starts; a pose far from the one before has to last.

    Of two poses far apart that agree almost as well the kept one is right more often: a single frame's score
    says less than that other frames led there.
    """
    before, kept.lead = kept.lead, 0.0
    rival = min((pose for pose in (fresh, *others) if pose is not None), key=_score, default=None)
    if rival is None or old is None:
        best = rival or old
        assert best is not None, "the best side is always finished"
        return best
    better = _score(old) - _score(rival)
    if better <= 0.0 or _gaps(rival, old).mean() < _SAME_M:
        return rival if better > 0.0 else old
    if before + better > _LEAD:
        return rival
    kept.lead = before + better
    return old


def _widen(best: _Compared, sides: list[_Compared], most: int) -> tuple[BodyPose, ...]:
    """Give at most so many poses: the answer, and the best that differ from it and from one another."""
    beam = [best]
    for side in sorted(sides, key=_score):
        if len(beam) >= most or _score(side) > _score(best) + _HOPELESS:
            break
        if all(_gaps(side, other).max() > _DIFFERS_M for other in beam):
            beam.append(side)
    return tuple(pose.body.pose for pose in beam)


def _gaps(one: _Compared, other: _Compared) -> NDArray[np.float64]:
    """Distances of two poses' joints (J,), metres."""
    return np.asarray(np.linalg.norm(one.body.nodes[JOINT_NODES] - other.body.nodes[JOINT_NODES], axis=1))


def _score(fitted: _Compared) -> float:
    """Disagreement of rendered depth, with the proposals, and with how people hold themselves."""
    return fitted.comparison.score + _AWAY_WEIGHT * fitted.away + _ODD_WEIGHT * fitted.odd
