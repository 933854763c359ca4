"""Detection of failed skeletons (Sec. 6): sudden changes, joints beyond their limits, poor agreement.

The paper checks for sudden changes of bone lengths and for joint angles beyond their limits. The articulated
fit keeps bone lengths, and a person fitted back to front bends no joint beyond its limits. Therefore jumps of
joints and the fit's score (`depth_pose.body.rendered_depth`) are checked too, against the previous frame.
`benchmarks/recovery.py` measures how many simulated failures are found.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.angles import ANGLES, HANG
from depth_pose.body.body import Body
from depth_pose.body.pose import Fitted
from depth_pose.core.rotations import length_of, lengths_of, rotation_y
from depth_pose.core.skeleton import BONES, JOINT_NODES, JOINTS, NODE_INDEX
from depth_pose.recover import _failure_kernels as kernels
from depth_pose.recover.confidence import fit_confidence
from depth_pose.recover.tuning import RecoverTuning
from depth_pose.refine.skeleton_pose import pose_from_nodes
from depth_pose.track.state import Answer

KINDS: tuple[str, ...] = (
    "no_pose",
    "bone_length",
    "joint_angle",
    "low_confidence",
    "jump",
    "worse_fit",
)
"""Kinds of failure, used as keys of the counters, in the order of the checks."""

_IMPLAUSIBLE = {"no_pose": 1.0, "bone_length": 0.1, "joint_angle": 0.1}
"""Kinds of failures whose pose is wrong in itself, and the score excess (`Failure.allowance`) of each."""

_JUMP_M = 0.1
"""Allowed change (m) of a joint from frame to frame, in addition to what its speed allows."""

_UNKNOWN_PERSON = 2.0
"""Factor on the allowed bone length deviation from the body's own, before the person's lengths are known."""

_LEAST_CHANGE_M = 0.06
"""Bone length changes below this (m) are not failures."""

_LIMB_REST = tuple(np.stack([HANG[n] for n in names]) for names in (("shoulder", "elbow"), ("hip", "knee")))
"""Rotations from rest to hanging of a left arm's and a left leg's upper and lower segment, (2, 3, 3) each."""

_BENT = 0.5
"""Sine of the bend above which elbow and knee determine the twist of the segment above."""


def _hinges() -> list[tuple[int, int, int, NDArray[np.float64], float]]:
    """Return upper and lower segment, end, rotation from rest to hanging, and 1 if it folds forward."""
    out = []
    for side, mirror in (("left", 1.0), ("right", -1.0)):
        flip = np.array([mirror, 1.0, 1.0])
        for names, forward in ((("shoulder", "elbow", "wrist"), 1.0), (("hip", "knee", "ankle"), -1.0)):
            upper, lower, end = (NODE_INDEX[f"{side}_{name}"] for name in names)
            out.append((upper, lower, end, flip[:, None] * HANG[names[0]] * flip, forward))
    return out


_HINGES = _hinges()


@dataclass(frozen=True)
class Failure:
    """A kind, one of `KINDS`, and a readable reason why a fit is refused."""

    kind: str
    reason: str

    @property
    def is_implausible(self) -> bool:
        """Whether the pose is wrong in itself; others only changed suddenly, or agree poorly."""
        return self.kind in _IMPLAUSIBLE

    @property
    def allowance(self) -> float:
        """Score excess with which the last good body still replaces the refused fit."""
        return _IMPLAUSIBLE.get(self.kind, 0.0)


class Verdict(Enum):
    """Decision on a fit.

    It is a reference for later frames; doubtful but the answer; refused; or compared with the last body.
    """

    TRUSTED = auto()
    DOUBTFUL = auto()
    REFUSED = auto()
    COMPARED = auto()


def judge(failure: Failure | None, answer: Answer, *, is_over: bool) -> Verdict:
    """Decide how a fit is used.

    Parameters
    ----------
    failure : Failure or None
    answer : Answer
        Of the frames before.
    is_over : bool
        Whether the last good fit is too old to be registered.
    """
    if failure is None:
        return Verdict.TRUSTED
    is_lost = failure.kind == "no_pose"
    if answer.good is None and is_lost:
        return Verdict.REFUSED
    if answer.last is None and not answer.is_waiting and not is_lost:
        return Verdict.DOUBTFUL
    if answer.last is None or is_over:
        return Verdict.REFUSED if failure.is_implausible else Verdict.TRUSTED
    return Verdict.COMPARED


class FailureCheck:
    """Checks the skeletons of one body."""

    def __init__(self, body: Body, min_confidence: float, tuning: RecoverTuning = RecoverTuning()) -> None:
        self.body = body
        self.min_confidence, self.tuning = min_confidence, tuning
        self._own_bones = bone_lengths(body.nodes[JOINT_NODES])

    def find(self, fitted: Fitted, good: Fitted | None, before: Fitted | None) -> Failure | None:
        """Look for a failure.

        Parameters
        ----------
        fitted : Fitted
        good : Fitted, optional
            The last fit without a failure; the body's own proportions by default.
        before : Fitted, optional
            The unfiltered answer for the previous frame.

        Returns
        -------
        Failure or None
        """
        if fitted.is_lost:
            return Failure("no_pose", "no pose was found, although a person is in view")
        return (
            self._changed_bone(fitted, good)
            or self._bent_too_far(fitted)
            or self._unsure(fitted)
            or self._jumped(fitted, before)
            or self._fits_worse(fitted, good)
        )

    def _changed_bone(self, fitted: Fitted, good: Fitted | None) -> Failure | None:
        if good is None:
            before, allowed = self._own_bones, _UNKNOWN_PERSON * self.tuning.bone_change
        else:
            before, allowed = bone_lengths(good.joints) / good.pose.scale, self.tuning.bone_change
        scale = fitted.pose.scale
        now = bone_lengths(fitted.joints) / scale
        change = np.abs(now / before - 1.0)
        change[np.abs(now - before) * scale < _LEAST_CHANGE_M] = 0.0
        b = int(change.argmax())
        if change[b] <= allowed:
            return None
        start, end = (JOINTS[j] for j in BONES[b])
        return Failure(
            "bone_length",
            f"{start} to {end} went from {before[b] * scale:.2f} to "
            f"{now[b] * scale:.2f} m, by {change[b]:.0%} (bone_change allows {allowed:.0%})",
        )

    def _bent_too_far(self, fitted: Fitted) -> Failure | None:
        excess = limit_excess(self.body, fitted)
        a = int(excess.argmax())
        if excess[a] <= self.tuning.angle_excess:
            return None
        return Failure(
            "joint_angle",
            f"{ANGLES[a]} is {excess[a]:.0f} degrees beyond its limit "
            f"(angle_excess allows {self.tuning.angle_excess:.0f})",
        )

    def _jumped(self, fitted: Fitted, before: Fitted | None) -> Failure | None:
        if before is None:
            return None
        seconds = (fitted.stamp_ns - before.stamp_ns) * 1e-9
        way = lengths_of(fitted.joints - before.joints)
        allowed = _JUMP_M + self.tuning.joint_speed * seconds
        j = int(way.argmax())
        if way[j] <= allowed:
            return None
        return Failure(
            "jump",
            f"{JOINTS[j]} went {way[j]:.2f} m in {seconds:.3f} s (joint_speed allows {allowed:.2f})",
        )

    def _fits_worse(self, fitted: Fitted, good: Fitted | None) -> Failure | None:
        if good is None or fitted.score - good.score <= self.tuning.score_rise:
            return None
        return Failure(
            "worse_fit",
            f"the disagreement with the input went from {good.score:.2f} to {fitted.score:.2f} "
            f"(score_rise allows {self.tuning.score_rise:.2f})",
        )

    def _unsure(self, fitted: Fitted) -> Failure | None:
        confidence = fit_confidence(fitted.score)
        if confidence >= self.min_confidence:
            return None
        return Failure(
            "low_confidence",
            f"confidence {confidence:.2f} is below min_confidence {self.min_confidence:.2f}",
        )


def bone_lengths(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the lengths of the 18 bones (m) of joints (19, 3)."""
    start, end = np.array(BONES).T
    return lengths_of(positions[end] - positions[start])


def limit_excess(body: Body, fitted: Fitted) -> NDArray[np.float64]:
    """Compute the excess of each anatomical angle over its limit, degrees, (47,); 0 for those not judged.

    The twist of upper arm and thigh is fitted from the limb's skin alone and is often wrong while all joints
    are right. If elbow or knee are bent, their plane determines the twist, so it is taken from there: a knee
    that bends forward shows as a thigh that is twisted too far.
    """
    nodes, pose = fitted.nodes, fitted.pose
    rotations = pose_from_nodes(body, pose.rotations, nodes, pose.scale).rotations
    rotations = rotations[0].T @ rotations  # relative to the pelvis: the camera may be mounted at any tilt
    for upper, lower, end, rest_to_hanging, forward in _HINGES:
        frame = rotations[upper] @ rest_to_hanging.T
        bone = body.nodes[end] - body.nodes[lower]
        x, _, z = frame.T @ rotations[lower] @ (bone / length_of(bone)) * forward
        if np.hypot(x, z) > _BENT:
            rotations[upper] = frame @ rotation_y(np.arctan2(x, z)) @ rest_to_hanging
    return excess_of(rotations)


def excess_of(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the excess (47,) over the limits, degrees, for rotations (21, 3, 3) relative to the pelvis."""
    excess = np.empty(len(ANGLES))
    kernels.limit_excess(np.ascontiguousarray(rotations), *_LIMB_REST, excess)
    return excess
