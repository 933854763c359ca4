"""Failure check, recovery by temporal registration, and the filter on the output (Sec. 6).

Where a failure is found in a refined skeleton (`depth_pose.steps.failure`), the body of the frame
before is carried over by the clouds (`depth_pose.fit.temporal`), as in the paper, and
fitted to the input, which takes out the drift of repeated registration. Both poses are then
compared with the input by rendering: one that is implausible in itself must agree much better to
be kept, one that merely came suddenly only as well. So a good detection wins at once, and a
recovered pose is never more than a stand-in; after `max_time` without a good one the person counts
as lost.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from depth_pose.bank.bank import Bank
from depth_pose.core.config import FittingConfig, MatchConfig, RecoverConfig, SmoothConfig
from depth_pose.core.rotations import matrix_to_quat
from depth_pose.core.skeleton import JOINT_NODES, Source
from depth_pose.core.stamps import StampGuard
from depth_pose.core.types import PersonCloud, Skeleton
from depth_pose.fit.articulated import ArticulatedFitter, BodyPose, FitTarget
from depth_pose.fit.completion import MeshCompleter
from depth_pose.fit.rendered_depth import DepthComparer
from depth_pose.fit.skeleton_pose import pose_from_skeleton
from depth_pose.fit.temporal import TemporalCarrier
from depth_pose.people.identity import PersonGuard
from depth_pose.people.person import PersonView, thin, view_person
from depth_pose.steps.confidence import report_joints, score_of, skeleton_confidence
from depth_pose.steps.failure import KINDS, Failure, FailureCheck
from depth_pose.steps.smooth import JointFilter
from depth_pose.steps.warm_up import sample_cloud

_MAX_POINTS = 450
_TRUST = 0.8
"""A recovered skeleton's confidence is its agreement with the input times this."""

_JOINT_TRUST = 0.9
"""The same for its joints."""

_WORSE = {"no_pose": 1.0, "bone_length": 0.1, "joint_angle": 0.1}
"""How much higher a carried pose's score may be to replace one that failed so; not at all for other kinds."""

_PART, _WORSE_OF_PART = 0.7, 0.08
"""With less than this share of the points of the last good frame a part of the person is missing, and
what fits the rest best is often something else: the carried pose's score may be higher by the second."""


_HOPELESS = 0.5
"""Somebody new is not believed in with less than this share of `min_confidence`: it is furniture."""


@dataclass(frozen=True)
class _Past:
    """The frame before: its cloud, and what was made of it before the filter."""

    view: PersonView
    skeleton: Skeleton


class Recoverer:
    """The fourth stage: what `recovery_node` runs.

    Attributes
    ----------
    last_reason : str
        What failed in the last frame; empty where nothing did.
    failures : Counter
        Frames by kind of failure (`depth_pose.steps.failure.KINDS`), since the start.
    recoveries : int
        Frames answered by recovery, since the start.
    """

    def __init__(
        self, bank: Bank, recover: RecoverConfig, smooth: SmoothConfig, fitting: FittingConfig | None = None
    ) -> None:
        self.bank = bank
        self.config = recover
        self._check = FailureCheck(bank.body, recover)
        fitting = fitting or FittingConfig()
        self._completer = MeshCompleter(bank.body, fitting.completion, fitting.cpd)
        self._carrier = TemporalCarrier(self._completer, fitting.temporal, fitting.cpd)
        self._fitter = ArticulatedFitter(bank.body, fitting.fit)
        self._filter = JointFilter(smooth)
        self._guard = StampGuard()
        self._identity = PersonGuard()
        self._people = 0
        self.failures: Counter[str] = Counter(dict.fromkeys(KINDS, 0))
        self.recoveries = 0
        self.reset()

    def reset(self) -> None:
        """Forget the last pose; who comes soon at the same place keeps the body id."""
        self._filter.reset()
        self._past: _Past | None = None
        self._good: Skeleton | None = None
        self._good_points = 0
        self._waiting = False
        self.last_reason = ""

    def warm_up(self) -> None:
        """Compile every kernel."""
        self._completer.warm_up()
        view = view_person(sample_cloud(self.bank))
        if view is not None:
            turned = np.diag([1.0, -1.0, -1.0])
            start = BodyPose(turned @ self.bank.rotations(0), view.points.mean(axis=0), 1.0)
            points = thin(view.points, _MAX_POINTS)
            self._carrier.carry(points, points, view.coarse, start)
            pose = self._fit(view, start)
            nodes = self.bank.body.pose(pose.rotations, pose.root, pose.scale).nodes
            report_joints(nodes[JOINT_NODES], pose.scale, view, 0.0)

    def recover(self, cloud: PersonCloud, skeleton: Skeleton) -> Skeleton:
        """Check a refined skeleton, recover where it failed, and filter.

        Parameters
        ----------
        cloud : PersonCloud
        skeleton : Skeleton
            The refiner's answer to the same cloud.

        Returns
        -------
        Skeleton
            The refined one, or one with source RECOVERED, with filtered positions and a body id;
            or LOST.
        """
        if self._guard.is_break(cloud.stamp_ns):
            self.reset()
        view = view_person(cloud)
        if view is None:
            self.reset()
            return Skeleton.lost(cloud.stamp_ns, cloud.frame_id)
        is_other = self._identity.is_other(view, cloud.stamp_ns)
        if is_other:
            self.reset()
        answer = self._checked(view, skeleton) if self.config.enabled else skeleton
        if answer.is_lost:
            reason = self.last_reason
            self.reset()
            self.last_reason, self._waiting = reason, True
            return Skeleton.lost(cloud.stamp_ns, cloud.frame_id)
        self._identity.note(view, cloud.stamp_ns)
        self._people += is_other
        self._past = _Past(view, answer)
        positions = self._filter.filter(answer.positions, cloud.stamp_ns)
        return replace(answer, body_id=f"body_{self._people}", positions=positions)

    def _checked(self, view: PersonView, refined: Skeleton) -> Skeleton:
        """Give the refined skeleton, or a better one, or a lost one."""
        before = self._past.skeleton if self._past is not None else None
        failure = self._check.find(refined, self._good, before)
        self.last_reason = failure.reason if failure else ""
        if failure is None:
            return self._trusted(view, refined)
        self.failures[failure.kind] += 1
        in_itself = failure.kind in ("no_pose", "bone_length", "joint_angle")
        if self._good is None and refined.confidence < _HOPELESS * self.config.min_confidence:
            return Skeleton.lost(refined.stamp_ns, refined.frame_id)
        if self._past is None and not self._waiting and not refined.is_lost:
            return replace(refined, confidence=float(np.float32(_TRUST * refined.confidence)))
        if self._past is None or self._is_over(refined.stamp_ns):
            return (
                Skeleton.lost(refined.stamp_ns, refined.frame_id)
                if in_itself
                else self._trusted(view, refined)
            )
        recovered = self._carry(self._past, view, refined)
        if not _is_better(recovered, refined, failure, len(view.points) < _PART * self._good_points):
            return refined if in_itself or failure.kind == "low_confidence" else self._trusted(view, refined)
        self.recoveries += 1
        return replace(recovered, confidence=float(np.float32(_TRUST * recovered.confidence)))

    def _trusted(self, view: PersonView, refined: Skeleton) -> Skeleton:
        """Take a skeleton for good: what comes is judged against it."""
        self._good, self._good_points, self._waiting = refined, len(view.points), False
        return refined

    def _is_over(self, stamp_ns: int) -> bool:
        """Tell whether the last good skeleton is too long ago."""
        return self._good is not None and stamp_ns - self._good.stamp_ns > self.config.max_time * 1e9

    def _carry(self, past: _Past, view: PersonView, refined: Skeleton) -> Skeleton:
        """Carry the last skeleton's body over to this frame, and fit it."""
        pose = pose_from_skeleton(self.bank.body, past.skeleton)
        before, now = thin(past.view.points, _MAX_POINTS), thin(view.points, _MAX_POINTS)
        carried = self._carrier.carry(before, now, past.view.coarse, pose)
        pose = self._fit(view, carried.pose)
        mesh = self.bank.body.pose(pose.rotations, pose.root, pose.scale)
        seen = DepthComparer(view.coarse, MatchConfig().score_band).compare(
            mesh.vertices, self.bank.body.faces
        )
        confidence = skeleton_confidence(seen.score)
        positions = mesh.nodes[JOINT_NODES]
        report = report_joints(positions, pose.scale, view, seen.score)
        return Skeleton(
            stamp_ns=refined.stamp_ns,
            frame_id=refined.frame_id,
            body_id="",
            source=Source.RECOVERED,
            confidence=float(np.float32(confidence)),
            residual=float(np.float32(seen.gap)),
            scale=past.skeleton.scale,
            positions=positions,
            quats_xyzw=matrix_to_quat(pose.rotations[JOINT_NODES]),
            joint_confidence=(_JOINT_TRUST * report.confidence).astype(np.float32),
            joint_states=report.states,
        )

    def _fit(self, view: PersonView, start: BodyPose) -> BodyPose:
        points = thin(view.points, self._fitter.config.max_points)
        target = FitTarget.prepare(points, view.full, view.coarse)
        return self._fitter.fit(target, start, self._fitter.config.carried)


def _is_better(recovered: Skeleton, refined: Skeleton, failure: Failure, partial: bool) -> bool:
    """Choose between a carried pose and the one that failed."""
    margin = max(_WORSE.get(failure.kind, 0.0), _WORSE_OF_PART if partial else 0.0)
    return score_of(recovered.confidence) < score_of(refined.confidence) + margin
