"""Failure check, recovery by temporal registration, and the filter on the output (Sec. 6).

Where a failure is found in a refined skeleton (`depth_pose.recover.failure`), the body of the frame
before is carried over by the clouds (`depth_pose.recover.temporal`), as in the paper, and
fitted to the input, which takes out the drift of repeated registration. Both poses are then
compared with the input by rendering: one that is implausible in itself must agree much better to
be kept, one that merely came suddenly only as well. So a good detection wins at once, and a
recovered pose is never more than a stand-in; after `max_time` without a good one the person counts
as lost.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from depth_pose.bank.bank import Bank
from depth_pose.body.body import Body
from depth_pose.body.build import build_space
from depth_pose.body.rendered_depth import DepthComparer
from depth_pose.core.config import (
    MAX_STAMP_GAP_NS,
    FittingConfig,
    MatchConfig,
    RecoverConfig,
    SmoothConfig,
)
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL, matrix_to_quat
from depth_pose.core.skeleton import JOINT_NODES, Source
from depth_pose.core.types import Fitted, Skeleton
from depth_pose.paper.completion import MeshCompleter
from depth_pose.recover.confidence import fit_confidence, report_joints, skeleton_confidence
from depth_pose.recover.failure import KINDS, FailureCheck, excess_of
from depth_pose.recover.smooth import JointFilter
from depth_pose.recover.temporal import TemporalCarrier
from depth_pose.refine.articulated import ArticulatedFitter, BodyPose, FitTarget
from depth_pose.refine.skeleton_pose import pose_from_skeleton
from depth_pose.track.memory import PerPerson
from depth_pose.track.person import People, Person, thin
from depth_pose.track.sample_people import sample_people

_MAX_POINTS = 450
"""Points of each of the two clouds that a pose is carried between, at most. Set by hand, for time."""
_TRUST = 0.8
"""A recovered skeleton's confidence is its agreement with the input times this."""

_JOINT_TRUST = 0.9
"""The same for its joints."""

_WORSE = {"no_pose": 1.0, "bone_length": 0.1, "joint_angle": 0.1}
"""How much higher a carried pose's score may be to replace one that failed so; not at all for other kinds."""

_PART, _WORSE_OF_PART = 0.7, 0.08
"""With less than this share of the points of the last good frame a part of the person is missing, and
what fits the rest best is often something else: the carried pose's score may be higher by the second."""


_NEARLY = 0.02
"""Clouds are registered only where the body of the frame before, fitted as it was, misses the score that it
must reach by less than this. Of 145 failures of several people and in rooms a carried pose answered 63 with
all clouds registered, and 63 with the 38 that this asks for, at a third of the time."""

_HOPELESS = 0.5
"""Somebody new is not believed in with less than this share of `min_confidence`: it is furniture."""


_VETO, _VETO_SHARE = 0.1, 0.25
"""Whose chance to be a person, times the fit's confidence, stays below this is not answered: no body fits
what the finder took for a person. The second: each frame's share in the average. Set by hand."""


@dataclass(frozen=True)
class _Past:
    """The frame before: its cloud, and what was made of it before the filter."""

    person: Person
    fitted: Fitted


class _Person:
    """What is remembered of one person.

    Attributes
    ----------
    past : _Past, optional
        The frame before.
    good : Fitted, optional
        Last one without a failure.
    good_points : int
        Points that the person had then.
    standing : float
        Chance to be a person times the fit's confidence, over the last frames; everybody begins with some.
    is_waiting : bool
        Whether the person was lost and a good skeleton is awaited.
    """

    def __init__(self, smooth: SmoothConfig) -> None:
        self.filter = JointFilter(smooth)
        self.standing = 0.3
        self.reset()

    def reset(self) -> None:
        self.filter.reset()
        self.past: _Past | None = None
        self.good: Fitted | None = None
        self.good_points = 0
        self.is_waiting = False

    def trust(self, person: Person, fitted: Fitted) -> Fitted:
        """Take a skeleton for good: what comes is judged against it."""
        self.good, self.good_points, self.is_waiting = fitted, len(person.points), False
        return fitted


class Recoverer:
    """The fourth stage: what `recovery_node` runs.

    Attributes
    ----------
    last_reasons : dict of str to str
        What failed in the last frame, by body id.
    failures : Counter
        Skeletons by kind of failure (`depth_pose.recover.failure.KINDS`), since the start.
    recoveries : int
        Skeletons that recovery gave, since the start.
    """

    def __init__(
        self,
        bank: Bank,
        recover: RecoverConfig,
        smooth: SmoothConfig,
        match: MatchConfig,
        fitting: FittingConfig | None = None,
    ) -> None:
        self.bank = bank
        self.config = recover
        self._band = match.score_band
        self._check = FailureCheck(bank.body, recover)
        fitting = fitting or FittingConfig()
        self._completer = MeshCompleter(bank.body, fitting.completion, fitting.cpd)
        self._carrier = TemporalCarrier(self._completer, fitting.temporal, fitting.cpd)
        self._fitter = ArticulatedFitter(bank.body, fitting.fit)
        self._space = build_space(bank.body)
        self._memory = PerPerson(lambda: _Person(smooth), MAX_STAMP_GAP_NS)
        self.failures: Counter[str] = Counter(dict.fromkeys(KINDS, 0))
        self.recoveries = 0
        self.reset()

    def reset(self) -> None:
        """Forget all poses."""
        self._memory.reset()
        self.last_reasons: dict[str, str] = {}

    def warm_up(self) -> None:
        """Compile every kernel."""
        self._completer.warm_up()
        for person in sample_people(self.bank).persons:
            start = BodyPose(R_CAMERA_FACING_MODEL @ self.bank.rotations(0), person.points.mean(axis=0), 1.0)
            points = thin(person.points, _MAX_POINTS)
            self._carrier.carry(points, points, person.coarse, start, self.bank.body)
            pose = self._fit(self._target(person), start, self.bank.body)
            nodes = self.bank.body.pose(pose.rotations, pose.root, pose.scale).nodes
            report_joints(nodes[JOINT_NODES], pose.scale, person, 0.0)
            excess_of(pose.rotations)

    def recover(self, people: People, fitted: Iterable[Fitted]) -> tuple[Skeleton, ...]:
        """Check refined skeletons, recover where they failed, and filter.

        Parameters
        ----------
        people : People
        fitted : iterable of Fitted
            The refiner's answers to the same people.

        Returns
        -------
        tuple of Skeleton
            The refined ones, or ones with source RECOVERED, with filtered positions; who is lost is
            left out. Their confidence says that this is a person and that the pose is right.
        """
        self._memory.begin(people.stamp_ns)
        self.last_reasons = {}
        persons = {p.body_id: p for p in people.persons}
        answers = (
            self._recover(persons[f.skeleton.body_id], f) for f in fitted if f.skeleton.body_id in persons
        )
        return tuple(a for a in answers if a is not None)

    def _recover(self, person: Person, fitted: Fitted) -> Skeleton | None:
        """Answer for one person; None where they are lost."""
        memory = self._memory[person.body_id]
        answer = self._checked(person, memory, fitted) if self.config.enabled else fitted
        if answer is None or answer.skeleton.is_lost:
            memory.reset()
            memory.is_waiting = True
            return None
        memory.past = _Past(person, answer)
        positions = memory.filter.filter(answer.skeleton.positions, person.stamp_ns)
        standing = person.found.probability * answer.skeleton.confidence
        memory.standing += _VETO_SHARE * (standing - memory.standing)
        if memory.standing < _VETO:
            return None
        trust = _TRUST if answer.skeleton.source == Source.RECOVERED else 1.0
        confidence = float(np.float32(trust * skeleton_confidence(person, answer)))
        return replace(answer.skeleton, positions=positions, confidence=confidence)

    def _checked(self, person: Person, memory: _Person, refined: Fitted) -> Fitted | None:
        """Give the refined skeleton, or a better one; None where the person is lost."""
        skeleton = refined.skeleton
        before = memory.past.fitted.skeleton if memory.past is not None else None
        failure = self._check.find(refined, memory.good, before)
        if failure is None:
            return memory.trust(person, refined)
        self.last_reasons[person.body_id] = failure.reason
        self.failures[failure.kind] += 1
        in_itself = failure.kind in ("no_pose", "bone_length", "joint_angle")
        if memory.good is None and skeleton.confidence < _HOPELESS * self.config.min_confidence:
            return None
        if memory.past is None and not memory.is_waiting and not skeleton.is_lost:
            return _doubted(refined)
        if memory.past is None or self._is_over(memory, person.stamp_ns):
            return None if in_itself else memory.trust(person, refined)
        partial = len(person.points) < _PART * memory.good_points
        limit = refined.score + max(_WORSE.get(failure.kind, 0.0), _WORSE_OF_PART if partial else 0.0)
        recovered = self._carry(memory.past, person, limit)
        if recovered.score >= limit:
            is_bad = in_itself or failure.kind == "low_confidence"
            return refined if is_bad else memory.trust(person, refined)
        self.recoveries += 1
        return _doubted(recovered)

    def _is_over(self, memory: _Person, stamp_ns: int) -> bool:
        """Tell whether the last good skeleton is too long ago."""
        good = memory.good
        return good is not None and stamp_ns - good.skeleton.stamp_ns > self.config.max_time * 1e9

    def _carry(self, past: _Past, person: Person, limit: float) -> Fitted:
        """Bring the last skeleton's body to this frame: as it was, or carried over where that may help."""
        body = self._space.body(past.fitted.skeleton.build)
        pose, target = pose_from_skeleton(body, past.fitted.skeleton), self._target(person)
        kept = self._fitted(past, person, self._fit(target, pose, body), body)
        if kept.score < limit or kept.score > limit + _NEARLY:
            return kept
        before, now = thin(past.person.points, _MAX_POINTS), thin(person.points, _MAX_POINTS)
        carried = self._carrier.carry(before, now, past.person.coarse, pose, body)
        return self._fitted(past, person, self._fit(target, carried.pose, body), body)

    def _fitted(self, past: _Past, person: Person, pose: BodyPose, body: Body) -> Fitted:
        """Put a pose of the last skeleton's body into words, and compare it with this frame."""
        mesh = body.pose(pose.rotations, pose.root, pose.scale)
        seen = DepthComparer(person.coarse, self._band).compare(mesh.vertices, body.faces)
        positions = mesh.nodes[JOINT_NODES]
        report = report_joints(positions, pose.scale, person, seen.score)
        skeleton = Skeleton(
            stamp_ns=person.stamp_ns,
            frame_id=person.frame_id,
            body_id=person.body_id,
            source=Source.RECOVERED,
            confidence=float(np.float32(fit_confidence(seen.score))),
            residual=float(np.float32(seen.gap)),
            scale=past.fitted.skeleton.scale,
            positions=positions,
            quats_xyzw=matrix_to_quat(pose.rotations[JOINT_NODES]),
            joint_confidence=(_JOINT_TRUST * report.confidence).astype(np.float32),
            joint_states=report.states,
            build=past.fitted.skeleton.build,
        )
        return Fitted(skeleton, seen.score)

    def _target(self, person: Person) -> FitTarget:
        points = thin(person.points, self._fitter.config.max_points)
        return FitTarget.prepare(points, person.full, person.coarse, person.found)

    def _fit(self, target: FitTarget, start: BodyPose, body: Body) -> BodyPose:
        return self._fitter.of(body).fit(target, start, self._fitter.config.carried)


def _doubted(fitted: Fitted) -> Fitted:
    """Give it with less confidence."""
    confidence = float(np.float32(_TRUST * fitted.skeleton.confidence))
    return replace(fitted, skeleton=replace(fitted.skeleton, confidence=confidence))
