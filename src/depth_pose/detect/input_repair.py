"""Repair of depth that was resized with interpolation, or registered to a finer image without filling.

Resizing with interpolation (bilinear, area, cubic) averages over holes, which are 0, and over depth steps:
holes get a rim of depths between 0 and the surface, single lost pixels become pits, and steps get mixed
pixels. A sensor has flying pixels on steps, but hardly any between a surface and a hole: 0 to 6 % of the
borders of holes have a rim in recordings as measured, 40 to 99 % in resized ones. In these, pixels beside
holes, pits and mixed pixels are removed.

Depth that is registered to a finer image leaves whole rows and columns of it empty. Such a grid is
distinguished from random loss by its regular gaps, and reduced by its mean gap, which gives a dense image of
a coarser camera. Filling the gaps instead finds fewer people.

Any other image is returned as it is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.frame import DepthFrame
from depth_pose.detect import _repair_kernels as kernels

_ROWS = 120
"""Minimum number of rows that are judged in an image that has so many. Set by hand."""

_EVERY = 32
"""Frames from one look at a stream to the next, once it is judged; number of frames all of which are
looked at before. Set by hand."""

_FEWEST = 60
"""Number of borders of holes, or of squares with a set pixel, that are needed to judge. Set by hand."""

_FLAT = 0.03
"""Relative difference of two depths beside a border that are one surface. Set by hand."""

_RIM = (0.1, 0.88)
"""Range of a rim's depth relative to the surface's. Set by hand."""

_RIMS, _FEW_RIMS = 0.2, 0.1
"""Share of borders with a rim at which removal begins, and below which it ends. Set by hand; the maximum of
recordings as measured is .06, the minimum of resized ones .4."""

_RISE = 0.05
"""Relative depth step at which a pixel is a pit or mixed. Set by hand."""

_MOST_FULL, _MOST_IRREGULAR = 0.45, 0.28
"""Maximum shares of full and of irregular squares of a sparse grid. Set by hand: a grid refined by 1.25 has
.34 and .14; recordings without gaps have at least .88 full ones, random loss of half of the pixels .35
irregular ones."""

_REGULAR = 0.6
"""Least share of a sparse grid's gaps that are the two whole numbers around their mean. Set by hand: .8 where
a tenth of the pixels is lost, .4 where those that are set are random."""

_SAME_GAP = 0.25
"""Relative change of the gap below which a grid counts as the same. Set by hand."""


class InputRepair:
    """Detects and repairs interpolated rims and sparse grids in the frames of one sensor.

    Frames are judged until the sensor is known, at most 32 of them, and then every 32nd.

    Attributes
    ----------
    has_rims : bool
        Whether the last judged frames have interpolated rims.
    gap : float
        Mean distance (pixels) between the set pixels of a sparse grid; 0 of a dense one.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all earlier frames."""
        self._said: dict[bool, str] = {}
        self._begin(())

    def _begin(self, shape: tuple[int, ...]) -> None:
        """Judge anew, as images have another size."""
        self.has_rims, self.gap = False, 0.0
        self._borders = self._rims = 0.0
        self._shape, self._wait, self._looks = shape, 0, 0

    def warm_up(self) -> None:
        """Compile every kernel."""
        depth = np.full((8, 8), 2.0, np.float32)
        self._judge(depth)
        _gap_of(depth * (np.indices(depth.shape) % 2 == 0).all(axis=0))
        kernels.remove_rims(depth, _RISE)
        kernels.reduce_grid(depth, 4, 4)
        self.reset()

    @property
    def doubt(self) -> str:
        """What is repaired now, and how to avoid it at the source; empty where nothing is."""
        if self.gap:
            return (
                f"the depth is a sparse grid, one pixel in about {self.gap**2:.1f} is set, as registration "
                "to a finer image leaves it: it is reduced to a coarser, dense image. Better at the source: "
                "fill_upsampling_holes: true for depth_image_proc's register node, or unregistered depth"
            )
        if self.has_rims:
            return (
                "the depth was resized with interpolation: around holes it has false depths between 0 and "
                "the surface, which are removed. Better at the source: resize depth by nearest neighbour "
                "(cv2.INTER_NEAREST) or not at all"
            )
        return ""

    @property
    def warnings(self) -> tuple[str, ...]:
        """All doubts since the last reset, one line each."""
        return tuple(self._said.values())

    def apply(self, frame: DepthFrame) -> DepthFrame:
        """Return the frame without rims, or a dense one of a coarser camera; itself if nothing is wrong."""
        if frame.depth.shape != self._shape:
            self._begin(frame.depth.shape)
        if self._wait == 0:
            self._judge(frame.depth)
        self._wait -= 1
        if self.gap:
            return _reduce(frame, self.gap)
        if self.has_rims:
            return replace(frame, depth=kernels.remove_rims(frame.depth, _RISE))
        return frame

    def _judge(self, depth: NDArray[np.float32]) -> None:
        """Look for gaps and rims; the newest frames count most."""
        gap, is_known = _gap_of(depth)
        if not abs(gap - self.gap) < _SAME_GAP * self.gap:
            self.gap = gap
        borders, rims = kernels.count_rims(depth, _step(depth), _FLAT, *_RIM)
        self._borders, self._rims = 0.5 * self._borders + borders, 0.5 * self._rims + rims
        if self._borders >= _FEWEST:
            self.has_rims = self._rims > (_FEW_RIMS if self.has_rims else _RIMS) * self._borders
        self._looks += 1
        is_judged = is_known and (self.gap > 0.0 or self._borders >= _FEWEST)
        self._wait = _EVERY if is_judged or self._looks >= _EVERY else 1
        if self.doubt:
            self._said.setdefault(self.gap > 0, self.doubt)


def _step(depth: NDArray[np.float32]) -> int:
    """Return how many rows lie from one judged row to the next; odd, as grids may leave every second one."""
    return max(1, depth.shape[0] // _ROWS) | 1


def _gap_of(depth: NDArray[np.float32]) -> tuple[float, bool]:
    """Return the mean gap of a sparse grid, 0 for others, and whether enough is set to tell."""
    used, full, irregular = kernels.count_squares(depth, _step(depth))
    if used < _FEWEST:
        return 0.0, False
    if full > _MOST_FULL * used or irregular > _MOST_IRREGULAR * used:
        return 0.0, True
    return min(_mean_gap(depth), _mean_gap(np.ascontiguousarray(depth.T))), True


def _mean_gap(depth: NDArray[np.float32]) -> float:
    """Return the mean of the regular gaps along the rows; 0 where they are not regular."""
    counts = np.zeros(kernels.LONGEST_GAP + 1, np.int64)
    kernels.count_gaps(depth, _step(depth), counts)
    total = int(counts.sum())
    if total < _FEWEST:
        return 0.0
    shorter = int(counts @ np.arange(len(counts)) // total)
    regular = counts[shorter : shorter + 2]  # of a grid refined by 2.4 the gaps are 2 and 3
    if regular.sum() < _REGULAR * total:
        return 0.0
    return float(shorter + regular[1:].sum() / regular.sum())


def _reduce(frame: DepthFrame, gap: float) -> DepthFrame:
    """Reduce a sparse grid by its mean gap."""
    c = frame.camera
    rows, cols = max(1, round(c.height / gap)), max(1, round(c.width / gap))
    x, y = cols / c.width, rows / c.height
    camera = Camera(cols, rows, c.fx * x, c.fy * y, (c.cx + 0.5) * x - 0.5, (c.cy + 0.5) * y - 0.5)
    return replace(frame, depth=kernels.reduce_grid(frame.depth, rows, cols), camera=camera)
