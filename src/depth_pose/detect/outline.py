"""Carry people from the net's image to the working grid, along the edges of the depth."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.detect import _outline_kernels as kernels
from depth_pose.detect._finder_kernels import NetImage

_GROW_CHANCE = 0.2
"""A person grows over pixels that show one with at least this chance."""
_GROW_JUMP = 0.02
"""Step in depth per metre of distance that a surface may make from one working pixel to the next."""

_GROW_PIXELS = 4
"""How far a person grows on the working grid, pixels at one metre.

These three gave the best overlap with the truth on 160 simulated scenes.
"""

_NEAR_CHANCE = 0.15
"""Pixels beside a chance of less than this are nobody's on any grid."""


def carry_people(
    image: NetImage,
    net_labels: NDArray[np.uint8],
    net_chance: NDArray[np.float32],
    depth: NDArray[np.float32],
    camera: Camera,
) -> NDArray[np.uint8]:
    """Carry the people to the working grid, and let them grow along their surfaces.

    Parameters
    ----------
    image : NetImage
    net_labels : (ROWS, COLS) uint8
        Each pixel's person, from 1; 0: nobody.
    net_chance : (ROWS, COLS) float32
        Probability that it shows a person.
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
    """Give every pixel of another grid of the same camera what the nearest net pixel holds."""
    ratio = image.camera.fx / camera.fx
    rows = np.rint((np.arange(camera.height) - camera.cy) * ratio + image.camera.cy).astype(np.int64)
    cols = np.rint((np.arange(camera.width) - camera.cx) * ratio + image.camera.cx).astype(np.int64)
    rows, cols = rows.clip(0, image.rows - 1), cols.clip(0, image.cols - 1)
    return net_values.take(rows, axis=0).take(cols, axis=1)
