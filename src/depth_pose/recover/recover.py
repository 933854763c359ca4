"""Failure check, recovery by temporal registration, and the filter on the output (Sec. 6).

A failure is a named reason why a fit is refused (`depth_pose.recover.failure`). Then the last body is
registered to the new points, as in the paper: by the fit, or with the method ``cpd`` by registering the
clouds (`depth_pose.recover.temporal`), followed by the fit, which removes the drift of repeated registration.
The fit that was refused and the registered body are compared by the common score
(`depth_pose.refine.objective`). A pose that is implausible in itself is kept only if it agrees much better; a
pose that merely changed suddenly is kept if it agrees as well. A good detection therefore wins at once, and a
recovered pose is only a substitute. After `max_time` without a good pose the person counts as lost. The
published `Skeleton` is built here.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.body.build import BUILD_NAMES
from depth_pose.body.pose import BodyPose, Fitted
from depth_pose.core.config import RecoverConfig, SmoothConfig
from depth_pose.core.result import Skeleton
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL
from depth_pose.core.skeleton import Source
from depth_pose.recover.failure import KINDS, Failure, FailureCheck, Verdict, judge, limit_excess
from depth_pose.recover.published import is_published, renew_distance
from depth_pose.recover.report import to_skeleton
from depth_pose.recover.smooth import low_pass, with_motion
from depth_pose.recover.tuning import RecoverTuning
from depth_pose.refine.body_fitter import BodyFitter
from depth_pose.refine.objective import Objective
from depth_pose.refine.solver import Hypothesis, ScoredFit, solve
from depth_pose.track.person_odds import PersonOdds
from depth_pose.track.person_view import FramePeople, PersonView
from depth_pose.track.sample_people import sample_people
from depth_pose.track.state import Answer, Evidence, PersonState, PersonStates

_PART, _ALLOWANCE_OF_PART = 0.7, 0.08
"""Share of the last good frame's points below which a part of the person is missing, and the score excess
that is then allowed for the registered body."""

_SAME_SCORE = 1e-5
"""Score advantage below which the registered body is the fit that failed, up to rounding."""


class CloudRegistration(Protocol):
    """Moves a body from one frame to the next by the clouds alone (`depth_pose.recover.temporal`)."""

    def carry(self, before: PersonView, now: PersonView, last: Fitted) -> BodyPose:
        """Return the pose of the last body in the new frame."""


class FailureRecovery:
    """The fourth stage of the pipeline, run by `recovery_node`.

    Parameters
    ----------
    bank : Bank
    recover : RecoverConfig
    smooth : SmoothConfig
    bodies : BodyFitter
    objective : Objective
        Shared with the other stages of a process.
    states : PersonStates, optional
        States of all tracks, shared with the other stages of a process.
    clouds : CloudRegistration, optional
        Registers clouds; with the method ``cpd``.
    tuning : RecoverTuning

    Attributes
    ----------
    last_reasons : dict of str to str
        Failures of the last frame, by body id.
    failures : Counter
        Number of failures by kind (`depth_pose.recover.failure.KINDS`), since the start.
    recoveries : int
        Number of recovered skeletons, since the start.
    doubtful : int
        Number of detections that no body fits, since the start; improbable ones are not published.
    """

    def __init__(
        self,
        bank: Bank,
        recover: RecoverConfig,
        smooth: SmoothConfig,
        bodies: BodyFitter,
        objective: Objective,
        states: PersonStates | None = None,
        clouds: CloudRegistration | None = None,
        tuning: RecoverTuning = RecoverTuning(),
    ) -> None:
        self.bank = bank
        self.config, self.tuning = recover, tuning
        self._smooth = smooth
        self._bodies = bodies
        self._objective = objective
        self._states = states or PersonStates()
        self._clouds = clouds
        self._check = FailureCheck(bank.body, recover.min_confidence, tuning)
        self._odds = PersonOdds.load()
        self.failures: Counter[str] = Counter(dict.fromkeys(KINDS, 0))
        self.recoveries = 0
        self.doubtful = 0
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._states.reset()
        self.last_reasons: dict[str, str] = {}

    def warm_up(self) -> None:
        """Compile every kernel."""
        (person,) = sample_people(self.bank).persons
        start = BodyPose(R_CAMERA_FACING_MODEL @ self.bank.rotations(0), person.points.mean(axis=0), 1.0)
        average = np.zeros(len(BUILD_NAMES), np.float32)
        solved = self._solved(person, Hypothesis(start, "carried"), average)
        answer = _answered(Fitted.lost(0, ""), solved)
        answer = replace(answer, build=average, source=Source.RECOVERED)
        to_skeleton(person, answer)
        self._objective.pose_distance(answer)
        self._objective.score(person, solved.body)
        limit_excess(self.bank.body, answer)
        if self._clouds is not None:
            self._clouds.carry(person, person, answer)

    def recover(self, people: FramePeople, fitted: Iterable[Fitted]) -> tuple[Skeleton, ...]:
        """Check fitted bodies, recover failed ones, and filter.

        Parameters
        ----------
        people : FramePeople
        fitted : iterable of Fitted
            The refiner's answers for the same people.

        Returns
        -------
        tuple of Skeleton
            Source REFINED or RECOVERED, with filtered positions; lost people are omitted. Their
            confidence is the probability that this is a person and that the pose is right.
        """
        self._states.begin(people)
        self.begin()
        persons = {p.body_id: p for p in people.persons}
        skeletons = []
        for one in fitted:
            if (person := persons.get(one.body_id)) is not None:
                state, skeleton = self.estimate(self._states[one.body_id], person, one)
                self._states[one.body_id] = state
                skeletons += [] if skeleton is None else [skeleton]
        return tuple(skeletons)

    def begin(self) -> None:
        """Begin a frame: forget the failures of the last one."""
        self.last_reasons = {}

    def estimate(
        self, state: PersonState, person: PersonView, fitted: Fitted
    ) -> tuple[PersonState, Skeleton | None]:
        """Build the skeleton of one person; return the person's new state, and the skeleton if published."""
        state, accepted = self._accept(state, person, fitted) if self.tuning.enabled else (state, fitted)
        answer, is_refused = accepted or fitted, accepted is None
        if answer.is_lost:
            return state.lost(), None
        distance = renew_distance(state.evidence, self._objective.pose_distance(answer))
        probability = self._odds.after_fit(person.found.probability, distance)
        is_shown = is_published(
            probability, state.evidence.is_published, is_refused, self.config.min_probability
        )
        self.doubtful += is_refused or not is_shown
        if is_refused and not is_shown:
            return state.lost(), None
        skeleton = to_skeleton(person, answer)
        before = state.filter
        filtered = low_pass(before, skeleton.positions, person.stamp_ns, self._smooth)
        known = state.answer._replace(last=answer, seen=person)
        state = state._replace(answer=known, filter=filtered, evidence=Evidence(distance, is_shown))
        return state, with_motion(skeleton, before, filtered) if is_shown else None

    def _accept(
        self, state: PersonState, person: PersonView, fitted: Fitted
    ) -> tuple[PersonState, Fitted | None]:
        """Return the fit, or what replaces it after a failure; None if it is refused."""
        known = state.answer
        failure = self._check.find(fitted, known.good, known.last)
        verdict = judge(
            failure,
            known,
            is_over=_is_over(known, person.stamp_ns, self.config.max_time),
        )
        if failure is not None:
            self.last_reasons[person.body_id] = failure.reason
            self.failures[failure.kind] += 1
            if verdict is Verdict.COMPARED:
                registered = self._register(person, known, fitted, failure)
                if registered is not None:
                    self.recoveries += 1
                    return state, registered
                is_bad = failure.is_implausible or failure.kind == "low_confidence"
                verdict = Verdict.DOUBTFUL if is_bad else Verdict.TRUSTED
        if verdict is Verdict.TRUSTED:
            known = known._replace(good=fitted, good_points=len(person.points), is_waiting=False)
        return state._replace(answer=known), None if verdict is Verdict.REFUSED else fitted

    def _register(self, person: PersonView, known: Answer, fitted: Fitted, failure: Failure) -> Fitted | None:
        """Register the last body to this frame; None if the fit that failed agrees better."""
        last, before = known.last, known.seen
        assert last is not None and before is not None, "there is a frame before"
        moved = last.pose if self._clouds is None else self._clouds.carry(before, person, last)
        carried = self._solved(person, Hypothesis(moved, "carried"), last.build)
        is_part = len(person.points) < _PART * known.good_points
        allowed = max(failure.allowance, _ALLOWANCE_OF_PART if is_part else 0.0)
        if fitted.body is not None:
            refused = self._objective.score(person, fitted.body)
            if carried.score >= refused.total + allowed - _SAME_SCORE:
                return None
        answer = replace(last, stamp_ns=person.stamp_ns, source=Source.RECOVERED)
        return _answered(answer, carried)

    def _solved(self, person: PersonView, start: Hypothesis, build: NDArray[np.float32]) -> ScoredFit:
        """Fit one hypothesis to one person's frame."""
        return solve([start], self._bodies.problem(person, build, self._objective), is_measured=False)


def _is_over(known: Answer, stamp_ns: int, max_time: float) -> bool:
    """Check that the last good fit is older than ``max_time``, seconds."""
    return known.good is not None and stamp_ns - known.good.stamp_ns > max_time * 1e9


def _answered(answer: Fitted, solved: ScoredFit) -> Fitted:
    """Return an answer with another fit of the same build."""
    terms = solved.terms
    return replace(answer, body=solved.body, score=terms.depth, mean_depth_error=terms.mean_depth_error)
