"""Shared parts of the posture samplers: gates, hands at given places, trunk and head."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.angles import ANGLE_INDEX, ARM, angles_from_rotations, rotations_from_angles
from depth_pose.body.limits import clamp_angles, clamp_rotations, violation, with_shoulder_rhythm
from depth_pose.core.skeleton import ADULT_STATURE_M, NODE_INDEX, forward_kinematics, rest_nodes
from depth_pose.motion.contact import Separated, separate_limbs
from depth_pose.motion.procedural.draw import Draw
from depth_pose.motion.reach import arm_to_target

Array = NDArray[np.float64]
Sampler = Callable[[Draw], Array]
"""Return (N, 47) anatomical angles, degrees, for a draw of N."""

REST_M: Array = rest_nodes() * ADULT_STATURE_M
"""Rest nodes of the reference body (m); positions below refer to it."""

DEEPEST_M = 0.03
"""Maximum remaining penetration of a limb (m), as in the motion generator."""
MOST_STRAINED_DEG = 15.0
"""Maximum remaining violation of a joint limit (degrees), as in the motion generator."""

_FLIP = np.array([-1.0, 1.0, 1.0])
"""Factor that mirrors a position left to right."""


@dataclass(frozen=True)
class Kind:
    """One way to take a posture.

    Attributes
    ----------
    doing : str
        What the person does; decides what may be in their hands.
    weight : float
        How often, relative to the posture's other kinds.
    angles : Sampler
    turn : callable, optional
        Returns (N, 3, 3) rotations of the whole body, for lying postures.
    raised : bool
        Whether it needs a chair, sofa or stool.
    """

    doing: str
    weight: float
    angles: Sampler
    turn: Callable[[Draw], Array] | None = None
    raised: bool = False


def bring_through_gates(angles: Array) -> Separated:
    """Clamp to the joint limits with the shoulder's rhythm and separate the limbs, twice."""
    first = separate_limbs(rotations_from_angles(clamp_angles(with_shoulder_rhythm(clamp_angles(angles)))))
    return separate_limbs(clamp_rotations(first.rotations))


def through_gates(angles: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Move angles into the joint limits and limbs out of the body.

    Parameters
    ----------
    angles : (N, 47)
        Degrees; the clavicles' are added to the shoulder's rhythm.

    Returns
    -------
    angles : (N, 47) float64
    fine : (N,) bool
        Whether limbs could be brought out of the body within the limits.
    """
    apart = bring_through_gates(angles)
    out = angles_from_rotations(apart.rotations)
    fine = (apart.depth < DEEPEST_M) & (violation(out).max(axis=-1) < MOST_STRAINED_DEG)
    return clamp_angles(out), fine


def hands_at(angles: Array, left: Array | None, right: Array | None, poles: Array) -> Array:
    """Move the wrists of postures to places.

    Parameters
    ----------
    angles : (N, 47)
        Degrees; the arms' angles but pronation and wrist are replaced.
    left, right : (N, 3) or None
        Where the wrists go, relative to the pelvis, axes of the model frame, metres on the
        reference body; None leaves that arm alone.
    poles : (N, 3)
        Direction to which a left elbow points, in the chest's frame.

    Returns
    -------
    (N, 47) float64
    """
    rotations = rotations_from_angles(angles)
    nodes = forward_kinematics(rotations, np.zeros(3), REST_M)
    chest = rotations[:, NODE_INDEX["chest"]]
    out = angles.copy()
    for side, (name, target) in enumerate((("left", left), ("right", right))):
        if target is None:
            continue
        local = np.einsum("nji,nj->ni", chest, target - nodes[:, NODE_INDEX[f"{name}_shoulder"]])
        arm = arm_to_target(local if side == 0 else local * _FLIP, poles)
        out[:, ARM[side].start + 2 : ARM[side].start + 6] = arm[:, 2:6]
    return out


def set_angles(angles: Array, values: dict[str, Array | float]) -> Array:
    """Set columns of (N, 47) angles by name; ``both_`` stands for left and right."""
    out = angles.copy()
    for name, value in values.items():
        if name.startswith("both_"):
            bare = name.removeprefix("both_")
            out[:, ANGLE_INDEX[f"left_{bare}"]] = value
            out[:, ANGLE_INDEX[f"right_{bare}"]] = value
        else:
            out[:, ANGLE_INDEX[name]] = value
    return out


def bow(draw: Draw, flexion: Array, side: Array | float = 0.0, twist: Array | float = 0.0) -> Array:
    """Spine and chest angles (N, 47) that share a bend of the trunk, with a free head."""
    out = np.zeros((*draw.shape, 47))
    for i, share in ((1, 0.55), (2, 0.45)):
        out[:, 3 * i] = share * flexion
        out[:, 3 * i + 1] = share * side
        out[:, 3 * i + 2] = share * twist
    return out + free_head(draw)


def free_head(draw: Draw) -> Array:
    """Draw a gaze in any direction: angles of neck and head, (N, 47), all others zero."""
    out = np.zeros((*draw.shape, 47))
    look, down, tilt = draw.normal(0, 24.0), draw.normal(2, 10.0), draw.normal(0, 6)
    for i, share in ((3, 0.45), (4, 0.55)):
        out[:, 3 * i], out[:, 3 * i + 1], out[:, 3 * i + 2] = share * down, share * tilt, share * look
    return out


def level_gaze(angles: Array, draw: Draw) -> Array:
    """Rotate neck and head back by a share of the trunk's bend, so that the person looks ahead."""
    out = angles.copy()
    back = 0.8 * draw.uniform(0.5, 1.1) * angles[:, [0, 3, 6]].sum(axis=1)
    out[:, 9] -= 0.5 * back
    out[:, 12] -= 0.5 * back
    return out


def support_hands(draw: Draw) -> dict[str, Array | float]:
    """Lay the hands flat on a surface below them."""
    return {
        "both_forearm_pronation": draw.normal(65, 12),
        "both_wrist_flexion": draw.normal(-70, 7),
    }
