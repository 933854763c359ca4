"""Failure check, recovery by temporal registration, and the filter on the output (Sec. 6).

If a failure is found in a fitted body (`depth_pose.recover.failure`), the body of the previous frame is
carried over by the clouds (`depth_pose.recover.temporal`), as in the paper, and fitted to the input, which
removes the drift of repeated registration. Both poses are then compared with the input by rendering. A pose
that is implausible in itself is kept only if it agrees much better; a pose that merely changed suddenly is
kept if it agrees as well. A good detection therefore wins at once, and a recovered pose is only a substitute.
After `max_time` without a good pose the person counts as lost. The published `Skeleton` is built here.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.body.pose import BodyPose, Fitted, FittedBody
from depth_pose.core.config import MatchConfig, RecoverConfig, SmoothConfig
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL, matrix_to_quat
from depth_pose.core.skeleton import JOINT_NODES, Source
from depth_pose.core.types import Skeleton
from depth_pose.paper.completion import MeshCompleter
from depth_pose.recover.confidence import fit_confidence, report_joints, skeleton_confidence
from depth_pose.recover.failure import KINDS, FailureCheck, excess_of
from depth_pose.recover.measurements import weigh_joints
from depth_pose.recover.other_view import SidesBelief
from depth_pose.recover.smooth import JointFilter
from depth_pose.recover.temporal import TemporalCarrier
from depth_pose.refine.body_fitter import BodyFitter
from depth_pose.refine.kept_poses import AWAY_WEIGHT
from depth_pose.refine.proposals import from_proposals
from depth_pose.refine.skeleton_pose import about_face
from depth_pose.track.memory import Subject, Subjects
from depth_pose.track.person_view import FramePeople, PersonView, thin
from depth_pose.track.sample_people import sample_people

_MAX_POINTS = 450
"""Maximum number of points of each of the two registered clouds; set by hand, for time."""

_TRUST = 0.8
"""Factor on the confidence of a recovered skeleton."""

_JOINT_TRUST = 0.9
"""Factor on the confidence of its joints."""

_WORSE = {"no_pose": 1.0, "bone_length": 0.1, "joint_angle": 0.1}
"""Score excess with which a carried pose still replaces a fit that failed this way; 0 for other kinds."""

_PART, _WORSE_OF_PART = 0.7, 0.08
"""Share of the last good frame's points below which a part of the person is missing, and the score excess
that is then allowed for the carried pose."""

_NEARLY = 0.02
"""Clouds are registered only if the previous body, fitted unchanged, misses the score to reach by less
than this."""

_SIDES_SURE = 0.9
"""Probability that sides are not exchanged, below which the other view is answered, too. Set by hand."""

_CONTRADICTED = 0.08
"""But not if the depth image disagrees by this much more with it. Set by hand."""

_HOPELESS = 0.5
"""Share of `min_confidence` below which a new person is not published: it is furniture."""

_VETO, _VETO_SHARE = 0.1, 0.25
"""Standing (`RecoveryMemory`) below which a person is not published unless sure, and the share of each
frame in its average; set by hand."""

_SURE = 0.75
"""Person probability, over all frames, above which a person is published even if no body fits."""

_FIRST_STANDING = 0.3
"""Standing of a new person; set by hand."""


@dataclass
class RecoveryMemory:
    """State of recovery for one track.

    Attributes
    ----------
    filter : JointFilter
    sides : SidesBelief
    standing : float
        Person probability times the fit's confidence, averaged over the last frames.
    before : Fitted or None
        The unfiltered answer for the previous frame.
    person_before : PersonView or None
        The observation in that frame.
    good : Fitted or None
        The last fit without a failure.
    good_points : int
        Number of the person's points in that frame.
    is_waiting : bool
        Whether the person was lost and a good fit is awaited.
    """

    filter: JointFilter
    sides: SidesBelief = field(default_factory=SidesBelief)
    standing: float = _FIRST_STANDING
    before: Fitted | None = None
    person_before: PersonView | None = None
    good: Fitted | None = None
    good_points: int = 0
    is_waiting: bool = False

    def lose(self) -> None:
        """Forget the poses, and wait for a good one."""
        self.filter.reset()
        self.sides.reset()
        self.before = self.person_before = self.good = None
        self.good_points, self.is_waiting = 0, True

    def trust(self, person: PersonView, fitted: Fitted) -> Fitted:
        """Accept a fit as the reference for later frames."""
        self.good, self.good_points, self.is_waiting = fitted, len(person.points), False
        return fitted


class Recoverer:
    """The fourth stage of the pipeline, run by `recovery_node`.

    Parameters
    ----------
    bank : Bank
    recover : RecoverConfig
    smooth : SmoothConfig
    match : MatchConfig
    bodies : BodyFitter
    completer : MeshCompleter
        Completes meshes of the bank's body.
    subjects : Subjects, optional
        State of all tracks, shared with the other stages of a process.

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
        match: MatchConfig,
        bodies: BodyFitter,
        completer: MeshCompleter,
        subjects: Subjects | None = None,
    ) -> None:
        self.bank = bank
        self.config = recover
        self._smooth = smooth
        self._band = match.score_band
        self._bodies = bodies
        self._completer = completer
        self._subjects = subjects or Subjects()
        self._check = FailureCheck(bank.body, recover)
        self._carrier = TemporalCarrier(completer, bodies.config.temporal, bodies.config.cpd)
        self.failures: Counter[str] = Counter(dict.fromkeys(KINDS, 0))
        self.recoveries = 0
        self.doubtful = 0
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._subjects.reset()
        self.last_reasons: dict[str, str] = {}

    def warm_up(self) -> None:
        """Compile every kernel."""
        self._completer.warm_up()
        for person in sample_people(self.bank).persons:
            start = BodyPose(R_CAMERA_FACING_MODEL @ self.bank.rotations(0), person.points.mean(axis=0), 1.0)
            points = thin(person.points, _MAX_POINTS)
            self._carrier.carry(points, points, person.coarse, start, self.bank.body)
            fitted = self._fit(person, start, np.zeros(0, np.float32))
            sure = report_joints(fitted.joints, fitted.pose.scale, person, fitted.score).confidence
            weigh_joints(fitted.joints, fitted.score, sure, person.measured)
            SidesBelief().renew(fitted.joints, person.measured, person.stamp_ns)
            _disagreement(fitted, person)
            excess_of(fitted.pose.rotations)

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
            confidence is the probability that this is a person and that the pose is right. Where left and
            right cannot be told, with an alternative that faces the other way.
        """
        self._subjects.begin(people)
        self.last_reasons = {}
        persons = {p.body_id: p for p in people.persons}
        answers = (self._recover(persons[f.body_id], f) for f in fitted if f.body_id in persons)
        return tuple(a for a in answers if a is not None)

    def _recover(self, person: PersonView, fitted: Fitted) -> Skeleton | None:
        """Build the skeleton of one person; None if lost."""
        memory = self._remembered(self._subjects[person.body_id])
        is_sure = person.found.probability >= _SURE
        answer = self._checked(person, memory, fitted) if self.config.enabled else fitted
        if answer is None and not fitted.is_lost:
            self.doubtful += 1
            answer = fitted if is_sure else None
        if answer is None or answer.is_lost:
            memory.lose()
            return None
        memory.before, memory.person_before = answer, person
        is_recovered = answer.source == Source.RECOVERED
        trust = _TRUST if is_recovered else 1.0
        standing = person.found.probability * trust * fit_confidence(answer.score)
        memory.standing += _VETO_SHARE * (standing - memory.standing)
        joints = _weighed(person, answer)
        positions = memory.filter.filter(joints, person.stamp_ns)
        sides = memory.sides.renew(joints, person.measured, person.stamp_ns)
        if memory.standing < _VETO:
            self.doubtful += 1
            if not is_sure:
                return None
        skeleton = _skeleton(person, answer, joints, trust, _JOINT_TRUST if is_recovered else 1.0)
        alternative = self._other_view(person, answer, sides) if sides < _SIDES_SURE else None
        return replace(skeleton, positions=positions, alternative=alternative)

    def _other_view(self, person: PersonView, answer: Fitted, sides: float) -> Skeleton | None:
        """Return the answer for the same person facing the other way; None if the input contradicts it."""
        turned = replace(self._fit(person, about_face(answer.pose), answer.build), source=answer.source)
        if turned.score > answer.score + _CONTRADICTED:
            return None
        other, share = _skeleton(person, turned, _weighed(person, turned), 1.0, 1.0), 1.0 - sides
        joint_confidence = np.float32(share) * other.joint_confidence
        return replace(other, confidence=share * other.confidence, joint_confidence=joint_confidence)

    def _remembered(self, subject: Subject) -> RecoveryMemory:
        if subject.recovery is None:
            subject.recovery = RecoveryMemory(JointFilter(self._smooth))
        return subject.recovery

    def _checked(self, person: PersonView, memory: RecoveryMemory, refined: Fitted) -> Fitted | None:
        """Return the refined fit, or a better one; None if the person is lost."""
        failure = self._check.find(refined, memory.good, memory.before)
        if failure is None:
            return memory.trust(person, refined)
        self.last_reasons[person.body_id] = failure.reason
        self.failures[failure.kind] += 1
        in_itself = failure.kind in ("no_pose", "bone_length", "joint_angle")
        hopeless = _HOPELESS * self.config.min_confidence
        if memory.good is None and (refined.is_lost or fit_confidence(refined.score) < hopeless):
            return None
        if memory.before is None and not memory.is_waiting and not refined.is_lost:
            return refined
        if memory.before is None or self._is_over(memory, person.stamp_ns):
            return None if in_itself else memory.trust(person, refined)
        partial = len(person.points) < _PART * memory.good_points
        allowed = max(_WORSE.get(failure.kind, 0.0), _WORSE_OF_PART if partial else 0.0)
        recovered = self.carry(memory, person, refined.score + allowed)
        if _disagreement(recovered, person) >= _disagreement(refined, person) + allowed:
            is_bad = in_itself or failure.kind == "low_confidence"
            return refined if is_bad else memory.trust(person, refined)
        self.recoveries += 1
        return recovered

    def _is_over(self, memory: RecoveryMemory, stamp_ns: int) -> bool:
        """Check that the last good fit is older than `max_time`."""
        good = memory.good
        return good is not None and stamp_ns - good.stamp_ns > self.config.max_time * 1e9

    def carry(self, memory: RecoveryMemory, person: PersonView, limit: float) -> Fitted:
        """Move the last body to this frame: unchanged, or moved by registering the point clouds.

        Parameters
        ----------
        memory : RecoveryMemory
            With the previous frame's fit and person.
        person : PersonView
        limit : float
            The clouds are registered if the unchanged pose scores slightly above this.

        Returns
        -------
        Fitted
            Source RECOVERED.
        """
        last, shown = memory.before, memory.person_before
        assert last is not None and shown is not None, "a person without a previous frame is not carried"
        kept = self._fit(person, last.pose, last.build)
        if kept.score < limit or kept.score > limit + _NEARLY:
            return kept
        before, now = thin(shown.points, _MAX_POINTS), thin(person.points, _MAX_POINTS)
        body = self._bodies.space.body(last.build)
        carried = self._carrier.carry(before, now, shown.coarse, last.pose, body)
        return self._fit(person, carried.pose, last.build)

    def _fit(self, person: PersonView, start: BodyPose, build: NDArray[np.float32]) -> Fitted:
        """Fit the body of the previous frame to this frame, and compare the two."""
        fitter = self._bodies.of(build)
        pose = fitter.fit(self._bodies.target(person), start, fitter.config.carried).pose
        mesh = fitter.body.pose(pose.rotations, pose.root, pose.scale)
        seen = person.comparer.compare(mesh.vertices, fitter.body.faces, self._band)
        body = FittedBody(pose, mesh.vertices, mesh.nodes)
        return Fitted(person.body_id, person.stamp_ns, Source.RECOVERED, body, build, seen.score, seen.gap)


def _weighed(person: PersonView, answer: Fitted) -> NDArray[np.float64]:
    """Return the joints (19, 3) of a fit, weighed with those proposed."""
    sure = report_joints(answer.joints, answer.pose.scale, person, answer.score).confidence
    return weigh_joints(answer.joints, answer.score, sure, person.measured).joints


def _skeleton(
    person: PersonView, answer: Fitted, joints: NDArray[np.float64], trust: float, joint_trust: float
) -> Skeleton:
    """Return the skeleton of an answer and its joints (19, 3), with factors on its confidences."""
    report = report_joints(joints, answer.pose.scale, person, answer.score)
    joint_confidence = joint_trust * report.confidence
    return Skeleton(
        stamp_ns=person.stamp_ns,
        frame_id=person.frame_id,
        body_id=person.body_id,
        source=answer.source,
        confidence=trust * skeleton_confidence(person, joints, report.states, joint_confidence),
        residual=answer.gap,
        scale=answer.pose.scale,
        positions=joints,
        quats_xyzw=matrix_to_quat(answer.pose.rotations[JOINT_NODES]),
        joint_confidence=joint_confidence.astype(np.float32),
        joint_states=report.states,
        build=answer.build,
    )


def _disagreement(fitted: Fitted, person: PersonView) -> float:
    """Return the disagreement with the depth image and with the proposed joints, as for fits."""
    if fitted.is_lost:
        return fitted.score
    return fitted.score + AWAY_WEIGHT * from_proposals(fitted.nodes, person.measured)
