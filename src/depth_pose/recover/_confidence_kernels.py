"""Compiled comparison of joints with the observed depth, for `depth_pose.recover.confidence`."""

from __future__ import annotations

from typing import Any

import numpy as np

from depth_pose.core._camera_kernels import project
from depth_pose.core.kernels import njit
from depth_pose.core.types import BACKGROUND, PERSON

_SEEN, _OCCLUDED, _OUTSIDE = 0, 1, 2
"""Values of `depth_pose.core.skeleton.JointState`."""

_SAMPLES = 6
"""Number of sample points along a limb segment."""

_FAR_OUTSIDE = 2.0
"""Maximum distance outside the image, in units of ``hidden_behind``, that lowers the confidence further."""


@njit(cache=True)
def _is_outside(u: Any, v: Any, camera: Any) -> Any:
    """Check that a pixel position lies outside the image."""
    return not (-0.5 <= u < camera.width - 0.5 and -0.5 <= v < camera.height - 0.5)


@njit(cache=True)
def _look(x: Any, y: Any, z: Any, below: Any, window: Any) -> Any:
    """Look up the label of a body point's pixel, and how far the surface lies from where it is expected."""
    depth, labels = window.depth, window.labels
    u, v = project(window.camera, x, y, z)
    row, column = int(np.rint(v)), int(np.rint(u))
    if not (0 <= row < depth.shape[0] and 0 <= column < depth.shape[1]):
        return BACKGROUND, 0.0
    if labels[row, column] != PERSON:
        return labels[row, column], 0.0
    return PERSON, z - below - depth[row, column]


@njit(cache=True)
def measure_joint_signs(
    positions: Any,
    parents: Any,
    below: Any,
    hidden_behind: Any,
    camera: Any,
    window: Any,
    states: Any,
    signs: Any,
) -> None:
    """Write the states (19,) of joints and their first 10 signs (19, 12), in the order of `confidence.SIGNS`.

    ``camera`` is that of the whole image, ``window`` (`depth_pose.body.rendered_depth.Observation`) the
    observation around the person.
    """
    width, height = camera.width, camera.height
    signs[:] = 0.0
    for j in range(positions.shape[0]):
        x, y, z = positions[j]
        u, v = project(camera, x, y, z)
        states[j] = _SEEN
        if _is_outside(u, v, camera):
            states[j] = _OUTSIDE
            du = max(0.0, -0.5 - u, u - width + 0.5) * z / camera.fx
            dv = max(0.0, -0.5 - v, v - height + 0.5) * z / camera.fy
            signs[j, 1] = min(np.sqrt(du * du + dv * dv) / hidden_behind, _FAR_OUTSIDE)
        else:
            label, gap = _look(x, y, z, below[j], window)
            if label == BACKGROUND:
                signs[j, 2] = 1.0
            elif label != PERSON or gap > hidden_behind:
                states[j] = _OCCLUDED
                signs[j, 0] = 1.0
                signs[j, 8] = label == PERSON
            else:
                signs[j, 3] = min(max(-gap / hidden_behind, 0.0), 2.0)
                signs[j, 4] = max(gap / hidden_behind, 0.0)
        p = parents[j]
        for s in range(_SAMPLES):
            t = s / _SAMPLES
            at_x = x + t * (positions[p, 0] - x)
            at_y = y + t * (positions[p, 1] - y)
            at_z = z + t * (positions[p, 2] - z)
            u, v = project(camera, at_x, at_y, at_z)
            if _is_outside(u, v, camera):  # not observed, so not free space
                continue
            label, gap = _look(at_x, at_y, at_z, below[j] + t * (below[p] - below[j]), window)
            if label == BACKGROUND:
                signs[j, 5] += 1.0 / _SAMPLES
            elif label != PERSON or gap > hidden_behind:
                signs[j, 6] += 1.0 / _SAMPLES
            else:
                signs[j, 7] += min(abs(gap) / hidden_behind, 2.0) / _SAMPLES
    for j in range(positions.shape[0]):
        signs[j, 9] = states[j] == _OUTSIDE and states[parents[j]] == _SEEN
