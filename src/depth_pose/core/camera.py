"""The pinhole camera: the one place where points become pixels and pixels become points.

`Camera` is a named tuple of plain numbers, so that compiled kernels take it as one argument and
read its fields (`depth_pose.core._camera_kernels`). `Lens` is a camera whose images are distorted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from depth_pose.core.camera_info import check_pinhole, read_camera_info
from depth_pose.core.distortion import FISHEYE, OPENCV, distort, distortion_of
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

    @classmethod
    def from_fov(cls, horizontal: float, *, width: int, height: int, vertical: float | None = None) -> Camera:
        """Build a camera from its field of view, with the principal point in the middle.

        Parameters
        ----------
        horizontal : float
            Horizontal field of view, from border to border, degrees.
        width, height : int
            Image size, pixels.
        vertical : float, optional
            Vertical field of view, degrees; by default pixels are square.

        Raises
        ------
        InputError
            Where an angle is not between 1 and 170 degrees.

        Examples
        --------
        >>> Camera.from_fov(90.0, width=640, height=480)
        Camera(width=640, height=480, fx=320.0, fy=320.0, cx=319.5, cy=239.5)
        """
        fx = _focal("horizontal", horizontal, width)
        fy = fx if vertical is None else _focal("vertical", vertical, height)
        k = np.array(_matrix(fx, fy, 0.5 * (width - 1), 0.5 * (height - 1)))
        return cls(*check_pinhole(k, (), width, height))

    @classmethod
    def from_opencv(
        cls, K: ArrayLike, D: ArrayLike | None, size: Sequence[int], *, fisheye: bool = False
    ) -> Camera | Lens:
        """Build a camera from an OpenCV calibration.

        Parameters
        ----------
        K : (3, 3) array_like
            ``cameraMatrix``, pixels.
        D : array_like or None
            ``distCoeffs``, of 4, 5, 8 or 12 numbers, which zeros may follow; None or zeros: no distortion.
        size : (int, int)
            Width and height of the images, pixels.
        fisheye : bool
            Whether ``D`` is of ``cv2.fisheye``: 4 numbers.

        Returns
        -------
        Camera or Lens
            A `Lens` if there is distortion.

        Raises
        ------
        InputError
            Where the numbers are no calibration.

        Examples
        --------
        >>> K = [[525, 0, 319.5], [0, 525, 239.5], [0, 0, 1]]
        >>> Camera.from_opencv(K, None, (640, 480))
        Camera(width=640, height=480, fx=525.0, fy=525.0, cx=319.5, cy=239.5)
        >>> Camera.from_opencv(K, [0.1, -0.2, 0, 0, 0.05], (640, 480)).d
        (0.1, -0.2, 0.0, 0.0, 0.05)
        """
        if len(size) != 2:
            raise InputError(f"size is {size!r:.80}; it is (width, height), pixels")
        width, height = (int(n) for n in size)
        k = cls.from_matrix(K, width=width, height=height).matrix()
        d = np.zeros(0) if D is None else np.asarray(D, np.float64).ravel()
        name = FISHEYE if fisheye else OPENCV
        camera = cls(*check_pinhole(k, d, width, height, name))
        model, coefficients = distortion_of(d, name)
        return Lens(camera, model, coefficients) if model else camera

    @classmethod
    def from_camera_info(cls, info: Any, *, size: Sequence[int] | None = None) -> Camera | Lens:
        """Build a camera from a ``sensor_msgs/CameraInfo`` or a calibration file.

        Parameters
        ----------
        info : message or mapping
            A CameraInfo of ROS 1 or 2; or a mapping with its fields, or with those of a file of
            ``camera_calibration`` (``image_width``, ``camera_matrix`` and so on).
        size : (int, int), optional
            Width and height of the images, pixels; by default those that the info states, with its
            binning and region of interest.

        Returns
        -------
        Camera or Lens
            A `Lens` if there is distortion. For rectified images, whose camera is P of the info, give
            ``Camera.from_matrix(P[:, :3], ...)``.

        Raises
        ------
        InputError
            Where a field is missing, empty or contradictory.

        Examples
        --------
        >>> info = {"width": 640, "height": 480, "k": [525, 0, 319.5, 0, 525, 239.5, 0, 0, 1], "d": []}
        >>> Camera.from_camera_info(info)
        Camera(width=640, height=480, fx=525.0, fy=525.0, cx=319.5, cy=239.5)
        """
        fields = _camera_info(info)
        if size is None:
            roi = fields.roi
            part = (roi.width, roi.height) if roi.width and roi.height else (fields.width, fields.height)
            size = part[0] // max(1, fields.binning_x), part[1] // max(1, fields.binning_y)
        pinhole, model, d = read_camera_info(fields, int(size[1]), int(size[0]))
        camera = cls(*pinhole)
        return Lens(camera, model, d) if model else camera

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the pixel coordinates (..., 2), column and row, of points (..., 3) in the camera frame."""
        points = np.asarray(points, np.float64)
        pixels, z = np.empty((*points.shape[:-1], 2)), points[..., 2]
        pixels[..., 0] = self.fx * points[..., 0] / z + self.cx
        pixels[..., 1] = self.fy * points[..., 1] / z + self.cy
        return pixels

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
        return np.array(_matrix(self.fx, self.fy, self.cx, self.cy))


@dataclass(frozen=True)
class Lens:
    """A camera with lens distortion.

    Attributes
    ----------
    camera : Camera
        Maps distorted rays to the image's pixels.
    model : str
        `depth_pose.core.distortion.OPENCV` or ``FISHEYE``; empty without distortion.
    d : tuple of float
        The model's coefficients.
    """

    camera: Camera
    model: str = ""
    d: tuple[float, ...] = ()

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the pixel coordinates (..., 2) in the distorted image of points (..., 3), camera frame."""
        if not self.model:
            return self.camera.project(points)
        x, y, z = np.moveaxis(np.asarray(points, np.float64), -1, 0)
        a, b = distort(x / z, y / z, self.d, self.model)
        return self.camera.project(np.stack([a, b, np.ones_like(a)], axis=-1))


def _matrix(fx: float, fy: float, cx: float, cy: float) -> list[list[float]]:
    return [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]


def _focal(name: str, degrees: float, pixels: int) -> float:
    """Return the focal length (pixels) of a field of view."""
    if not 1.0 <= degrees <= 170.0:
        raise InputError(f"the {name} field of view is {degrees}; it is 1 to 170 degrees")
    return float(round(0.5 * pixels / math.tan(math.radians(0.5 * degrees)), 9))


_NO_REGION = SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0)
_INFO_KEYS = {
    "width": ("width", "image_width"),
    "height": ("height", "image_height"),
    "distortion_model": ("distortion_model",),
    "k": ("k", "K", "camera_matrix"),
    "d": ("d", "D", "distortion_coefficients"),
    "p": ("p", "P", "projection_matrix"),
    "binning_x": ("binning_x",),
    "binning_y": ("binning_y",),
    "roi": ("roi",),
}
"""Names of each field of a CameraInfo: in ROS 2, in ROS 1, in files of ``camera_calibration``."""


def _camera_info(info: Any) -> SimpleNamespace:
    """Return a CameraInfo's fields, by their names in ROS 2, from a message or a mapping."""
    given: dict[str, Any] = {}
    for field, names in _INFO_KEYS.items():
        for name in names:
            value = info.get(name) if isinstance(info, Mapping) else getattr(info, name, None)
            if value is not None:
                given[field] = value["data"] if isinstance(value, Mapping) and "data" in value else value
    missing = [field for field in ("width", "height", "k") if field not in given]
    if missing:
        raise InputError(
            f"camera info has no {missing[0]}; give a sensor_msgs/CameraInfo, or a mapping with width, "
            "height, k, d and distortion_model"
        )
    region = given.get("roi", _NO_REGION)
    if isinstance(region, Mapping):
        region = SimpleNamespace(**{**vars(_NO_REGION), **region})
    defaults = {"distortion_model": "plumb_bob", "d": (), "p": (), "binning_x": 0, "binning_y": 0}
    return SimpleNamespace(**{**defaults, **given, "roi": region})
