"""Boxes around a person, from the joints alone: each joint stands for the flesh around it.

They hold for skeletons of any source. On the bank's body in random poses of the bank they differ from the
skin's own box by 2 cm per side on average.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera, Lens
from depth_pose.core.skeleton import JOINT_INDEX, JOINTS

Array = NDArray[np.float64]

_RADII_M = {
    "pelvis": 0.12, "spine": 0.11, "chest": 0.10, "neck": 0.05, "head": 0.11, "shoulder": 0.06,
    "elbow": 0.03, "wrist": 0.03, "hip": 0.08, "knee": 0.04, "ankle": 0.06, "foot": 0.05,
}  # fmt: skip
"""Distance from each kind of joint to the skin (m), on the bank's body; chosen on its poses."""

_TIPS = (
    *(("left_elbow", "left_wrist", 0.62, 0.02), ("right_elbow", "right_wrist", 0.62, 0.02)),
    ("neck", "head", 0.35, 0.11),
)
"""Finger tips and crown: the bone that points to each, the share of it to go on, and a radius (m)."""

_RADII = np.array([_RADII_M[name.split("_")[-1]] for name in JOINTS] + [tip[3] for tip in _TIPS])
_FROM = np.array([JOINT_INDEX[a] for a, _, _, _ in _TIPS])
_TO = np.array([JOINT_INDEX[b] for _, b, _, _ in _TIPS])
_SHARE = np.array([[share] for _, _, share, _ in _TIPS])


def box_3d(positions: Array, scale: float) -> Array:
    """Return the corners (2, 3) with the least and the greatest coordinates of a person.

    Parameters
    ----------
    positions : (19, 3) float64
        Metres; the sides of the box are parallel to the axes of their frame.
    scale : float
        Size relative to the bank's body.
    """
    points, radii = _spheres(positions, scale)
    return np.stack([(points - radii).min(axis=0), (points + radii).max(axis=0)])


def box_2d(positions: Array, scale: float, camera: Camera | Lens) -> Array:
    """Return left, top, right and bottom (4,) of a person in an image, pixels, clipped to the image.

    Parameters
    ----------
    positions : (19, 3) float64
        Camera frame, metres.
    scale : float
        Size relative to the bank's body.
    camera : Camera or Lens
        NaN where the person is outside of its image.
    """
    points, radii = _spheres(positions, scale)
    ahead = points[:, 2] > radii[:, 0]
    if not ahead.any():
        return np.full(4, np.nan)
    points, radii = points[ahead], radii[ahead]
    across = radii * [1.0, 1.0, 0.0]
    low = camera.project(points - across).min(axis=0)
    high = camera.project(points + across).max(axis=0)
    pinhole = camera.camera if isinstance(camera, Lens) else camera
    last = np.array([pinhole.width - 1.0, pinhole.height - 1.0])
    if (high < 0.0).any() or (low > last).any():
        return np.full(4, np.nan)
    return np.concatenate([np.clip(low, 0.0, last), np.clip(high, 0.0, last)])


def _spheres(positions: Array, scale: float) -> tuple[Array, Array]:
    """Return centres (22, 3) and radii (22, 1) of spheres that enclose the body, metres."""
    tips = positions[_TO] + _SHARE * (positions[_TO] - positions[_FROM])
    return np.concatenate([positions, tips]), scale * _RADII[:, None]
