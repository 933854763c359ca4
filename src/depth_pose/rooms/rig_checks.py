"""Checks of a rig: numbers that no rig has, and cameras that are not those of the recordings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.errors import ConfigError, InputError

_FARTHEST_M = 200.0
"""Maximum distance (m) of a camera from the room's origin; set by hand."""

_MOST_OFFSET_S = 1e9
"""Maximum clock offset (s): 30 years."""

_ROTATION_ERROR = 1e-3
"""Maximum error of a rotation matrix; files round to a few decimals."""

_SAME_FOCAL, _SAME_CENTRE = 0.02, 0.02
"""Maximum difference of focal lengths, and of principal points as a share of the width; set by hand."""


def check_transform(where: str, T: NDArray[np.float64]) -> None:
    """Check that a matrix (4, 4) is a rigid transform in metres.

    Raises
    ------
    ConfigError
        If it is not; the message says what it looks like.
    """
    R, t = T[:3, :3], T[:3, 3]
    if not np.isfinite(T).all():
        raise ConfigError(f"{where} has numbers that are not finite")
    if np.abs(T[3, :3]).max() > 1e-6 and np.allclose(T[:3, 3], 0.0) and abs(T[3, 3] - 1.0) < 1e-6:
        raise ConfigError(f"{where}: the translation stands in the last row; it looks transposed")
    if not np.allclose(T[3], [0.0, 0.0, 0.0, 1.0], atol=1e-6):
        raise ConfigError(f"{where}: the last row is {T[3].tolist()}; it must be [0, 0, 0, 1]")
    if np.abs(R).max() > 1e6:
        raise ConfigError(f"{where} does not hold a rotation")
    scale = float(np.cbrt(abs(np.linalg.det(R))))
    if not np.allclose(R @ R.T, np.eye(3), atol=_ROTATION_ERROR):
        scaled = f", but one scaled by {scale:.4g}" if scale > 1e-6 and _is_scaled(R, scale) else ""
        raise ConfigError(f"{where} does not hold a rotation{scaled}")
    if np.linalg.det(R) < 0:
        raise ConfigError(f"{where} does not hold a rotation, but a mirror image")
    if np.abs(t).max() > _FARTHEST_M:
        raise ConfigError(
            f"{where}: the camera is {np.abs(t).max():.4g} m from the origin; distances are "
            "metres, not millimetres"
        )


def _is_scaled(R: NDArray[np.float64], scale: float) -> bool:
    return bool(np.allclose(R @ R.T / scale**2, np.eye(3), atol=_ROTATION_ERROR))


def check_offset(where: str, offset_s: float) -> float:
    """Return a clock offset after checking it."""
    if not abs(offset_s) <= _MOST_OFFSET_S:
        raise ConfigError(
            f"{where}.clock_offset is {offset_s:g} s; it is seconds, at most {_MOST_OFFSET_S:g}"
        )
    return offset_s


def check_recorded(
    names: Sequence[str], known: Sequence[Camera], recordings: Sequence[Path], own: Sequence[Camera]
) -> None:
    """Check that each recording is of the rig's camera, by size and intrinsics.

    Parameters
    ----------
    names : sequence of str
        Of the rig's cameras.
    known : sequence of Camera
        The rig's.
    recordings : sequence of Path
    own : sequence of Camera
        Of the first frame of each recording.

    Raises
    ------
    InputError
        With the cameras that the recordings seem to be of.
    """
    for i, (name, path, camera) in enumerate(zip(names, recordings, own, strict=True)):
        if are_same(known[i], camera):
            continue
        fits = [other for k, other in enumerate(names) if are_same(known[k], camera)]
        hint = f"; it fits {' and '.join(fits)}: is the order of the recordings wrong?" if fits else ""
        hint = hint or "; calibrate again, with recordings of these cameras"
        raise InputError(
            f"{path} is not of {name}: its images are {_describe(camera)}; in the rig they are "
            f"{_describe(known[i])}{hint}"
        )


def _describe(camera: Camera) -> str:
    return f"{camera.width} x {camera.height} with focal lengths {camera.fx:.1f}, {camera.fy:.1f}"


def are_same(a: Camera, b: Camera) -> bool:
    """Check whether two cameras have one size and about the same intrinsics."""
    focal = max(abs(a.fx / b.fx - 1.0), abs(a.fy / b.fy - 1.0))
    centre = max(abs(a.cx - b.cx), abs(a.cy - b.cy)) / a.width
    return (a.width, a.height) == (b.width, b.height) and focal <= _SAME_FOCAL and centre <= _SAME_CENTRE
