"""The input image of the finder's net: a frame on its grid, as it is or rotated by quarter turns.

The net was trained on people who are mostly upright in the image. People who lie across it, or stand in front
of a sensor mounted on its side, are detected more reliably in a rotated image.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.frame import DepthFrame
from depth_pose.detect import _finder_kernels as kernels
from depth_pose.detect._finder_kernels import NetImage

_NEAR_M, _FAR_M = 0.2, 12.0
"""Depth range of the net's training data (m)."""


def reduce_frame(frame: DepthFrame, nearest: float = _NEAR_M) -> NetImage:
    """Reduce a frame to the net's grid, keeping the aspect ratio.

    Depths below ``nearest``, metres, are removed.
    """
    camera = frame.camera
    stride = max(camera.width / kernels.COLS, camera.height / kernels.ROWS)
    rows = min(kernels.ROWS, int(camera.height / stride + 1e-6))
    cols = min(kernels.COLS, int(camera.width / stride + 1e-6))
    grid = np.empty((kernels.ROWS, kernels.COLS), np.float32)
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


class Turned:
    """A frame rotated by quarter turns, on the net's grid, and the inverse mapping.

    Parameters
    ----------
    frame : DepthFrame
    turns : int
        Quarter turns, counter-clockwise.
    nearest : float
        Depths below, metres, are removed.

    Attributes
    ----------
    image : NetImage
    """

    def __init__(self, frame: DepthFrame, turns: int, nearest: float) -> None:
        c, self._turns = frame.camera, turns % 4
        principal = {
            0: (c.cx, c.cy),
            1: (c.cy, c.width - 1 - c.cx),
            2: (c.width - 1 - c.cx, c.height - 1 - c.cy),
            3: (c.height - 1 - c.cy, c.cx),
        }[self._turns]
        sizes = (c.width, c.height, c.fx, c.fy) if turns % 2 == 0 else (c.height, c.width, c.fy, c.fx)
        depth = np.ascontiguousarray(np.rot90(frame.depth, self._turns))
        self.image = reduce_frame(replace(frame, depth=depth, camera=Camera(*sizes, *principal)), nearest)

    def back(
        self, image: NetImage, mask: NDArray[np.float32], torso: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the net's answer for the rotated image, mapped to the pixels of the frame.

        Parameters
        ----------
        image : NetImage
            The frame as it is.
        mask, torso : (1, ROWS, COLS), (4, ROWS, COLS) float32
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
