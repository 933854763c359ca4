"""The pinhole camera: the one place where points become pixels and pixels become points.

`Camera` is a named tuple of plain numbers, so that compiled kernels take it as one argument and
read its fields (`depth_pose.core._camera_kernels`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from depth_pose.core.errors import InputError


class Camera(NamedTuple):
    """A pinhole depth camera.

    Attributes
    ----------
    width, height : int
        Image size, pixels.
    fx, fy, cx, cy : float
        Focal lengths and principal point, pixels; integer coordinates are pixel centres.

    Examples
    --------
    >>> camera = Camera(width=640, height=480, fx=525.0, fy=525.0, cx=319.5, cy=239.5)
    >>> camera.project([[0.0, 0.0, 2.0]])
    array([[319.5, 239.5]])
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    @classmethod
    def from_matrix(cls, K: ArrayLike, *, width: int, height: int) -> Camera:
        """Build a camera from its intrinsic matrix.

        Parameters
        ----------
        K : (3, 3) array_like
            ``[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]``, pixels; integer coordinates are pixel centres.
        width, height : int
            Image size, pixels.

        Raises
        ------
        InputError
            Where K does not have this form.

        Examples
        --------
        >>> Camera.from_matrix([[525, 0, 319.5], [0, 525, 239.5], [0, 0, 1]], width=640, height=480)
        Camera(width=640, height=480, fx=525.0, fy=525.0, cx=319.5, cy=239.5)
        """
        k = np.asarray(K, np.float64)
        if k.shape != (3, 3):
            raise InputError(f"K has shape {k.shape}; an intrinsic matrix has (3, 3)")
        fx, fy, cx, cy = k[0, 0], k[1, 1], k[0, 2], k[1, 2]
        if not np.allclose(k, [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]):  # NaN is not close
            raise InputError(f"K is {k.tolist()}; it must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
        return cls(int(width), int(height), float(fx), float(fy), float(cx), float(cy))

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the pixel coordinates (..., 2), column and row, of points (..., 3) in the camera frame."""
        x, y, z = np.moveaxis(np.asarray(points, np.float64), -1, 0)
        return np.stack([self.fx * x / z + self.cx, self.fy * y / z + self.cy], axis=-1)

    def back_project(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the points (H, W, 3) of a depth image (H, W), metres; NaN where nothing returned."""
        from depth_pose.core._camera_kernels import back_project  # numba is imported only where it is used

        return back_project(depth, self)

    def strided(self, step: int) -> Camera:
        """Return the camera of the image of every ``step``-th pixel, beginning with the first."""
        width, height = -(-self.width // step), -(-self.height // step)
        return Camera(width, height, self.fx / step, self.fy / step, self.cx / step, self.cy / step)

    def cropped(self, left: int, top: int, width: int, height: int) -> Camera:
        """Return the camera of an image part that begins at column ``left`` and row ``top``."""
        return Camera(width, height, self.fx, self.fy, self.cx - left, self.cy - top)

    def matrix(self) -> NDArray[np.float64]:
        """Return the intrinsic matrix K, (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])
