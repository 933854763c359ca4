"""Anatomical joint angles, and their conversion to the segment rotations of the skeleton.

The anatomical zero is the standing posture with arms and legs hanging vertically, palms to
the thighs, feet forward. In that posture every limb segment points along -y, the elbow bends
forward and the knee backward. Angles are degrees, named as a clinician names them:

* trunk (pelvis against the world; spine, chest, neck and head against their parents):
  *flexion* forward, *side* bend to the left, *twist* to the left; ``Ry(twist) Rx(flexion)
  Rz(-side)``;
* clavicle: *elevation* and *protraction* against the chest;
* shoulder (against the chest, that is humero-thoracic) and hip: the swing of the limb from
  hanging to its direction is the rotation vector with components *flexion* (about -x) and
  *abduction* (about z, outward), after an internal *twist* about the limb. It is the
  swing-twist form of the plane/elevation/axial sequence that the ISB recommends (G. Wu et
  al., *ISB recommendation ... Part II: shoulder, elbow, wrist and hand*, J. Biomech. 38,
  2005), without its singularity at the hanging arm;
* elbow *flexion* and forearm *pronation*; wrist *flexion* (to the palm) and *deviation*
  (to the thumb);
* knee *flexion*; ankle *dorsiflexion*, *inversion* and *toe-out* (with the tibia's torsion).

Right limbs are the mirror images of left ones, so equal angles are symmetric postures.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.rotations import (
    cross_matrix,
    mirror_rotation,
    rotation_between,
    rotation_x,
    rotation_y,
    rotation_z,
)
from depth_pose.core.skeleton import ADULT_STATURE_M, NODE_INDEX, rest_nodes

Array = NDArray[np.float64]

_TRUNK_NAMES = tuple(
    f"{part}_{angle}"
    for part in ("pelvis", "spine", "chest", "neck", "head")
    for angle in ("flexion", "side", "twist")
)
ARM_ANGLES = (
    "clavicle_elevation",
    "clavicle_protraction",
    "shoulder_flexion",
    "shoulder_abduction",
    "shoulder_twist",
    "elbow_flexion",
    "forearm_pronation",
    "wrist_flexion",
    "wrist_deviation",
)
LEG_ANGLES = (
    "hip_flexion",
    "hip_abduction",
    "hip_twist",
    "knee_flexion",
    "ankle_dorsiflexion",
    "ankle_inversion",
    "ankle_toe_out",
)
ANGLES: tuple[str, ...] = _TRUNK_NAMES + tuple(
    f"{side}_{name}" for names in (ARM_ANGLES, LEG_ANGLES) for side in ("left", "right") for name in names
)
"""Names of the columns of every (..., 47) array of angles, degrees."""

ANGLE_INDEX: dict[str, int] = {name: i for i, name in enumerate(ANGLES)}
N_ANGLES = len(ANGLES)
TRUNK = slice(0, 15)
"""Columns of pelvis, spine, chest, neck and head."""
ARM = (slice(15, 24), slice(24, 33))
"""Columns of the left and of the right arm."""
LEG = (slice(33, 40), slice(40, 47))
"""Columns of the left and of the right leg."""

SIDES = ("left", "right")


_DOWN = np.array([0.0, -1.0, 0.0])
"""Where a hanging limb points, model frame."""


def _hang_rotations() -> dict[str, Array]:
    """Rotation from each left limb segment's rest direction to hanging."""
    at = rest_nodes()
    ends = {
        "shoulder": ("left_shoulder", "left_elbow"),
        "elbow": ("left_elbow", "left_wrist"),
        "wrist": ("left_elbow", "left_wrist"),
        "hip": ("left_hip", "left_knee"),
        "knee": ("left_knee", "left_ankle"),
    }
    out = {}
    for name, (start, end) in ends.items():
        bone = at[NODE_INDEX[end]] - at[NODE_INDEX[start]]
        out[name] = rotation_between(bone / np.linalg.norm(bone), _DOWN)
    return out


HANG: dict[str, Array] = _hang_rotations()
"""For the left shoulder, elbow, wrist, hip and knee: rotation of the segment from rest to hanging."""

_AT = rest_nodes() * ADULT_STATURE_M
"""Nodes at rest of the 1.75 m body, (21, 3), metres."""


def _length(start: str, end: str) -> float:
    return float(np.linalg.norm(_AT[NODE_INDEX[end]] - _AT[NODE_INDEX[start]]))


UPPER_ARM_M = _length("left_shoulder", "left_elbow")
"""Shoulder to elbow of the 1.75 m body."""
FOREARM_M = _length("left_elbow", "left_wrist")
"""Elbow to wrist."""
THIGH_M = _length("left_hip", "left_knee")
"""Hip to knee."""
SHANK_M = _length("left_knee", "left_ankle")
"""Knee to ankle."""


def trunk_rotation(flexion: Array, side: Array, twist: Array) -> Array:
    """Rotations ``Ry(twist) Rx(flexion) Rz(-side)`` of angles in degrees, (...) to (..., 3, 3)."""
    f, s, t = (np.radians(a) for a in (flexion, side, twist))
    return rotation_y(t) @ rotation_x(f) @ rotation_z(-s)


def swing_twist_rotation(flexion: Array, abduction: Array, twist: Array) -> Array:
    """Rotation of a left limb from hanging, of angles in degrees, (...) to (..., 3, 3)."""
    f, a = np.radians(flexion), np.radians(abduction)
    size = np.sqrt(f * f + a * a)
    sinc = np.sinc(size / np.pi)
    half = np.sinc(size / (2 * np.pi)) ** 2 / 2
    k = cross_matrix(-f, np.zeros_like(size), a)
    swing = np.eye(3) + sinc[..., None, None] * k + half[..., None, None] * (k @ k)
    return np.asarray(swing @ rotation_y(-np.radians(twist)))


def rotations_from_angles(angles: Array) -> Array:
    """Segment rotations of postures given as anatomical angles.

    Parameters
    ----------
    angles : (..., 47)
        Degrees, in the order of `ANGLES`.

    Returns
    -------
    (..., 21, 3, 3) float64
        Rotation of each node's segment, rest pose to model frame.
    """
    angles = np.asarray(angles, dtype=np.float64)
    out = np.empty((*angles.shape[:-1], 21, 3, 3))
    parent = np.broadcast_to(np.eye(3), (*angles.shape[:-1], 3, 3))
    for i in range(5):
        f, s, t = (angles[..., 3 * i + k] for k in range(3))
        parent = parent @ trunk_rotation(f, s, t)
        out[..., i, :, :] = parent
    for side, name in enumerate(SIDES):
        pelvis, chest = out[..., 0, :, :], out[..., 2, :, :]
        if side == 1:
            pelvis, chest = mirror_rotation(pelvis), mirror_rotation(chest)
        limbs = _arm_rotations(angles[..., ARM[side]], chest) | _leg_rotations(angles[..., LEG[side]], pelvis)
        for node, rotation in limbs.items():
            out[..., NODE_INDEX[f"{name}_{node}"], :, :] = (
                rotation if side == 0 else mirror_rotation(rotation)
            )
    return out


def _arm_rotations(a: Array, chest: Array) -> dict[str, Array]:
    r = np.radians(a)
    clavicle = chest @ rotation_y(-r[..., 1]) @ rotation_z(r[..., 0])
    upper = chest @ swing_twist_rotation(a[..., 2], a[..., 3], a[..., 4])
    fore = upper @ rotation_x(-r[..., 5]) @ rotation_y(-r[..., 6])
    hand = fore @ rotation_z(-r[..., 7]) @ rotation_x(-r[..., 8])
    return {
        "clavicle": clavicle,
        "shoulder": upper @ HANG["shoulder"],
        "elbow": fore @ HANG["elbow"],
        "wrist": hand @ HANG["wrist"],
    }


def _leg_rotations(a: Array, pelvis: Array) -> dict[str, Array]:
    r = np.radians(a)
    thigh = pelvis @ swing_twist_rotation(a[..., 0], a[..., 1], a[..., 2])
    shank = thigh @ rotation_x(r[..., 3])
    foot = shank @ rotation_y(r[..., 6]) @ rotation_x(-r[..., 4]) @ rotation_z(-r[..., 5])
    return {"hip": thigh @ HANG["hip"], "knee": shank @ HANG["knee"], "ankle": foot, "foot": foot}


def angles_from_rotations(rotations: Array) -> Array:
    """Anatomical angles of given segment rotations, the inverse of `rotations_from_angles`.

    What the angles cannot express (a sideways bend or twist of elbow or knee, a roll of the
    clavicle) is left out.

    Parameters
    ----------
    rotations : (..., 21, 3, 3)
        Segment rotations, rest pose to model frame.

    Returns
    -------
    (..., 47) float64
        Degrees, in the order of `ANGLES`.
    """
    out = np.empty((*rotations.shape[:-3], N_ANGLES))
    parent = np.broadcast_to(np.eye(3), (*rotations.shape[:-3], 3, 3))
    for i in range(5):
        out[..., 3 * i : 3 * i + 3] = trunk_angles(relative(parent, rotations[..., i, :, :]))
        parent = rotations[..., i, :, :]
    left, right = (rotations[..., [NODE_INDEX[n] for n in _names(side)], :, :] for side in SIDES)
    both = np.stack([left, mirror_rotation(right)])
    get = {name: both[..., i, :, :] for i, name in enumerate(_LIMB_NODES)}
    for limb, angles in ((ARM, _arm_angles(get)), (LEG, _leg_angles(get))):
        out[..., limb[0]], out[..., limb[1]] = angles
    return out


_LIMB_NODES = ("pelvis", "chest", "clavicle", "shoulder", "elbow", "wrist", "hip", "knee", "ankle")


def _names(side: str) -> list[str]:
    """Name one side's limb nodes, after the two that both sides hang on."""
    return [n if n in ("pelvis", "chest") else f"{side}_{n}" for n in _LIMB_NODES]


def relative(parent: Array, child: Array) -> Array:
    """Rotation of a child against its parent, (..., 3, 3) each."""
    return np.swapaxes(parent, -1, -2) @ child


def trunk_angles(rotation: Array) -> Array:
    """Flexion, side bend and twist in degrees of (..., 3, 3) rotations, shape (..., 3)."""
    r = rotation
    flexion = np.arcsin(np.clip(-r[..., 1, 2], -1, 1))
    side = -np.arctan2(r[..., 1, 0], r[..., 1, 1])
    twist = np.arctan2(r[..., 0, 2], r[..., 2, 2])
    return np.asarray(np.degrees(np.stack([flexion, side, twist], axis=-1)))


def swing_twist_angles(rotation: Array) -> Array:
    """Flexion, abduction and internal twist in degrees of a left limb's rotation from hanging."""
    u = -rotation[..., :, 1]
    sine = np.hypot(u[..., 0], u[..., 2])
    angle = np.arctan2(sine, -u[..., 1])
    factor = np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 1.0)
    flexion, abduction = np.degrees(factor * u[..., 2]), np.degrees(factor * u[..., 0])
    swing = swing_twist_rotation(flexion, abduction, np.zeros_like(flexion))
    return np.stack([flexion, abduction, -_turn_about_y(relative(swing, rotation))], axis=-1)


def _turn_about_y(rotation: Array) -> Array:
    """Angle in degrees of the twist about y that a rotation contains."""
    r = rotation
    return np.degrees(np.arctan2(r[..., 0, 2] - r[..., 2, 0], r[..., 0, 0] + r[..., 2, 2]))


def _arm_angles(get: dict[str, Array]) -> Array:
    axis = relative(get["chest"], get["clavicle"])[..., :, 0]
    elevation = np.degrees(np.arcsin(np.clip(axis[..., 1], -1, 1)))
    protraction = np.degrees(np.arctan2(axis[..., 2], axis[..., 0]))
    upper, fore, hand = (get[n] @ HANG[n].T for n in ("shoulder", "elbow", "wrist"))
    shoulder = swing_twist_angles(relative(get["chest"], upper))
    elbow = relative(upper, fore)
    flexion = np.arctan2(-elbow[..., 2, 1], elbow[..., 1, 1])
    pronation = -_turn_about_y(rotation_x(flexion) @ elbow)
    u = -relative(fore, hand)[..., :, 1]
    wrist = np.degrees(np.arctan2(-u[..., 0], -u[..., 1])), np.degrees(np.arcsin(np.clip(u[..., 2], -1, 1)))
    parts = (elevation, protraction, *np.moveaxis(shoulder, -1, 0), np.degrees(flexion), pronation, *wrist)
    return np.stack(parts, axis=-1)


def _leg_angles(get: dict[str, Array]) -> Array:
    thigh, shank = get["hip"] @ HANG["hip"].T, get["knee"] @ HANG["knee"].T
    hip = swing_twist_angles(relative(get["pelvis"], thigh))
    knee = relative(thigh, shank)
    flexion = np.degrees(np.arctan2(knee[..., 2, 1], knee[..., 1, 1]))
    ankle = trunk_angles(relative(shank, get["ankle"]))
    parts = (*np.moveaxis(hip, -1, 0), flexion, -ankle[..., 0], ankle[..., 1], ankle[..., 2])
    return np.stack(parts, axis=-1)
