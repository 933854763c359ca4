"""Retarget recorded motion to the project's skeleton by the directions of its bones.

Every limb segment takes the direction of the recorded one, so that hands and feet are placed as recorded, up
to the bone lengths, which stay the body's own. The twist of a limb comes from the plane of the bent elbow or
knee, else from the recorded rotation. Trunk, head, clavicles and feet take the recorded rotations, against a
rest pose that stands upright.

Limits are set by hand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.angles import HANG, SHANK_M, THIGH_M, angles_from_rotations
from depth_pose.body.joint_names import find_joints, joints_between
from depth_pose.body.limits import violation
from depth_pose.body.source_motion import SourceMotion
from depth_pose.core.errors import InputError
from depth_pose.core.rotations import mirror_rotation, nearest_rotation, rotation_between, unit_vectors
from depth_pose.core.skeleton import NODE_INDEX, rest_nodes
from depth_pose.motion.clip import Clip
from depth_pose.motion.contact import pelvis_height

Array = NDArray[np.float64]

_FLIP = np.array([-1.0, 1.0, 1.0])
"""Turns points of the right side into those of the left."""
_BENT_DEG = (12.0, 35.0)
"""Flexions (degrees) between which the weight of the hinge's plane rises from 0 to 1."""
_STRAIGHT_DEG = (170.0, 178.0)
"""Flexions (degrees) between which the weight of a folded limb's plane falls from 1 to 0."""
_BACKWARD_DEG = 110.0
"""Maximum twist to the hinge's plane (degrees): more is noise of a straight limb or a loose marker."""
_SPINE_PART = (0.324, 0.824)
"""Interval of our spine segment between the pelvis (0) and the height of the shoulders (1) (`rest_nodes`)."""
_NECK_PART = (0.63, 1.0)
"""Interval of our neck segment between the chest (0) and the head (1) (`rest_nodes`)."""
_LEG_M = 0.83
"""Distance from hip to ankle of an adult (m), from which a file's unit is inferred."""
_SNAP_DEG = 35.0
"""Maximum angle (degrees) at which an axis of a rest pose snaps to a coordinate axis."""
_SHORTEST_LIMB = 0.2
"""Minimum ratio of the shortest to the longest part of a limb in a human skeleton."""
_LEAST_UPRIGHT = 0.2
"""Minimum median vertical component of the trunk's direction; below it, a motion is never upright."""
_FLAT_DEG = 30.0
"""Maximum angle (degrees) between two rest poses' feet if both stand flat."""
_NO_LIFT_M = 0.03
"""Maximum height (m) of a standing foot above its lowest 5 %: the markers' noise."""
_UNITS = {"metres": 1.0, "centimetres": 0.01, "inches": 0.0254, "millimetres": 0.001}
"""Metres in each unit that a file may be in."""


@dataclass(frozen=True)
class Retargeted:
    """A recorded motion on our skeleton.

    Attributes
    ----------
    clip : Clip
    unit : str
        The file's unit of length, guessed from the leg's length.
    violation_deg : (T,) float64
        How far the worst joint of each frame lies beyond our joint limits.
    """

    clip: Clip
    unit: str
    violation_deg: Array


def retarget(source: SourceMotion) -> Retargeted:
    """Retarget a recorded motion to the project's skeleton.

    Parameters
    ----------
    source : SourceMotion

    Returns
    -------
    Retargeted
        Its clip keeps the recording's rate; lengths are those of the 1.75 m reference body.

    Raises
    ------
    InputError
        If a joint is missing, a bone has no length, the rest pose is not a standing person, or the
        motion is never upright.
    """
    joint = find_joints(source)
    rest = source.rest_positions()
    to_model = _rest_axes(source.name, rest, joint)
    leg = _leg_length(source.name, rest, joint)
    unit = min(_UNITS, key=lambda name: abs(np.log(leg * _UNITS[name] / _LEG_M)))
    place = source.positions() @ to_model.T
    turn = to_model @ source.rotations @ to_model.T
    rotations = _segments(source, joint, rest @ to_model.T, place, turn)
    up = rotations[:, 2, 1, 1]
    if np.median(up) < _LEAST_UPRIGHT:
        raise InputError(
            f"{source.name}: the trunk is hardly ever upright; do motion and rest pose have the same up axis?"
        )
    roots = _roots(rotations, place, joint, (THIGH_M + SHANK_M) / leg)
    clip = Clip(source.name, source.fps, rotations, roots)
    own = np.swapaxes(rotations[:, :1], -1, -2) @ rotations  # a lying person is not bent
    return Retargeted(clip, unit, violation(angles_from_rotations(own)).max(axis=-1))


def _rest_axes(name: str, rest: Array, joint: dict[str, int]) -> Array:
    """Rotation from the file's axes to the model's: x to the person's left, y up."""
    left = rest[joint["left_hip"]] - rest[joint["right_hip"]]
    up = rest[joint["head"]] - (rest[joint["left_knee"]] + rest[joint["right_knee"]]) / 2
    up, left = _snap(up), _snap(left)
    if not (abs(up @ left) <= 0.5 and left.any() and up.any()):
        raise InputError(f"{name}: the rest pose is not a standing person (hips {left}, up {up})")
    left = left - (left @ up) * up
    left /= np.linalg.norm(left)
    return np.stack([left, up, np.cross(left, up)])


def _snap(direction: Array) -> Array:
    """Return the unit vector, snapped to a near coordinate axis."""
    size = np.linalg.norm(direction)
    if size == 0:
        return np.zeros(3)
    unit = direction / size
    axis = int(np.argmax(np.abs(unit)))
    if abs(unit[axis]) < np.cos(np.radians(_SNAP_DEG)):
        return np.asarray(unit)
    return np.asarray(np.sign(unit[axis]) * np.eye(3)[axis])


def _leg_length(name: str, rest: Array, joint: dict[str, int]) -> float:
    pieces = (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"))
    lengths = {}
    for side in ("left", "right"):
        for a, b in pieces:
            lengths[f"{side} {a} to {b}"] = float(
                np.linalg.norm(rest[joint[f"{side}_{a}"]] - rest[joint[f"{side}_{b}"]])
            )
    longest = max(lengths.values())
    for what, length in lengths.items():
        if not length > _SHORTEST_LIMB * longest:
            raise InputError(
                f"{name}: {what} is {length:.4g} long, the longest limb {longest:.4g}: not a person"
            )
    legs = [length for what, length in lengths.items() if "hip" in what or "ankle" in what]
    return sum(legs) / 2


def _segments(source: SourceMotion, joint: dict[str, int], rest: Array, place: Array, turn: Array) -> Array:
    out = np.empty((len(place), 21, 3, 3))
    pelvis, chest, head = (turn[:, joint[name]] for name in ("pelvis", "chest", "head"))
    out[:, 0], out[:, 2], out[:, 4] = pelvis, chest, head
    shoulders = (rest[joint["left_shoulder"], 1] + rest[joint["right_shoulder"], 1]) / 2
    out[:, 1] = _piece(source, rest[:, 1], turn, (joint["pelvis"], joint["chest"]), shoulders, _SPINE_PART)
    ends = joint["chest"], joint["head"]
    out[:, 3] = _piece(source, rest[:, 1], turn, ends, rest[joint["head"], 1], _NECK_PART)
    for side in ("left", "right"):
        mine = {n.removeprefix(f"{side}_"): j for n, j in joint.items() if n.startswith(side)}
        flip = side == "right"
        at = {n: _mirrored(place[:, j], flip) for n, j in mine.items()}
        at_rest = {n: _mirrored(rest[j], flip) for n, j in mine.items()}
        turns = {n: _mirrored_turn(turn[:, j], flip) for n, j in mine.items()}
        turns["chest"] = _mirrored_turn(chest, flip)
        for node, rotation in (_arm(at, at_rest, turns) | _leg(at, at_rest, turns)).items():
            out[:, NODE_INDEX[f"{side}_{node}"]] = _mirrored_turn(rotation, flip)
    return out


def _mirrored(points: Array, flip: bool) -> Array:
    return points * _FLIP if flip else points


def _mirrored_turn(rotations: Array, flip: bool) -> Array:
    return mirror_rotation(rotations) if flip else rotations


def _piece(
    source: SourceMotion,
    height: Array,
    turn: Array,
    ends: tuple[int, int],
    top: float,
    part: tuple[float, float],
) -> Array:
    """Return the rotation of a part of the trunk: the mean of the recorded segments beside it, by length.

    ``part`` is its interval between the first of ``ends`` (0) and the height ``top`` (1).
    """
    chain = [ends[0], *joints_between(source, *ends), ends[1]]
    starts = (height[chain] - height[ends[0]]) / (top - height[ends[0]])
    stops = np.append(starts[1:], max(1.0, starts[-1]))
    share = np.maximum(np.minimum(stops, part[1]) - np.maximum(starts, part[0]), 0.0)
    if not share.sum() > 1e-6:
        share = np.ones(len(chain))
    return nearest_rotation(np.einsum("j,tjab->tab", share, turn[:, chain]))


def _aimed(rest_direction: Array, turn: Array, direction: Array) -> Array:
    """Rotation from the hanging pose to the given direction of -y, with the recorded twist."""
    rest_to_source = rotation_between(np.array([0.0, -1.0, 0.0]), unit_vectors(rest_direction))
    carried = turn @ rest_to_source
    return rotation_between(-carried[..., :, 1], direction) @ carried


def _hinged(first: Array, second: Array, sign: float) -> Array:
    """Twist a limb's first segment so that its hinge (x) is perpendicular to the plane of both.

    ``sign`` is -1 for an elbow (folds about -x) and 1 for a knee. Nearly straight limbs keep
    the twist that they have.
    """
    u, v = -first[..., :, 1], second
    axis = sign * np.cross(u, v)
    sine = np.linalg.norm(axis, axis=-1)
    flexion = np.degrees(np.arctan2(sine, np.sum(u * v, axis=-1)))
    low, high = _BENT_DEG
    first_less, none = _STRAIGHT_DEG
    weight = np.clip((flexion - low) / (high - low), 0, 1)
    weight *= np.clip((none - flexion) / (none - first_less), 0, 1)
    axis = axis / np.maximum(sine, 1e-9)[..., None]
    x, z = first[..., :, 0], first[..., :, 2]
    angle = np.arctan2(-np.sum(axis * z, axis=-1), np.sum(axis * x, axis=-1))
    angle = np.where(np.abs(angle) > np.radians(_BACKWARD_DEG), 0.0, angle) * weight
    c, s = np.cos(angle)[..., None], np.sin(angle)[..., None]
    return np.stack([c * x - s * z, first[..., :, 1], s * x + c * z], axis=-1)


def _arm(at: dict[str, Array], rest: dict[str, Array], turn: dict[str, Array]) -> dict[str, Array]:
    upper_rest, fore_rest = rest["elbow"] - rest["shoulder"], rest["wrist"] - rest["elbow"]
    fore_direction = unit_vectors(at["wrist"] - at["elbow"])
    upper = _aimed(upper_rest, turn["shoulder"], unit_vectors(at["elbow"] - at["shoulder"]))
    upper = _hinged(upper, fore_direction, -1.0)
    fore = _aimed(fore_rest, turn["elbow"], fore_direction)
    hand = turn["wrist"] @ rotation_between(np.array([0.0, -1.0, 0.0]), unit_vectors(fore_rest))
    return {
        "clavicle": turn.get("clavicle", turn["chest"]),
        "shoulder": upper @ HANG["shoulder"],
        "elbow": fore @ HANG["elbow"],
        "wrist": hand @ HANG["wrist"],
    }


def _leg(at: dict[str, Array], rest: dict[str, Array], turn: dict[str, Array]) -> dict[str, Array]:
    shank_direction = unit_vectors(at["ankle"] - at["knee"])
    thigh = _aimed(rest["knee"] - rest["hip"], turn["hip"], unit_vectors(at["knee"] - at["hip"]))
    thigh = _hinged(thigh, shank_direction, 1.0)
    shank = rotation_between(-thigh[..., :, 1], shank_direction) @ thigh
    foot = _foot(rest, turn["ankle"])
    return {"hip": thigh @ HANG["hip"], "knee": shank @ HANG["knee"], "ankle": foot, "foot": foot}


def _foot(rest: dict[str, Array], turn: Array) -> Array:
    if "toe" not in rest:
        return turn
    ours = rest_nodes()
    ours_direction = unit_vectors(ours[NODE_INDEX["left_foot"]] - ours[NODE_INDEX["left_ankle"]])
    theirs = unit_vectors(rest["toe"] - rest["ankle"])
    if theirs @ ours_direction > np.cos(np.radians(_FLAT_DEG)):
        # Both rest poses have the feet flat on the floor; their slopes differ with the ankles' heights.
        yaw = rotation_between(_level(ours_direction), _level(theirs))
        return turn @ yaw
    return turn @ rotation_between(ours_direction, theirs)


def _level(direction: Array) -> Array:
    return unit_vectors(direction * np.array([1.0, 0.0, 1.0]))


def _roots(rotations: Array, place: Array, joint: dict[str, int], scale: float) -> Array:
    """Return the pelvis' path: the recorded one, scaled to our legs, with the feet as high as recorded."""
    feet = [joint[n] for n in ("left_ankle", "right_ankle", "left_toe", "right_toe") if n in joint]
    lowest = scale * place[:, feet, 1].min(axis=1)
    lift = np.maximum(lowest - np.percentile(lowest, 5) - _NO_LIFT_M, 0.0)
    middle = scale * (place[:, joint["left_hip"]] + place[:, joint["right_hip"]]) / 2
    roots = middle - middle[0]
    roots[:, 1] = pelvis_height(rotations) + lift
    return np.asarray(roots)
