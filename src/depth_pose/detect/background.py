"""The still background of a camera that stands still, on the finder's grid.

A surface that swallows light returns nothing: dark trousers leave a hole where the wall behind them was
measured before. So where depth was and is gone, something dark is in front; and where depth is nearer than it
was, something has come. Both are inputs of the finder's net
(`depth_pose.detect._finder_kernels.fill_features`), which was trained with backgrounds that are known,
unknown, and known with the person in them.

The background is the farthest depth seen at a pixel. It is forgotten when the camera moves, and where a
nearer surface has stayed for `_SETTLES_NS`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.detect import _background_kernels as kernels
from depth_pose.detect._background_kernels import BackgroundLimits
from depth_pose.detect._finder_kernels import COLS, ROWS, NetImage
from depth_pose.detect.turned import NORMAL_GRID

_LIMITS = BackgroundLimits(near_m=0.1, rise=0.02, least_share=0.05, most_farther=0.05, most_shift=0.5)
"""Depth changes that are no noise (m, and m per squared metre of distance); share of pixels that must be
known; share of them that may show something farther, and median change, in units of these changes, of a
camera that stands still."""

_SETTLES_NS = 60_000_000_000
"""Time (ns) after which a nearer surface that stays is background."""

_LONGEST_NS = 500_000_000
"""Longest gap (ns) between two images of one view."""


class StillBackground:
    """Remembers the farthest depth at each pixel while the camera stands still.

    Attributes
    ----------
    depth : (H, W) float32
        The background before the image of the last `look`, metres; 0 where it is unknown.
    is_still : bool
        Whether that image showed the same view.
    """

    def __init__(self) -> None:
        self._allocate(NORMAL_GRID)
        self.reset()

    def _allocate(self, shape: tuple[int, ...]) -> None:
        self.depth, self._next = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
        self._since_ns = np.zeros(shape, np.int64)

    def warm_up(self) -> None:
        """Compile every kernel; forgets the view."""
        grid = np.full((ROWS, COLS), np.float32(2.0))
        image = NetImage(grid, ROWS, COLS, 1.0, Camera(COLS, ROWS, 140.0, 140.0, 79.5, 59.5))
        for stamp_ns in (0, 1):
            self.look(image, stamp_ns)
        self.reset()

    def reset(self) -> None:
        """Forget the view."""
        self._next[:] = 0.0
        self._stamp_ns: int | None = None
        self._camera: object = None
        self.is_still = False

    def look(self, image: NetImage, stamp_ns: int) -> NDArray[np.float32]:
        """Return the background for an image, and add the image to it.

        Parameters
        ----------
        image : NetImage
        stamp_ns : int

        Returns
        -------
        (H, W) float32
            `depth`; all 0 for the first image of a view.
        """
        if image.depth.shape != self.depth.shape:
            self._allocate(image.depth.shape)
        gap_ns = stamp_ns - self._stamp_ns if self._stamp_ns is not None else 0
        is_same_view = 0 < gap_ns <= _LONGEST_NS and image.camera == self._camera
        self.is_still = is_same_view and not kernels.has_moved(image.depth, self._next, _LIMITS)
        if not self.is_still:
            self._next[:] = 0.0
        self.depth[:] = self._next
        kernels.renew(image.depth, self._next, self._since_ns, stamp_ns, _SETTLES_NS, _LIMITS)
        self._stamp_ns, self._camera = stamp_ns, image.camera
        return self.depth
