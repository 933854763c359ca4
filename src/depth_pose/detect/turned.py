"""The input image of the finder's net: a frame on its grid, as it is or rotated by quarter turns.

The net was trained on people who are mostly upright in the image. People who lie across it, or stand in front
of a sensor mounted on its side, are detected more reliably in a rotated image.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.frame import DepthFrame
from depth_pose.detect import _finder_kernels as kernels
from depth_pose.detect._finder_kernels import NetImage

_NEAR_M, _FAR_M = 0.2, 12.0
"""Depth range of the net's training data (m)."""

NORMAL_GRID = (kernels.ROWS, kernels.COLS)
"""Rows and columns of the net's image for usual views."""

MOST_PIXELS = 256 * 256
"""Maximum size of the net's image for wide views."""

_LEAST_FOCAL, _WIDE_FOCAL, _STEP = 60.0, 72.0, 16
"""Least focal length of a usual view on the net's grid, pixels (a view of 80 degrees has 95); focal length in
a wider view, and the pixels that its sides are multiples of. With more pixels for all views fewer people are
found in furnished rooms (.81 for .89): the net sees less around each."""


def reduce_frame(
    frame: DepthFrame, nearest: float = _NEAR_M, shape: tuple[int, int] | None = None
) -> NetImage:
    """Reduce a frame to the net's grid, keeping the aspect ratio.

    Depths below ``nearest``, metres, are removed. ``shape`` is that of the grid, by default as wide as the
    view takes.
    """
    camera = frame.camera
    height, width = shape or _grid_for(camera)
    stride = max(camera.width / width, camera.height / height)
    rows = min(height, int(camera.height / stride + 1e-6))
    cols = min(width, int(camera.width / stride + 1e-6))
    grid = np.empty((height, width), np.float32)
    depth = frame.depth if frame.depth.dtype == np.float32 else frame.depth.astype(np.float32)
    near, far = np.float32(max(nearest, _NEAR_M)), np.float32(_FAR_M)
    kernels.reduce_grid(depth, stride, rows, cols, near, far, grid)
    reduced = Camera(
        width=cols,
        height=rows,
        fx=camera.fx / stride,
        fy=camera.fy / stride,
        cx=(camera.cx + 0.5) / stride - 0.5,
        cy=(camera.cy + 0.5) / stride - 0.5,
    )
    return NetImage(grid, rows, cols, stride, reduced)


def _grid_for(camera: Camera) -> tuple[int, int]:
    rows, cols = NORMAL_GRID
    if camera.fx / max(camera.width / cols, camera.height / rows) >= _LEAST_FOCAL:
        return NORMAL_GRID
    most = math.sqrt(MOST_PIXELS / (camera.width * camera.height))
    scale = min(1.0, _WIDE_FOCAL / camera.fx, most)
    rows, cols = (max(1, int(scale * side / _STEP)) * _STEP for side in (camera.height, camera.width))
    return rows, cols


class Turned:
    """A frame rotated by quarter turns, on the net's grid, and the inverse mapping.

    Parameters
    ----------
    frame : DepthFrame
    turns : int
        Quarter turns, counter-clockwise.
    nearest : float
        Depths below, metres, are removed.
    shape : tuple of 2 int
        Of the net's grid.

    Attributes
    ----------
    image : NetImage
    """

    def __init__(self, frame: DepthFrame, turns: int, nearest: float, shape: tuple[int, int]) -> None:
        c, self._turns = frame.camera, turns % 4
        principal = {
            0: (c.cx, c.cy),
            1: (c.cy, c.width - 1 - c.cx),
            2: (c.width - 1 - c.cx, c.height - 1 - c.cy),
            3: (c.height - 1 - c.cy, c.cx),
        }[self._turns]
        sizes = (c.width, c.height, c.fx, c.fy) if turns % 2 == 0 else (c.height, c.width, c.fy, c.fx)
        depth = np.ascontiguousarray(np.rot90(frame.depth, self._turns))
        turned = replace(frame, depth=depth, camera=Camera(*sizes, *principal))
        self.image = reduce_frame(turned, nearest, shape)

    def back(
        self, image: NetImage, mask: NDArray[np.float32], torso: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the net's answer for the rotated image, mapped to the pixels of the frame.

        Parameters
        ----------
        image : NetImage
            The frame as it is.
        mask, torso : (1, H, W), (4, H, W) float32
            Of the turned image.
        """
        shown = self.image
        grid = np.arange(shown.rows * shown.cols).reshape(shown.rows, shown.cols)
        upright = np.rot90(grid, -self._turns)
        rows, cols = (
            np.minimum((np.arange(n) + 0.5) * of / n, of - 1).astype(np.int64)
            for n, of in zip((image.rows, image.cols), upright.shape, strict=True)
        )
        v, u = np.divmod(upright[np.ix_(rows, cols)], shown.cols)
        own_mask, own_torso = np.full_like(mask, -30.0), np.zeros_like(torso)
        own_mask[:, : image.rows, : image.cols] = mask[:, v, u]
        x, y = torso[0, v, u], torso[1, v, u]
        for _ in range(self._turns):  # a quarter turn took y to x, and x to -y
            x, y = -y, x
        own_torso[:, : image.rows, : image.cols] = np.stack([x, y, *torso[2:, v, u]])
        return own_mask, own_torso
