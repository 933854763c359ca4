"""Smooth random fields over an image, from which sensor errors are made."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]


def smooth_field(rng: np.random.Generator, shape: tuple[int, ...], cell: float) -> Image:
    """Draw smooth noise over an image (H, W), deviation about 1, that varies over ``cell`` pixels."""
    up, across = _spread(shape[0], cell), _spread(shape[1], cell)
    coarse = rng.standard_normal((up.shape[1], across.shape[1]), dtype=np.float32)
    return np.asarray(up @ coarse @ across.T)


@lru_cache(maxsize=512)
def _spread(size: int, cell: float) -> Image:
    """Weights (size, coarse) of a cubic B-spline, scaled to keep the variance on average."""
    count = int(np.ceil(size / cell)) + 3
    away = np.abs(np.arange(size)[:, None] / cell + 1.0 - np.arange(count)[None])
    inner, outer = 2 / 3 - away**2 + away**3 / 2, np.maximum(2 - away, 0.0) ** 3 / 6
    weights = np.where(away < 1, inner, outer)
    return (weights / np.sqrt((weights**2).sum(axis=1, keepdims=True))).astype(np.float32)
