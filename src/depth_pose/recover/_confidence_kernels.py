"""Compiled comparison of joints with the observed depth, for `depth_pose.recover.confidence`."""

from __future__ import annotations

from typing import Any

import numpy as np

from depth_pose.core.kernels import njit
from depth_pose.core.labels import BACKGROUND, PERSON

_SEEN, _OCCLUDED, _OUTSIDE = 0, 1, 2
"""Values of `depth_pose.core.skeleton.JointState`."""

_FAR_OUTSIDE = 2.0
"""Maximum distance outside the image, in units of ``hidden_behind``, that lowers the confidence further."""


@njit(cache=True)
def _is_outside(u: Any, v: Any, camera: Any) -> Any:
    """Check that a pixel position lies outside the image."""
    return not (-0.5 <= u < camera.width - 0.5 and -0.5 <= v < camera.height - 0.5)


@njit(cache=True)
def _look(u: Any, v: Any, expected: Any, window: Any) -> Any:
    """Look up the label of a pixel, and how far the surface lies in front of where it is expected."""
    depth, labels = window.depth, window.labels
    row, column = int(np.rint(v)), int(np.rint(u))
    if not (0 <= row < depth.shape[0] and 0 <= column < depth.shape[1]):
        return BACKGROUND, 0.0
    if labels[row, column] != PERSON:
        return labels[row, column], 0.0
    return PERSON, expected - depth[row, column]


@njit(cache=True)
def measure_joint_signs(
    pixels: Any,
    depths: Any,
    expected: Any,
    parents: Any,
    hidden_behind: Any,
    camera: Any,
    window: Any,
    states: Any,
    signs: Any,
) -> None:
    """Write the states (19,) of joints and their first 10 signs (19, 12), in the order of `confidence.SIGNS`.

    ``pixels`` (19, S, 2) are those of a joint and of points along its segment, in the whole image, of which
    ``camera`` is the camera; ``expected`` (19, S) the depths of the surface there. ``depths`` (19,) are those
    of the joints; ``window`` (`depth_pose.body.rendered_depth.Observation`) is the observation around the
    person.
    """
    width, height, samples = camera.width, camera.height, pixels.shape[1]
    left, top = camera.cx - window.camera.cx, camera.cy - window.camera.cy
    signs[:, :10] = 0.0
    for j in range(pixels.shape[0]):
        u, v = pixels[j, 0]
        states[j] = _SEEN
        if _is_outside(u, v, camera):
            states[j] = _OUTSIDE
            du = max(0.0, -0.5 - u, u - width + 0.5) * depths[j] / camera.fx
            dv = max(0.0, -0.5 - v, v - height + 0.5) * depths[j] / camera.fy
            signs[j, 1] = min(np.sqrt(du * du + dv * dv) / hidden_behind, _FAR_OUTSIDE)
        else:
            label, gap = _look(u - left, v - top, expected[j, 0], window)
            if label == BACKGROUND:
                signs[j, 2] = 1.0
            elif label != PERSON or gap > hidden_behind:
                states[j] = _OCCLUDED
                signs[j, 0] = 1.0
                signs[j, 8] = label == PERSON
            else:
                signs[j, 3] = min(max(-gap / hidden_behind, 0.0), 2.0)
                signs[j, 4] = max(gap / hidden_behind, 0.0)
        for s in range(samples):
            u, v = pixels[j, s]
            if _is_outside(u, v, camera):  # not observed, so not free space
                continue
            label, gap = _look(u - left, v - top, expected[j, s], window)
            if label == BACKGROUND:
                signs[j, 5] += 1.0 / samples
            elif label != PERSON or gap > hidden_behind:
                signs[j, 6] += 1.0 / samples
            else:
                signs[j, 7] += min(abs(gap) / hidden_behind, 2.0) / samples
    for j in range(pixels.shape[0]):
        signs[j, 9] = states[j] == _OUTSIDE and states[parents[j]] == _SEEN
