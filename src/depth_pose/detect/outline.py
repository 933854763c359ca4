"""Transfer of people from the net's image to the working grid, along depth edges."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.detect import _outline_kernels as kernels
from depth_pose.detect._finder_kernels import NetImage

_GROW_CHANCE = 0.2
"""Least person probability of pixels that a person grows into."""
_GROW_JUMP = 0.02
"""Maximum depth step between working pixels on a surface, per metre of distance."""

_GROW_PIXELS = 4
"""Maximum growth on the working grid, pixels at one metre; the three values are chosen on 160 simulated
scenes."""

_NEAR_CHANCE = 0.15
"""Pixels beside probabilities below this are background on any grid."""


def carry_people(
    image: NetImage,
    net_labels: NDArray[np.uint8],
    net_chance: NDArray[np.float32],
    depth: NDArray[np.float32],
    camera: Camera,
) -> NDArray[np.uint8]:
    """Transfer people to the working grid, and grow them along their surfaces.

    Parameters
    ----------
    image : NetImage
    net_labels : (H, W) uint8
        Person at each pixel, from 1; 0: background.
    net_chance : (H, W) float32
        Person probability.
    depth : (h, w) float32
        The working grid, metres.
    camera : Camera
        Its camera.

    Returns
    -------
    (h, w) uint8
    """
    labels = np.zeros(depth.shape, np.uint8)
    if not net_labels.any():
        return labels
    near, solid = np.empty(net_labels.shape, np.bool_), np.empty(net_labels.shape, np.uint8)
    likely, chance = net_chance.copy(), np.empty(depth.shape, np.float32)
    kernels.mark_near(net_labels, likely, _NEAR_CHANCE, image.rows, image.cols, near, solid)
    kernels.carry_labels(depth, camera, image, net_labels, likely, kernels.Marks(near, solid), labels, chance)
    queue = np.empty(depth.size, np.int64)
    kernels.grow_labels(depth, labels, chance, _GROW_CHANCE, _GROW_JUMP, _GROW_PIXELS, queue)
    return labels


def spread(net_values: NDArray[Any], image: NetImage, camera: Camera) -> NDArray[Any]:
    """Resample net values to another grid of the same camera by the nearest pixel."""
    ratio = image.camera.fx / camera.fx
    rows = np.rint((np.arange(camera.height) - camera.cy) * ratio + image.camera.cy).astype(np.int64)
    cols = np.rint((np.arange(camera.width) - camera.cx) * ratio + image.camera.cx).astype(np.int64)
    rows = np.minimum(np.maximum(rows, 0), image.rows - 1)
    cols = np.minimum(np.maximum(cols, 0), image.cols - 1)
    return net_values.take(rows, axis=0).take(cols, axis=1)
