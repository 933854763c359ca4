r"""Joint angles of skeletons, each with its deviation; `depth_pose.body.angle_definitions` defines them.

Rotation of the hip shows only where the knee is bent, that of the shoulder where the elbow is bent, and the
plane of elevation where the arm is lifted. The deviation says so: with :math:`J` the derivatives of an angle
by the joints' places and :math:`\Sigma` their covariances it is :math:`\sqrt{J \Sigma J^\top}`, which grows
without limit as a limb becomes straight. Joints outside of the image are placed as people usually hold them;
their confidence tells how often that is right, but nothing is measured there: their deviation is
`_OUTSIDE_M`. An angle of more than `MOST_DEVIATION_DEG` is not measured: NaN, and its deviation infinite.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.angle_definitions import (
    AGAINST_VERTICAL,
    JOINT_ANGLE_INDEX,
    JOINT_ANGLES,
    angles_of,
    axes_of_joints,
)
from depth_pose.body.angles import relative
from depth_pose.core.errors import InputError
from depth_pose.core.rotations import quat_to_matrix, unit_vectors
from depth_pose.core.skeleton import JOINT_INDEX, JOINTS, JointState

if TYPE_CHECKING:
    from depth_pose.core.result import Skeleton

Array = NDArray[np.float64]

MOST_DEVIATION_DEG = 20.0
"""Maximum deviation (degrees) of an angle that counts as measured: four times the aim of 5."""

_OUTSIDE_M = 1.0
"""Deviation of a joint outside of the image in each direction, metres: longer than any bone."""

_STEP_M = 1e-4
"""Step of the numerical derivatives, metres."""
_CHUNK = 256
"""Frames differentiated at a time, which bounds the memory."""


class JointAngle(NamedTuple):
    """One joint angle.

    Attributes
    ----------
    name : str
        One of `JOINT_ANGLES`.
    degrees : float
        NaN where it is not measured.
    deviation : float
        Standard deviation, degrees; infinite where it is not measured.
    measured : bool
    """

    name: str
    degrees: float
    deviation: float
    measured: bool


@dataclass(frozen=True)
class JointAngles:
    """All joint angles of one skeleton; ``angles["left_knee_flexion"]`` is one `JointAngle`.

    Attributes
    ----------
    degrees : (25,) float64
        In the order of `JOINT_ANGLES`; NaN where an angle is not measured.
    deviations : (25,) float64
        Standard deviations, degrees; infinite where an angle is not measured.
    """

    degrees: Array
    deviations: Array

    def __getitem__(self, name: str) -> JointAngle:
        if name not in JOINT_ANGLE_INDEX:
            raise KeyError(f"there is no angle {name!r}; the angles are {', '.join(JOINT_ANGLES)}")
        i = JOINT_ANGLE_INDEX[name]
        degrees = float(self.degrees[i])
        return JointAngle(name, degrees, float(self.deviations[i]), bool(np.isfinite(degrees)))

    def __iter__(self) -> Iterator[JointAngle]:
        return (self[name] for name in JOINT_ANGLES)

    def __len__(self) -> int:
        return len(JOINT_ANGLES)

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers, ``{name: {degrees, deviation}}``; both None where not measured."""
        return {
            a.name: {
                "degrees": a.degrees if a.measured else None,
                "deviation": a.deviation if a.measured else None,
            }
            for a in self
        }


def joint_angles(skeleton: Skeleton, up: Array | None = None) -> JointAngles:
    """Return the joint angles of a skeleton, each with its deviation.

    Parameters
    ----------
    skeleton : Skeleton
    up : (3,), optional
        Direction of up in the skeleton's frame, for instance ``floor.up``, or (0, -1, 0) for a level camera.
        Without it the angles against the vertical (trunk lean, pelvis) are not measured.

    Returns
    -------
    JointAngles

    Raises
    ------
    InputError
        Where the skeleton is LOST, or ``up`` is no direction.

    Examples
    --------
    >>> angles = joint_angles(person, up=(0, -1, 0))  # doctest: +SKIP
    >>> angles["left_knee_flexion"].degrees, angles["left_knee_flexion"].deviation  # doctest: +SKIP
    (31.8, 4.9)
    """
    if skeleton.is_lost:
        raise InputError("the skeleton is LOST: it has no joints, and so no angles")
    carried = skeleton.covariances if len(skeleton.covariances) else None
    degrees, deviations = measure_angles(
        skeleton.positions,
        skeleton.quats_xyzw,
        skeleton.joint_confidence,
        skeleton.joint_states,
        carried,
        up,
    )
    return JointAngles(degrees, deviations)


def measure_angles(
    positions: Array,
    quats_xyzw: Array,
    joint_confidence: NDArray[np.floating],
    joint_states: NDArray[np.uint8],
    carried: NDArray[np.floating] | None = None,
    up: Array | None = None,
) -> tuple[Array, Array]:
    """Joint angles of many skeletons and their deviations.

    Parameters
    ----------
    positions : (..., 19, 3)
        Metres; NaN where a joint or person is missing.
    quats_xyzw : (..., 19, 4)
        Segment rotations, rest pose to the positions' frame.
    joint_confidence : (..., 19)
        0 to 1.
    joint_states : (..., 19) uint8
        `depth_pose.core.skeleton.JointState` values.
    carried : (..., 19, 3, 3), optional
        Covariances of the positions, square metres; NaN where they are not known.
    up : (3,), optional
        As for `joint_angles`.

    Returns
    -------
    degrees, deviations : (..., 25) float64
        NaN and infinite where an angle is not measured.
    """
    shape = positions.shape[:-2]
    flat = np.asarray(positions, np.float64).reshape(-1, len(JOINTS), 3)
    quats = np.asarray(quats_xyzw, np.float64).reshape(-1, len(JOINTS), 4)
    sure = joint_confidence.reshape(-1, len(JOINTS))
    is_outside = joint_states.reshape(-1, len(JOINTS)) == JointState.OUTSIDE_IMAGE
    known = None if carried is None else carried.reshape(-1, len(JOINTS), 3, 3)
    vertical = _direction(up)
    degrees = np.full((len(flat), len(JOINT_ANGLES)), np.nan)
    deviations = np.full_like(degrees, np.inf)
    for first in range(0, len(flat), _CHUNK):
        part = slice(first, first + _CHUNK)
        spread = joint_covariances(sure[part], None if known is None else known[part])
        spread[is_outside[part]] = _OUTSIDE_M**2 * np.eye(3)
        degrees[part], deviations[part] = _measured(flat[part], quats[part], spread, vertical)
    lacking = ~(deviations <= MOST_DEVIATION_DEG) | ~np.isfinite(degrees)
    if up is None:
        lacking[:, [JOINT_ANGLE_INDEX[name] for name in AGAINST_VERTICAL]] = True
    degrees[lacking], deviations[lacking] = np.nan, np.inf
    return degrees.reshape(*shape, -1), deviations.reshape(*shape, -1)


def _direction(up: Array | None) -> Array:
    if up is None:
        return np.array([0.0, 1.0, 0.0])
    vertical = np.asarray(up, np.float64)
    if vertical.shape != (3,) or not 1e-6 < np.linalg.norm(vertical) < np.inf:
        raise InputError(f"up is a direction of three numbers, not {up!r}")
    return np.asarray(unit_vectors(vertical))


def _measured(positions: Array, quats: Array, covariances: Array, up: Array) -> tuple[Array, Array]:
    """Angles (T, 25) and deviations of (T, 19, 3) joints, by derivatives."""
    pelvis, thorax = (quat_to_matrix(quats[:, JOINT_INDEX[name]]) for name in ("pelvis", "chest"))
    by_joints = axes_of_joints(positions)
    own_pelvis, own_thorax = relative(by_joints[0], pelvis), relative(by_joints[1], thorax)

    def turned_with(at: Array) -> Array:
        moved_pelvis, moved_thorax = axes_of_joints(at)
        return angles_of(at, moved_pelvis @ own_pelvis, moved_thorax @ own_thorax, up)

    degrees = angles_of(positions, pelvis, thorax, up)
    variance = np.zeros_like(degrees)
    for joint in range(len(JOINTS)):
        slopes = np.empty((*degrees.shape, 3))
        for axis in range(3):
            moved = positions.copy()
            moved[:, joint, axis] += _STEP_M
            slopes[..., axis] = _wrapped(turned_with(moved) - degrees) / _STEP_M
        variance += np.einsum("tai,tij,taj->ta", slopes, covariances[:, joint], slopes)
    return degrees, np.sqrt(variance)


def _wrapped(degrees: Array) -> Array:
    return np.asarray((degrees + 180.0) % 360.0 - 180.0)


_KINDS = (
    "pelvis",
    "spine",
    "chest",
    "neck",
    "head",
    "hip",
    "shoulder",
    "elbow",
    "wrist",
    "knee",
    "ankle",
    "foot",
)
_SURE_MM = dict(
    zip(_KINDS, (10.0, 9.0, 10.0, 10.0, 12.0, 11.0, 12.0, 15.0, 18.0, 10.0, 12.0, 21.0), strict=True)
)
"""Deviation of surely known joints in each direction against the rest of the body, millimetres; measured, as
the next: ``python benchmarks/angles.py angles --joints``."""
_LEAST_MM = ((0.25, 0.65, 0.9, 0.97), (110.0, 80.0, 45.0, 0.0))
"""Least deviation of a joint at a confidence, millimetres, interpolated."""


def joint_covariances(
    joint_confidence: NDArray[np.floating], carried: NDArray[np.floating] | None = None
) -> Array:
    """Covariances of joints against the rest of the body: carried or by confidence, whichever is larger.

    What all carried ones have in common is doubt about where the body is as a whole, which no angle depends
    on: the least one of a person's joints is taken from each, and that of a surely known joint is added. They
    are of small errors; that a joint may be elsewhere, its confidence tells.

    Parameters
    ----------
    joint_confidence : (..., 19)
    carried : (..., 19, 3, 3), optional
        Square metres; NaN where there are none.

    Returns
    -------
    (..., 19, 3, 3) float64
        Square metres; by confidence the same in all directions.
    """
    sure = 1e-3 * np.array([_SURE_MM[name.rpartition("_")[2]] for name in JOINTS])
    doubt = 1e-3 * np.interp(np.asarray(joint_confidence, np.float64), *_LEAST_MM)
    supposed = np.maximum(sure, doubt)[..., None, None] ** 2 * np.eye(3)
    if carried is None:
        return np.asarray(supposed)
    known = np.isfinite(carried).all(axis=(-3, -2, -1), keepdims=True)
    whole = np.where(known, np.asarray(carried, np.float64), 0.0)
    surest = np.argmin(np.trace(whole, axis1=-2, axis2=-1), axis=-1)[..., None, None, None]
    values, axes = np.linalg.eigh(whole - np.take_along_axis(whole, surest, axis=-3))
    own = (axes * np.maximum(values, 0.0)[..., None, :]) @ np.swapaxes(axes, -1, -2)
    carried = own + sure[:, None, None] ** 2 * np.eye(3)
    is_larger = np.trace(carried, axis1=-2, axis2=-1) > np.trace(supposed, axis1=-2, axis2=-1)
    return np.where(known & is_larger[..., None, None], carried, supposed)
