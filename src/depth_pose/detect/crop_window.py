"""The window of a crop that shows somebody whose joints are roughly known.

A crop has room for outstretched arms; somebody who stands fills a third of it, and their joints are usually
known from the last frame. The joint net is convolutional up to its last means, so its fine part can process
any window (Long et al. 2015, *Fully convolutional networks for semantic segmentation*); beyond the window its
layers see zeros, as beyond the image. Windows lie on the grid of the net's largest stride: their cells are
cells of the whole crop.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.detect import _crop_kernels as kernels
from depth_pose.detect.crop import CropSample

STRIDE, CELL, JOINED = 16, 4, 8
"""Largest stride of the fine net, side of a voting cell, and stride at which the coarse net's channels join
the fine net's, pixels."""

_MARGIN_M = 0.2
"""Least distance between a joint or a pixel of the person and the border of the window, metres; .15 saves 2 %
of the pixels. In 332 looks in rooms and at postures, joints of good measurements are 43.2 mm off in the whole
crop, in windows 44.3 with .15 m and 43.8 with .3."""


class Window(NamedTuple):
    """Rows and columns of a crop, from the first up to the one behind the last.

    Attributes
    ----------
    top, bottom, left, right : int
        Multiples of `STRIDE`.
    """

    top: int
    bottom: int
    left: int
    right: int


def window_around(sample: CropSample, label: int, joints: NDArray[np.float64]) -> Window:
    """Return the smallest window with a person's pixels and joints, and a margin around both.

    Parameters
    ----------
    sample : CropSample
    label : int
        The person's.
    joints : (J, 3) float64
        Camera frame, metres.
    """
    return Window(*kernels.find_window(sample.whose, label, joints, sample.view, _MARGIN_M, STRIDE))


class CropGrid(NamedTuple):
    """Cells of a net's crop.

    Attributes
    ----------
    side : int
        Rows and columns of the crop, pixels.
    cell_m : float
        Side of a pixel, metres.
    coarse_cells : int
        Number of rows and columns of the coarse net's channels; 0 without that net.
    coarse_cell_m : float
        Side of one of its cells, metres.
    """

    side: int
    cell_m: float
    coarse_cells: int = 0
    coarse_cell_m: float = 0.0

    @property
    def whole(self) -> Window:
        """The window that is the whole crop."""
        return Window(0, self.side, 0, self.side)


@lru_cache(maxsize=1024)
def cells_of(grid: CropGrid, window: Window) -> dict[str, NDArray[np.float32] | NDArray[np.int64]]:
    """Locate a window's cells, as the net reads them.

    Returns
    -------
    dict
        ``cells`` (1, 1, 3, cells) float32, their centres in the crop, metres. With a coarse net also
        ``coarse_rows`` and ``coarse_columns`` int64, its nearest cell for each `JOINED` pixels.
    """
    rows, columns = (slice(n // CELL, m // CELL) for n, m in (window[:2], window[2:]))
    centres = _centres(grid.side // CELL, CELL * grid.cell_m)
    across, down = np.meshgrid(centres[columns], centres[rows])
    cells = np.stack([across, down, np.zeros_like(across)]).reshape(1, 1, 3, -1).astype(np.float32)
    if not grid.coarse_cells:
        return {"cells": cells}
    fine = _centres(grid.side // JOINED, JOINED * grid.cell_m)
    coarse = _centres(grid.coarse_cells, grid.coarse_cell_m)
    nearest = np.abs(fine[:, None] - coarse).argmin(axis=1)
    return {
        "cells": cells,
        "coarse_rows": nearest[window.top // JOINED : window.bottom // JOINED],
        "coarse_columns": nearest[window.left // JOINED : window.right // JOINED],
    }


def _centres(count: int, size: float) -> NDArray[np.float64]:
    """Return the centres of cells along a side of a crop, metres from its middle."""
    return np.asarray((np.arange(count) + 0.5 - 0.5 * count) * size, np.float64)
