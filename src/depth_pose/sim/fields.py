"""Smooth random fields over an image, from which sensor errors are made."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from depth_pose.sim._scene_kernels import spread_bsplines

Image = NDArray[np.float32]


def smooth_field(rng: np.random.Generator, shape: tuple[int, ...], cell: float) -> Image:
    """Draw smooth noise over an image (H, W), deviation about 1, that varies over ``cell`` pixels."""
    return streaky_field(rng, shape, cell, cell)


def streaky_field(rng: np.random.Generator, shape: tuple[int, ...], high: float, long: float) -> Image:
    """Draw the same with other sizes along columns and rows, pixels."""
    up, across = _spread(shape[0], high), _spread(shape[1], long)
    coarse = rng.standard_normal((up.shape[1], across.shape[1]), dtype=np.float32)
    return np.asarray(up @ coarse @ across.T)


@lru_cache(maxsize=512)
def _spread(size: int, cell: float) -> Image:
    """Weights (size, coarse) of a cubic B-spline, scaled to keep the variance on average."""
    weights = np.zeros((size, int(np.ceil(size / cell)) + 3), np.float32)
    spread_bsplines(cell, weights)
    return weights
