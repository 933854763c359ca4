"""Fit the body to the cloud, starting from the matched exemplars (Sec. 6).

There are two methods with one interface. ``articulated`` fits joint angles of the skinned body
(`depth_pose.refine.articulated`). ``cpd`` is the paper's: non-rigid registration of the exemplar's visible
vertices, Laplacian completion of the mesh, and joints from control vertices (`depth_pose.paper.completion`).
Two groups of starts compete, and the one with the best rendered-depth agreement wins: the matcher's
candidates, and a short beam from the previous frame, which is its answer and, with ``refine.beam``, the best
poses that differed from it. Tracking alone loses arms and does not recover them. A pose that has converged
over many frames, however, agrees better than any unfitted one even if it is wrong. Each group is therefore
fitted separately. A pose that differs much from the continued answer replaces it after it agreed better,
summed over consecutive frames, by a given margin.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.body.pose import BodyPose, Fitted, FittedBody
from depth_pose.body.rendered_depth import Comparison
from depth_pose.core.config import MatchConfig, RefineConfig
from depth_pose.core.errors import BankError
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL
from depth_pose.core.skeleton import JOINT_NODES, Source
from depth_pose.core.types import Candidate, PoseMatch
from depth_pose.refine.body_fitter import BodyFitter, FrameFit, PersonFitter
from depth_pose.refine.build_learner import BuildLearner
from depth_pose.refine.limbs import LimbSearch
from depth_pose.refine.pose_prior import PosePrior, usual_joints
from depth_pose.refine.proposals import aim_legs, from_proposals
from depth_pose.refine.unseen_legs import UnseenLegs
from depth_pose.track.memory import Subject, Subjects
from depth_pose.track.person import People, Person
from depth_pose.track.sample_people import SAMPLE_DISTANCE_M, sample_people

_ROUGH = 2
"""Number of candidates, the best after a glance, that are fitted roughly."""

_FIRST_ROUNDS = 4
"""Rounds of limb search while there is no previous pose to start from."""

_NEARLY = 0.04
"""The worse group is also fitted finely if its score is at most this much higher."""

_LEAD = 0.04
"""Score advantage, summed over consecutive frames, after which a different fresh pose becomes the answer."""

_SAME_M = 0.05
"""Poses with a mean joint distance below this (m) are the same; set by hand."""

_DIFFERS_M = 0.06
"""A pose joins the beam if some joint is this far (m) from that of each better pose."""

_HOPELESS = 0.08
"""Score above the answer's at which a pose leaves the beam; set by hand."""

_AWAY_WEIGHT = 2.0
"""Weight of the mean distance (1/m) of joints from their proposals (`from_proposals`) in the score."""

_ODD_WEIGHT = 0.2
"""Weight in the score of each standard deviation above the usual (`PosePrior.excess`)."""


@dataclass(frozen=True)
class _Compared:
    """A fitted body, its disagreement, distance (m) from proposals, and excess of the pose prior."""

    body: FittedBody
    comparison: Comparison
    away: float
    odd: float

    @property
    def score(self) -> float:
        """Return the sum of rendered-depth disagreement, distance from proposals and pose prior."""
        return self.comparison.score + _AWAY_WEIGHT * self.away + _ODD_WEIGHT * self.odd


@dataclass
class KeptPoses:
    """Start of a person's next fit.

    Attributes
    ----------
    beam : tuple of BodyPose
        The answer, and the next best poses that differ from it and from one another.
    turn : int
        The group searched for limbs in this frame.
    lead : float
        Score advantage of a different pose that was not the answer, summed over the last frames.
    """

    beam: tuple[BodyPose, ...] = ()
    turn: int = 0
    lead: float = 0.0


class Refiner:
    """The third stage of the pipeline, run by `refine_node`.

    Parameters
    ----------
    bank : Bank
    config : RefineConfig
    match : MatchConfig
    bodies : BodyFitter
    fitter : PersonFitter, optional
        The method; the articulated fit of ``bodies`` if not given.
    subjects : Subjects, optional
        State of all tracks, shared with the other stages of a process.

    Attributes
    ----------
    builds : BuildLearner
        Learned builds of all tracks.
    limbs : LimbSearch
        Proposes other arms and legs.
    """

    def __init__(
        self,
        bank: Bank,
        config: RefineConfig,
        match: MatchConfig,
        bodies: BodyFitter,
        fitter: PersonFitter | None = None,
        subjects: Subjects | None = None,
    ) -> None:
        self.bank = bank
        self.config = config
        self._match_config = match
        self._bodies = bodies
        self._fitter = fitter or bodies
        self._subjects = subjects or Subjects()
        self.limbs = LimbSearch(bank)
        usual = usual_joints(bank)
        self._prior, self._unseen_legs = PosePrior(usual), UnseenLegs(usual)
        self.builds = BuildLearner(bodies.space, bodies.config.build, bodies.config.fit)

    def reset(self) -> None:
        """Forget all tracks."""
        self._subjects.reset()
        self.builds.reset()

    def warm_up(self) -> None:
        """Compile every kernel; forgets all tracks."""
        people = sample_people(self.bank)
        place = np.array([0.0, 0.0, SAMPLE_DISTANCE_M])
        start = Candidate(
            0, 0, R_CAMERA_FACING_MODEL, place, 0.0, 0.0
        )  # fits so well that its build is learned
        matches = [PoseMatch(p.body_id, self.bank.bank_id, 1.0, (start,)) for p in people.persons]
        for fitted in self.refine(people, matches):
            if fitted.body is not None:  # as if the image ended above the legs
                waist = people.camera._replace(height=5 * people.camera.height // 8)
                self._unseen_legs.settle(self.bank.body, fitted.body, waist)
        self.reset()

    def refine(self, people: People, matches: Iterable[PoseMatch]) -> tuple[Fitted, ...]:
        """Fit the body to every matched person.

        Parameters
        ----------
        people : People
        matches : iterable of PoseMatch
            The matcher's answers for the same people; people without one are skipped.

        Returns
        -------
        tuple of Fitted
            Source REFINED, or LOST without a candidate.

        Raises
        ------
        BankError
            If a match refers to another bank.
        """
        self._subjects.begin(people)
        persons = {p.body_id: p for p in people.persons}
        return tuple(
            self._refine(persons[m.body_id], m, self._subjects[m.body_id])
            for m in matches
            if m.body_id in persons
        )

    def _refine(self, person: Person, match: PoseMatch, subject: Subject) -> Fitted:
        """Fit the body to one person."""
        if match.bank_id != self.bank.bank_id:
            raise BankError(
                f"the match refers to bank {match.bank_id}, but {self.bank.bank_id} is loaded here; "
                "give the nodes one bank file, and start all of them again where it was replaced"
            )
        if not match.candidates:
            subject.kept = None
            return Fitted.lost(person.stamp_ns, person.body_id)
        subject.kept = subject.kept or KeptPoses()
        personal = self.builds.of(subject, match.scale, self._match_config.scale > 0.0)
        build, fit = personal.build, self._fitter.fit_to(person, personal.build)
        best = self._fit_best(person, replace(match, scale=personal.scale), subject.kept, fit)
        whole = self._unseen_legs.settle(self._bodies.space.body(build), best.body, person.camera)
        score = best.comparison.score
        self.builds.learn(personal, self._bodies.target(person), best.body, score, person.stamp_ns)
        return Fitted(
            person.body_id, person.stamp_ns, Source.REFINED, whole, build, score, best.comparison.gap
        )

    def _fit_best(self, person: Person, match: PoseMatch, kept: KeptPoses, fit: FrameFit) -> _Compared:
        """Fit fresh and kept starts roughly, search limbs in one or both groups, finish, and choose."""
        fresh = self._fit_candidates(person, match, fit)
        sides = [fresh, *self._fit_kept(person, kept, match.scale, fit)]
        kept.turn = (kept.turn + 1) % min(2, len(sides))
        for number, side in enumerate(sides):
            if number == kept.turn or number >= 2:
                rounds = _FIRST_ROUNDS if len(sides) == 1 else 1
                sides[number] = self._search_limbs(person, side, rounds, fit)
        enough = min(side.score for side in sides) + _NEARLY
        finished = [
            self._compare(person, fit.finish(side.body)) if side.score <= enough else None for side in sides
        ]
        best = _settle(kept, *finished)
        answers = [done or rough for done, rough in zip(finished, sides, strict=True)]
        kept.beam = _widen(best, answers, self.config.beam)
        return best

    def _fit_candidates(self, person: Person, match: PoseMatch, fit: FrameFit) -> _Compared:
        """Return the best rough fit among the best candidates of a glance."""
        starts = [self.bank.pose(candidate, match.scale) for candidate in match.candidates]
        glances = sorted((self._compare(person, fit.glance(s)) for s in starts), key=_by_score)
        return self._best_rough(person, [g.body.pose for g in glances[:_ROUGH]], fit)

    def _fit_kept(self, person: Person, kept: KeptPoses, scale: float, fit: FrameFit) -> list[_Compared]:
        """Return the rough fits of the poses kept from the previous frame, the answer first."""
        beam = kept.beam if self.config.track else ()
        return [self._best_rough(person, [BodyPose(pose.rotations, pose.root, scale)], fit) for pose in beam]

    def _search_limbs(self, person: Person, side: _Compared, rounds: int, fit: FrameFit) -> _Compared:
        """Replace arms and legs as long as the fit improves."""
        for _ in range(rounds):
            starts = self.limbs.propose(side.body, person.comparer)
            aimed = aim_legs(self.bank.body, side.body.pose, person.found)
            starts += [] if aimed is None else [aimed]
            if not starts:
                break
            glanced = min((self._compare(person, fit.glance(s)) for s in starts), key=_by_score)
            exchanged = self._best_rough(person, [glanced.body.pose], fit)
            if exchanged.score >= side.score:
                break
            side = exchanged
        return side

    def _best_rough(self, person: Person, starts: Iterable[BodyPose], fit: FrameFit) -> _Compared:
        return min((self._compare(person, fit.rough(start)) for start in starts), key=_by_score)

    def _compare(self, person: Person, body: FittedBody) -> _Compared:
        """Compare a fitted body with the depth, the proposed joints and the pose prior."""
        return _Compared(
            body,
            person.comparer.compare(body.vertices, self.bank.body.faces, self._match_config.score_band),
            from_proposals(body.nodes, person.found),
            self._prior.excess(body.nodes, body.pose.scale),
        )


def _settle(
    kept: KeptPoses, fresh: _Compared | None, old: _Compared | None = None, *others: _Compared | None
) -> _Compared:
    """Choose between fits from fresh and kept starts; a pose far from the previous one has to persist.

    Of two distant poses with similar agreement the kept one is right more often: it is supported by many
    frames, the fresh one by a single score.
    """
    before, kept.lead = kept.lead, 0.0
    rival = min((pose for pose in (fresh, *others) if pose is not None), key=_by_score, default=None)
    if rival is None or old is None:
        best = rival or old
        assert best is not None, "the best side is always finished"
        return best
    better = old.score - rival.score
    if better <= 0.0 or _gaps(rival, old).mean() < _SAME_M:
        return rival if better > 0.0 else old
    if before + better > _LEAD:
        return rival
    kept.lead = before + better
    return old


def _widen(best: _Compared, sides: list[_Compared], most: int) -> tuple[BodyPose, ...]:
    """Return at most ``most`` poses: the answer, and the best that differ from it and from one another."""
    beam = [best]
    for side in sorted(sides, key=_by_score):
        if len(beam) >= most or side.score > best.score + _HOPELESS:
            break
        if all(_gaps(side, other).max() > _DIFFERS_M for other in beam):
            beam.append(side)
    return tuple(pose.body.pose for pose in beam)


def _gaps(one: _Compared, other: _Compared) -> NDArray[np.float64]:
    """Compute the distances (J,) between the joints of two poses, metres."""
    return np.asarray(np.linalg.norm(one.body.nodes[JOINT_NODES] - other.body.nodes[JOINT_NODES], axis=1))


def _by_score(fitted: _Compared) -> float:
    return fitted.score
