"""Fit the body to the cloud, starting from the matched exemplars (Sec. 6).

There are two methods with one interface. ``articulated`` fits joint angles of the skinned body
(`depth_pose.refine.articulated`). ``cpd`` is the paper's: non-rigid registration of the exemplar's visible
vertices, Laplacian completion of the mesh, and joints from control vertices (`depth_pose.paper.completion`).
Two groups of starts compete, and the one with the best rendered-depth agreement wins: the matcher's
candidates, and a short beam from the previous frame, which is its answer and, with ``refine.beam``, the best
poses that differed from it. Tracking alone loses arms and does not recover them. A pose that has converged
over many frames, however, agrees better than any unfitted one even if it is wrong. Each group is therefore
fitted separately. A pose that differs much from the continued answer replaces it after it agreed better,
summed over consecutive frames, by a given margin. Exemplars that lost to it are not fitted again before the
next search, unless the answer is doubtful.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from depth_pose.bank.bank import Bank
from depth_pose.body.pose import BodyPose, Fitted, FittedBody
from depth_pose.core.config import MatchConfig, RefineConfig
from depth_pose.core.errors import BankError
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL
from depth_pose.core.skeleton import Source
from depth_pose.core.types import Candidate, PoseMatch
from depth_pose.refine.body_fitter import BodyFitter, FrameFit, PersonFitter
from depth_pose.refine.build_learner import BuildLearner
from depth_pose.refine.kept_poses import (
    KeptPoses,
    ScoredFit,
    by_score,
    choose_answer,
    joint_gaps,
    keep_differing,
)
from depth_pose.refine.limbs import LimbSearch
from depth_pose.refine.pose_prior import PosePrior, usual_joints
from depth_pose.refine.proposals import aim_at_proposals, from_proposals
from depth_pose.refine.unseen_legs import UnseenLegs
from depth_pose.track.memory import Subject, Subjects
from depth_pose.track.person_view import FramePeople, PersonView
from depth_pose.track.sample_people import SAMPLE_DISTANCE_M, sample_people

_FIRST_ROUNDS = 4
"""Rounds of limb search while there is no previous pose to start from."""

_LIMBS_EVERY = 4
"""Frames from one limb search to the next for a person with a previous pose; the groups take turns."""

_DOUBTFUL = 0.5
"""Mean distance of a pose from its proposals (standard deviations) above which limbs are searched in every
frame; chosen on development clips of .65, .55, .5 and .42."""

_NEARLY = 0.04
"""The worse group is also fitted finely if its score is at most this much higher."""

_SAME_M = 0.03
"""But not if no joint is farther than this (m) from the better one's."""


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

    def refine(self, people: FramePeople, matches: Iterable[PoseMatch]) -> tuple[Fitted, ...]:
        """Fit the body to every matched person.

        Parameters
        ----------
        people : FramePeople
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

    def _refine(self, person: PersonView, match: PoseMatch, subject: Subject) -> Fitted:
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

    def _fit_best(self, person: PersonView, match: PoseMatch, kept: KeptPoses, fit: FrameFit) -> ScoredFit:
        """Fit fresh and kept starts roughly, search limbs in one group, finish, and choose."""
        old = self._fit_kept(person, kept, match.scale, fit)
        fresh = [] if _settles(kept, old, match) else [self._fit_candidates(person, match, fit)]
        sides = fresh + old
        kept.turn += 1
        if not old:
            sides = [self._search_limbs(person, side, _FIRST_ROUNDS, fit) for side in fresh]
        elif kept.turn % _LIMBS_EVERY == 0 or min(side.away for side in sides) > _DOUBTFUL:
            number = kept.turn // _LIMBS_EVERY % len(sides)
            sides[number] = self._search_limbs(person, sides[number], 1, fit)
        first = min(sides, key=by_score)
        finished = [self._finish(person, side, fit) if _is_worth_it(side, first) else None for side in sides]
        best = choose_answer(kept, *finished) if fresh else choose_answer(kept, None, *finished)
        answers = [done or rough for done, rough in zip(finished, sides, strict=True)]
        kept.beam = keep_differing(best, answers, self.config.beam)
        return best

    def _fit_candidates(self, person: PersonView, match: PoseMatch, fit: FrameFit) -> ScoredFit:
        """Return the rough fit of the best candidate after a glance."""
        starts = [self.bank.pose(candidate, match.scale) for candidate in match.candidates]
        return self._fit_one(person, starts, fit)

    def _fit_kept(self, person: PersonView, kept: KeptPoses, scale: float, fit: FrameFit) -> list[ScoredFit]:
        """Return the rough fits of the poses kept from the previous frame, the answer first."""
        beam = kept.beam if self.config.track else ()
        starts = [BodyPose(pose.rotations, pose.root, scale) for pose in beam]
        return [self._compare(person, fit.rough(start)) for start in starts]

    def _search_limbs(self, person: PersonView, side: ScoredFit, rounds: int, fit: FrameFit) -> ScoredFit:
        """Replace arms and legs as long as the fit improves."""
        for _ in range(rounds):
            starts = self.limbs.propose(side.body, person.comparer)
            starts += aim_at_proposals(self.bank.body, side.body.pose, person.measured)
            if not starts:
                break
            exchanged = self._fit_one(person, starts, fit)
            if exchanged.score >= side.score:
                break
            side = exchanged
        return side

    def _fit_one(self, person: PersonView, starts: Iterable[BodyPose], fit: FrameFit) -> ScoredFit:
        """Return the rough fit of the start that is best after a glance."""
        best = min((self._compare(person, fit.glance(start)) for start in starts), key=by_score)
        return self._compare(person, fit.rough(best.body.pose))

    def _finish(self, person: PersonView, side: ScoredFit, fit: FrameFit) -> ScoredFit:
        """Fit finely; return the rough fit where it agrees better, as where the fine one lost an arm."""
        return min(self._compare(person, fit.finish(side.body)), side, key=by_score)

    def _compare(self, person: PersonView, body: FittedBody) -> ScoredFit:
        """Compare a fitted body with the depth, the proposed joints and the pose prior.

        The prior is for what proposals leave open: near them, an unusual pose costs less.
        """
        away = from_proposals(body.nodes, person.measured)
        open_share = min(1.0, away) if person.measured is not None else 1.0
        return ScoredFit(
            body,
            person.comparer.compare(body.vertices, self.bank.body.faces, self._match_config.score_band),
            away,
            open_share * self._prior.excess(body.nodes, body.pose.scale),
        )


def _settles(kept: KeptPoses, old: list[ScoredFit], match: PoseMatch) -> bool:
    """Check that the same exemplars lost to the kept pose already, and that this is not doubtful."""
    tried, kept.tried = kept.tried, tuple(c.exemplar for c in match.candidates)
    return bool(old) and kept.tried == tried and kept.lead == 0.0 and old[0].away <= _DOUBTFUL


def _is_worth_it(side: ScoredFit, first: ScoredFit) -> bool:
    """Check whether a rough fit is worth a fine one, given the best one."""
    if side is first:
        return True
    return side.score <= first.score + _NEARLY and bool(joint_gaps(side, first).max() > _SAME_M)
