"""Definitions of the joint angles, after the ISB's recommendations.

G. Wu et al., *ISB recommendation on definitions of joint coordinate system of various joints for the
reporting of human joint motion*, part I: ankle, hip, and spine, J. Biomech. 35, 2002, and part II: shoulder,
elbow, wrist and hand, J. Biomech. 38, 2005; hip and knee as E. S. Grood and W. J. Suntay, J. Biomech. Eng.
105, 1983. Angles are degrees, 0 for somebody who stands upright with hanging arms, and the same on both
sides of the body:

* trunk: *flexion* (forward) and *side* (to the left) of the line from pelvis to neck against the vertical,
  and *rotation* of the thorax against the pelvis (to the left);
* pelvis against the vertical: *tilt* forward, *obliquity* (left side up);
* neck: *flexion* and *side* of the line from neck to head against the thorax;
* hip: *flexion*, *abduction* and internal *rotation* (the sequence z, x, y of the femur in the pelvis);
* knee *flexion*; *dorsiflexion* of the ankle, the shank against the line from ankle to toe base;
* shoulder (humerus in the thorax, the sequence y, x, y): *plane* of elevation (0 abduction, 90 forward) and
  *elevation*; internal *rotation* is the sum of the two turns about y, which a hanging arm does not mix up;
* elbow *flexion*.

The axes of pelvis and thorax are the skeleton's rotations, all else its joint centres.

Pronation, the wrists, inversion of the feet and turns of shank and head are twists about a bone, or smaller
than what a depth image of a whole person resolves; they are left out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.angles import relative, trunk_angles
from depth_pose.core.rotations import rotation_between, rotation_x, rotation_z, unit_vectors
from depth_pose.core.skeleton import JOINT_INDEX, NODE_INDEX, rest_nodes

Array = NDArray[np.float64]

_BODY = (
    *("trunk_flexion", "trunk_side", "trunk_rotation", "pelvis_tilt", "pelvis_obliquity"),
    *("neck_flexion", "neck_side"),
)
_LIMBS = (
    *("hip_flexion", "hip_abduction", "hip_rotation", "knee_flexion", "ankle_dorsiflexion"),
    *("shoulder_plane", "shoulder_elevation", "shoulder_rotation", "elbow_flexion"),
)
JOINT_ANGLES: tuple[str, ...] = (*_BODY, *(f"{side}_{name}" for side in ("left", "right") for name in _LIMBS))
"""Names of the joint angles, in the order of every (..., 25) array."""

JOINT_ANGLE_INDEX: dict[str, int] = {name: i for i, name in enumerate(JOINT_ANGLES)}

AGAINST_VERTICAL: tuple[str, ...] = ("trunk_flexion", "trunk_side", "pelvis_tilt", "pelvis_obliquity")
"""Angles that need to know where up is."""

_HINGE_DEG = 45.0
"""Maximum rotation of the hip (degrees) at which a bend counts as the knee's flexion; beyond it only the
component in this direction counts, so that a straight knee is not bent by noise. About the range of the
hip."""

_FLIP = np.array([-1.0, 1.0, 1.0])
_DOWN = np.array([0.0, -1.0, 0.0])


def _rest_angles() -> tuple[float, float]:
    """Forward slope of the line from neck to head, and the angle of foot and shank, standing, degrees."""
    at = rest_nodes()
    head = at[NODE_INDEX["head"]] - at[NODE_INDEX["neck"]]
    foot = at[NODE_INDEX["left_foot"]] - at[NODE_INDEX["left_ankle"]]
    return (
        float(np.degrees(np.arctan2(head[2], head[1]))),
        float(np.degrees(np.arccos(foot[1] / np.linalg.norm(foot)))),
    )


_NECK_DEG, _FOOT_DEG = _rest_angles()


def axes_of_joints(at: Array) -> tuple[Array, Array]:
    """Axes of pelvis and thorax by joint centres alone: left, up, forward as columns, (..., 3, 3)."""

    def joint(name: str) -> Array:
        return np.asarray(at[..., JOINT_INDEX[name], :])

    pelvis = _axes(joint("spine") - joint("pelvis"), joint("left_hip") - joint("right_hip"), "left")
    thorax = _axes(joint("neck") - joint("spine"), joint("left_shoulder") - joint("right_shoulder"), "up")
    return pelvis, thorax


def _axes(up: Array, left: Array, kept: str) -> Array:
    """Axes (..., 3, 3), left, up and forward, that keep the direction of ``up`` or of ``left``."""
    up, left = unit_vectors(up), unit_vectors(left)
    along = np.sum(up * left, axis=-1, keepdims=True)
    if kept == "up":
        left = unit_vectors(left - along * up)
    else:
        up = unit_vectors(up - along * left)
    return np.stack([left, up, np.cross(left, up)], axis=-1)


def angles_of(at: Array, pelvis: Array, thorax: Array, up: Array) -> Array:
    """Joint angles of joint centres and the axes of pelvis and thorax: the definition.

    Parameters
    ----------
    at : (..., 19, 3)
        Joint centres, metres.
    pelvis, thorax : (..., 3, 3)
        Their axes as columns: to the left, up, forward.
    up : (3,)
        Direction of up.

    Returns
    -------
    (..., 25) float64
        Degrees, in the order of `JOINT_ANGLES`.
    """

    def bone(start: str, end: str) -> Array:
        return unit_vectors(at[..., JOINT_INDEX[end], :] - at[..., JOINT_INDEX[start], :])

    def inside(axes: Array, vector: Array) -> Array:
        return np.einsum("...ji,...j->...i", axes, vector)

    vertical = np.broadcast_to(up, at.shape[:-2] + (3,))
    level = _axes(vertical, pelvis[..., :, 0] + thorax[..., :, 0], "up")
    trunk = inside(level, bone("pelvis", "neck"))
    tilt = trunk_angles(relative(_axes(vertical, pelvis[..., :, 0], "up"), pelvis))[..., 0]
    neck = inside(thorax, bone("neck", "head"))
    parts = [
        _deg(trunk[..., 2], trunk[..., 1]),
        _asin(trunk[..., 0]),
        trunk_angles(relative(pelvis, thorax))[..., 2],
        tilt,
        90.0 - _between(pelvis[..., :, 0], vertical),
        _deg(neck[..., 2], neck[..., 1]) - _NECK_DEG,
        _asin(neck[..., 0]),
    ]
    for side in ("left", "right"):
        flip = 1.0 if side == "left" else _FLIP
        thigh, shank = (
            flip * inside(pelvis, bone(f"{side}_{a}", f"{side}_{b}"))
            for a, b in (("hip", "knee"), ("knee", "ankle"))
        )
        upper, fore = (
            flip * inside(thorax, bone(f"{side}_{a}", f"{side}_{b}"))
            for a, b in (("shoulder", "elbow"), ("elbow", "wrist"))
        )
        foot = _between(bone(f"{side}_ankle", f"{side}_knee"), bone(f"{side}_ankle", f"{side}_foot"))
        parts += [*_leg_angles(thigh, shank), _FOOT_DEG - foot, *_arm_angles(upper, fore)]
    return np.stack(parts, axis=-1)


def _leg_angles(thigh: Array, shank: Array) -> tuple[Array, Array, Array, Array]:
    """Hip flexion, abduction, rotation and knee flexion of directions in the pelvis, left side."""
    flexion = np.arctan2(thigh[..., 2], -thigh[..., 1])
    abduction = np.radians(_asin(thigh[..., 0]))
    unrotated = rotation_x(-flexion) @ rotation_z(abduction)
    bend = np.einsum("...ji,...j->...i", unrotated, shank)
    rotation = np.arctan2(bend[..., 0], -bend[..., 2])
    hinge = np.clip(rotation, *np.radians([-_HINGE_DEG, _HINGE_DEG]))
    back = bend[..., 0] * np.sin(hinge) - bend[..., 2] * np.cos(hinge)
    return np.degrees(flexion), np.degrees(abduction), np.degrees(rotation), _deg(back, -bend[..., 1])


def _arm_angles(upper: Array, fore: Array) -> tuple[Array, Array, Array, Array]:
    """Plane of elevation, elevation, rotation and elbow flexion of directions in the thorax, left side."""
    swing = rotation_between(np.broadcast_to(_DOWN, upper.shape), upper)
    bend = np.einsum("...ji,...j->...i", swing, fore)
    return (
        _deg(upper[..., 2], upper[..., 0]),
        _between(upper, np.broadcast_to(_DOWN, upper.shape)),
        _deg(-bend[..., 0], bend[..., 2]),
        _deg(np.hypot(bend[..., 0], bend[..., 2]), -bend[..., 1]),
    )


def _deg(sine: Array, cosine: Array) -> Array:
    return np.asarray(np.degrees(np.arctan2(sine, cosine)))


def _asin(part: Array) -> Array:
    return np.asarray(np.degrees(np.arcsin(np.clip(part, -1.0, 1.0))))


def _between(a: Array, b: Array) -> Array:
    """Angle between unit vectors, degrees, accurate at all angles."""
    return _deg(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1))
