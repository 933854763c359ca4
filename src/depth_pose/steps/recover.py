"""Failure check, recovery by temporal registration, and the filter on the output (Sec. 6).

A refined skeleton in which a failure is found (`depth_pose.steps.failure`) is replaced by the body
of the frame before, carried over by the clouds (`depth_pose.registration.temporal`). Recovered
skeletons are judged against the last good one and never stand in for it, so that an error does not
outlive `max_frames`; after that many in a row the person counts as lost until a good detection.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from depth_pose.bank.bank import Bank
from depth_pose.config import MatchConfig, RecoverConfig, SmoothConfig
from depth_pose.geometry import matrix_to_quat
from depth_pose.registration.completion import MeshCompleter
from depth_pose.registration.skeleton_pose import pose_from_skeleton
from depth_pose.registration.temporal import TemporalCarrier
from depth_pose.render import DepthComparer
from depth_pose.skeleton import JOINT_NODES, Source
from depth_pose.steps.confidence import report_joints, skeleton_confidence
from depth_pose.steps.failure import KINDS, FailureCheck
from depth_pose.steps.smooth import JointFilter
from depth_pose.steps.stamps import StampGuard
from depth_pose.steps.view import PersonView, thin, view_person
from depth_pose.types import PersonCloud, Skeleton

_MAX_POINTS = 600
_TRUST = 0.8
"""A recovered skeleton's confidence is its agreement with the input times this, once per frame."""


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

    def __init__(self, bank: Bank, recover: RecoverConfig, smooth: SmoothConfig) -> None:
        self.bank = bank
        self.config = recover
        self._check = FailureCheck(bank.body, recover)
        self._completer = MeshCompleter(bank.body)
        self._carrier = TemporalCarrier(self._completer)
        self._filter = JointFilter(smooth)
        self._guard = StampGuard()
        self._people = 0
        self.failures: Counter[str] = Counter(dict.fromkeys(KINDS, 0))
        self.recoveries = 0
        self.reset()

    def reset(self) -> None:
        """Forget the person; the next one gets a new body id."""
        self._filter.reset()
        self._past: _Past | None = None
        self._good: Skeleton | None = None
        self._run = 0
        self._waiting = False
        self.last_reason = ""

    def warm_up(self) -> None:
        """Compile every kernel."""
        self._completer.warm_up()

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
        answer = self._checked(view, skeleton) if self.config.enabled else skeleton
        if answer.is_lost:
            reason = self.last_reason
            self.reset()
            self.last_reason, self._waiting = reason, True
            return Skeleton.lost(cloud.stamp_ns, cloud.frame_id)
        if self._past is None:
            self._people += 1
        self._past = _Past(view, answer)
        positions = self._filter.filter(answer.positions, cloud.stamp_ns)
        return replace(answer, body_id=f"body_{self._people}", positions=positions)

    def _checked(self, view: PersonView, refined: Skeleton) -> Skeleton:
        """Give the refined skeleton, or a better one, or a lost one."""
        failure = self._check.find(refined, self._good)
        self.last_reason = failure.reason if failure else ""
        if failure is None:
            self._good, self._run, self._waiting = refined, 0, False
            return refined
        self.failures[failure.kind] += 1
        doubtful = failure.kind == "low_confidence"  # plausible in itself: the input may be poor
        if self._past is None and not self._waiting and not refined.is_lost:
            return replace(refined, confidence=float(np.float32(_TRUST * refined.confidence)))
        if self._past is None or self._run >= self.config.max_frames:
            return refined if doubtful else Skeleton.lost(refined.stamp_ns, refined.frame_id)
        recovered = self._carry(self._past, view, refined)
        if doubtful and recovered.confidence <= refined.confidence:
            return refined
        self._run += 1
        self.recoveries += 1
        return recovered

    def _carry(self, past: _Past, view: PersonView, refined: Skeleton) -> Skeleton:
        """Carry the last skeleton's body over to this frame."""
        body = self.bank.body
        pose = pose_from_skeleton(body, past.skeleton)
        before, now = thin(past.view.points, _MAX_POINTS), thin(view.points, _MAX_POINTS)
        carried = self._carrier.carry(before, now, past.view.coarse, pose)
        mesh = body.pose(carried.pose.rotations, carried.pose.root, carried.pose.scale)
        seen = DepthComparer(view.coarse, MatchConfig().score_band).compare(mesh.vertices, body.faces)
        confidence = skeleton_confidence(seen.score) * _TRUST ** (self._run + 1)
        positions = mesh.nodes[JOINT_NODES]
        report = report_joints(positions, pose.scale, view)
        return Skeleton(
            stamp_ns=refined.stamp_ns,
            frame_id=refined.frame_id,
            body_id="",
            source=Source.RECOVERED,
            confidence=float(np.float32(confidence)),
            residual=float(np.float32(seen.gap)),
            scale=past.skeleton.scale,
            positions=positions,
            quats_xyzw=matrix_to_quat(carried.pose.rotations[JOINT_NODES]),
            joint_confidence=(confidence * report.certainty).astype(np.float32),
            joint_states=report.states,
        )
