"""Canonical axes of a partial cloud, and its descriptor image there (Sec. 5.1).

The paper takes the three principal axes of the cloud and tries four sign combinations, half of
which are mirror images. Here the first principal axis is "up", with the camera's up deciding its
sign; "toward the camera" is the viewing ray made orthogonal to it; "right" completes a proper
rotation. Exemplars are rendered as partial clouds from all around and put into these axes by the
same function as the input, so that both see the same biases.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank import _view_kernels as kernels

DESCRIPTOR_SIZE = 48
"""Cells along each side of a descriptor image."""

HALF_WIDTH_M = 1.2
"""Half of the side that a descriptor image covers, metres of a person of scale 1."""

DEPTH_LIMIT_M = 0.5
"""Maximum depth relative to the centroid (m), about an arm's reach; set by hand."""

FOREGROUND_LEVEL = 0.8
"""Value of a cell at the centroid's depth, so that the silhouette counts as well as depth; set by hand."""


@dataclass(frozen=True)
class CanonicalAxes:
    """``T_canonical_camera``: ``x_canonical = rotation @ (x_camera - origin)``.

    Attributes
    ----------
    rotation : (3, 3) float64
        Rows are right, up, and toward the camera.
    origin : (3,) float64
        The cloud's centroid in the camera frame, metres.
    """

    rotation: NDArray[np.float64]
    origin: NDArray[np.float64]


def canonical_axes(points: NDArray[np.float64]) -> tuple[CanonicalAxes, ...]:
    """Find the canonical axes of a partial cloud.

    Parameters
    ----------
    points : (N, 3) float64
        Points in the camera frame, metres; N at least 3.

    Returns
    -------
    tuple of CanonicalAxes
        The axes; where "up" lies closer to the camera's horizontal than to its vertical, so that
        its sign is in doubt, also those with the other sign.
    """
    origin, covariance = kernels.weighted_moments(points)
    up = np.linalg.eigh(covariance)[1][:, 2]
    if up[1] > 0:  # the camera's y axis points down
        up = -up
    axes = [CanonicalAxes(_axes(up, origin), origin)]
    if up[1] > -np.sqrt(0.5):
        axes.append(CanonicalAxes(_axes(-up, origin), origin))
    return tuple(axes)


def _axes(up: NDArray[np.float64], origin: NDArray[np.float64]) -> NDArray[np.float64]:
    toward = -origin / np.linalg.norm(origin)
    toward = toward - up * (up @ toward)
    length = np.linalg.norm(toward)
    if length < 1e-3:  # seen along its longest axis: choose any direction, but always the same
        toward = np.cross(up, [1.0, 0.0, 0.0])
        length = np.linalg.norm(toward)
    toward = toward / length
    return np.stack([np.cross(up, toward), up, toward])


def describe(points: NDArray[np.float64], axes: CanonicalAxes, scale: float = 1.0) -> NDArray[np.float64]:
    """Draw a cloud as a depth image in its canonical axes.

    Parameters
    ----------
    points : (N, 3) float64
        Camera frame, metres.
    axes : CanonicalAxes
    scale : float
        The person's size relative to the bank's body.

    Returns
    -------
    (48 * 48,) float64
        ``0.8 - clip(depth, -0.5, 0.5)`` where there are points, 0 elsewhere.
    """
    image = np.empty((DESCRIPTOR_SIZE, DESCRIPTOR_SIZE))
    kernels.splat(
        points, axes.rotation, axes.origin, scale, HALF_WIDTH_M, DEPTH_LIMIT_M, FOREGROUND_LEVEL, image
    )
    return image.ravel()
