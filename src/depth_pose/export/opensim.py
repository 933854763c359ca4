r"""Writers of OpenSim's motions (.mot) and orientations (.sto).

Formats: *Motion (.mot) Files*, *Storage (.sto) Files* and *OpenSense*, OpenSim documentation
(simtk-confluence.stanford.edu). Both are tables with a header; columns are separated by tabs.

A ``.mot`` has the coordinates of the full-body model of A. Rajagopal et al., *Full-body musculoskeletal
model for muscle-driven simulation of human gait*, IEEE Trans. Biomed. Eng. 63, 2016, in degrees and metres,
in OpenSim's ground (x forward, y up, z to the right). A ``.sto`` has the rotations of segments as
quaternions, columns named as those of its inertial sensors, for OpenSense's inverse kinematics.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.angle_definitions import JOINT_ANGLE_INDEX
from depth_pose.body.angles import relative, swing_twist_rotation, trunk_angles
from depth_pose.body.joint_angles import measure_angles
from depth_pose.core.rotations import quat_to_matrix, rotation_x, rotation_z
from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.export.tracks import Track

Array = NDArray[np.float64]

_UP = np.array([0.0, 1.0, 0.0])
_SIDES = (("left", "l"), ("right", "r"))

_SEGMENTS = {
    "pelvis_imu": "pelvis", "torso_imu": "chest", "head_imu": "head",
    **{f"{part}_{s}_imu": f"{side}_{joint}" for side, s in _SIDES for part, joint in (
        ("humerus", "shoulder"), ("ulna", "elbow"), ("femur", "hip"), ("tibia", "knee"), ("calcn", "ankle"),
    )},
}  # fmt: skip
"""Columns of a ``.sto``, and the joints at which their segments begin."""


def coordinates(track: Track) -> dict[str, Array]:
    """Coordinates (T,) by their names in OpenSim's model; those that are never measured are left out.

    Parameters
    ----------
    track : Track
        Motion in OpenSim's ground. Where it lacks the person, or an angle is not measured, coordinates are
        NaN.
    """
    angles, _ = measure_angles(
        track.positions,
        track.quats_xyzw,
        track.joint_confidence,
        track.joint_states,
        track.covariances,
        _UP,
    )
    at = {name: angles[:, i] for name, i in JOINT_ANGLE_INDEX.items()}
    pelvis, chest = (quat_to_matrix(track.quats_xyzw[:, JOINT_INDEX[name]]) for name in ("pelvis", "chest"))
    ahead = np.cross(pelvis[:, :, 0], _UP)
    heading = np.arctan2(-ahead[:, 2], ahead[:, 0])
    heading[track.present] = np.unwrap(heading[track.present])
    flexion, side, twist = np.moveaxis(trunk_angles(relative(pelvis, chest)), -1, 0)
    out = {
        "pelvis_tilt": -at["pelvis_tilt"],
        "pelvis_list": at["pelvis_obliquity"],
        "pelvis_rotation": np.degrees(heading),
        **{f"pelvis_t{axis}": track.positions[:, 0, i] for i, axis in enumerate("xyz")},
        "lumbar_extension": -flexion,
        "lumbar_bending": -side,
        "lumbar_rotation": twist,
    }
    for name, s in _SIDES:
        out |= {
            f"hip_flexion_{s}": at[f"{name}_hip_flexion"],
            f"hip_adduction_{s}": -at[f"{name}_hip_abduction"],
            f"hip_rotation_{s}": at[f"{name}_hip_rotation"],
            f"knee_angle_{s}": at[f"{name}_knee_flexion"],
            f"ankle_angle_{s}": at[f"{name}_ankle_dorsiflexion"],
            f"elbow_flex_{s}": at[f"{name}_elbow_flexion"],
        }
        out |= {f"{part}_{s}": values for part, values in _arm(at, name).items()}
    return {name: values for name, values in out.items() if np.isfinite(values).any()}


def _arm(at: dict[str, Array], side: str) -> dict[str, Array]:
    """Shoulder as OpenSim's sequence z, x, y, from elevation, its plane and rotation."""
    elevation, rotation = (at[f"{side}_shoulder_{part}"] for part in ("elevation", "rotation"))
    plane = np.where(np.isfinite(at[f"{side}_shoulder_plane"]), at[f"{side}_shoulder_plane"], 90.0)
    forward, outward = (elevation * f(np.radians(plane)) for f in (np.sin, np.cos))
    arm = swing_twist_rotation(forward, outward, np.where(np.isfinite(rotation), rotation, 0.0))
    hangs = -arm[:, :, 1]
    flexion, abduction = np.arctan2(hangs[:, 2], -hangs[:, 1]), np.arcsin(np.clip(hangs[:, 0], -1, 1))
    turn = relative(rotation_x(-flexion) @ rotation_z(abduction), arm)
    inward = -np.degrees(np.arctan2(turn[:, 0, 2], turn[:, 0, 0]))
    return {
        "arm_flex": np.degrees(flexion),
        "arm_add": -np.degrees(abduction),
        "arm_rot": np.where(np.isfinite(rotation), inward, np.nan),
    }


def filled(values: Array) -> Array:
    """Interpolate what is NaN, (T,); the first and the last known value hold beyond them."""
    known = np.isfinite(values)
    frames = np.arange(len(values))
    return np.asarray(np.interp(frames, frames[known], values[known]))


def mot_lines(track: Track, step_s: float, name: str, fill: bool) -> Iterator[str]:
    """Yield the lines of a ``.mot`` file of a motion at an even rate in OpenSim's ground.

    Parameters
    ----------
    track : Track
    step_s : float
        Time between frames, seconds.
    name : str
        The motion's name, which the first line has.
    fill : bool
        Interpolate coordinates that are not measured; else they are NaN.
    """
    found = coordinates(track)
    columns = [filled(values) if fill else values for values in found.values()]
    yield from (name, "version=1", f"nRows={len(track)}", f"nColumns={len(found) + 1}", "inDegrees=yes")
    yield from ("endheader", "\t".join(["time", *found]))
    for i, row in enumerate(np.stack(columns, axis=1)):
        yield "\t".join([f"{i * step_s:.6f}", *("NaN" if np.isnan(v) else f"{v:.6f}" for v in row)])


def sto_lines(track: Track, step_s: float) -> Iterator[str]:
    """Yield the lines of a ``.sto`` file of segments' rotations, w, x, y, z.

    Frames without the person are left out.

    Parameters
    ----------
    track : Track
        Motion at an even rate, in a frame with y up.
    step_s : float
        Time between frames, seconds.
    """
    yield from (
        f"DataRate={1 / step_s:.6f}",
        "DataType=Quaternion",
        "version=3",
        "OpenSimVersion=4.5",
        "endheader",
    )
    yield "\t".join(["time", *_SEGMENTS])
    joints = [JOINT_INDEX[name] for name in _SEGMENTS.values()]
    for i in np.flatnonzero(track.present):
        quats = track.quats_xyzw[i, joints][:, [3, 0, 1, 2]]
        yield "\t".join([f"{i * step_s:.6f}", *(",".join(f"{v:.9f}" for v in quat) for quat in quats)])
