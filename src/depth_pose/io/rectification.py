"""Remove the lens distortion from depth images, into a pinhole camera that holds the sensor's whole view.

Every pixel of the ideal camera takes the *nearest* pixel of the sensor, because depth cannot be interpolated
between two surfaces. The ideal camera has the sensor's focal lengths and as many pixels as its view needs:
with the image size kept, a camera of 120 degrees would lose a third of its pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera, Lens
from depth_pose.core.distortion import distort, largest_radius
from depth_pose.core.errors import InputError
from depth_pose.core.image_size import MAX_PIXELS
from depth_pose.io._virtual_camera import MAX_TANGENT

_BAND = 64
"""Number of rows rectified at a time; set by hand."""

_KEPT_PIXELS = MAX_PIXELS
"""Maximum pixels of cached rectifications, 9 bytes each: 54 cameras of 640 x 480; set by hand."""

_LARGEST = 1 << 20
"""Maximum pixels of an ideal image, unless the sensor has more: wider views get a shorter focal length."""

_GRID = 401
"""Number of rays along each side of the search for the view; set by hand."""

_WIDEST = 4.0
"""Search range for the view, as a multiple of that without distortion; set by hand."""


@dataclass(frozen=True)
class RectifiedDepth:
    """A depth image without lens distortion.

    Attributes
    ----------
    depth : (H, W) float32
        Metres; 0 without a measurement.
    camera : Camera
        The image's pinhole camera.
    filled : float
        Share of the pixels that the sensor sees.
    """

    depth: NDArray[np.float32]
    camera: Camera
    filled: float


@dataclass(frozen=True)
class _Map:
    camera: Camera
    source: NDArray[np.int64]
    outside: NDArray[np.bool_]
    filled: float


def rectify_depth(depth: NDArray[np.float32], lens: Lens) -> RectifiedDepth:
    """Remove the lens distortion from a depth image.

    Parameters
    ----------
    depth : (H, W) float32
        Metres.
    lens : Lens
        From `depth_pose.io.calibration.lens_of_image`.

    Returns
    -------
    RectifiedDepth
        With the input itself if there is no distortion.
    """
    camera = lens.camera
    if depth.shape != (camera.height, camera.width):
        raise InputError(
            f"image is {depth.shape[1]} x {depth.shape[0]}, "
            f"its camera_info says {camera.width} x {camera.height}"
        )
    if not lens.model:
        return RectifiedDepth(depth, camera, 1.0)
    found = _rectification(lens)
    rectified: NDArray[np.float32] = depth.ravel()[found.source]
    rectified[found.outside] = 0.0
    return RectifiedDepth(rectified, found.camera, found.filled)


def unrectify_labels(labels: NDArray[np.uint8], lens: Lens) -> NDArray[np.uint8]:
    """Return the labels of a rectified image on the pixels of the distorted one.

    Parameters
    ----------
    labels : (h, w) uint8
        On the pixels that `rectify_depth` gives for this lens.
    lens : Lens

    Returns
    -------
    (H, W) uint8
        Pixels without a counterpart take the label of the nearest one that has it.
    """
    from scipy.ndimage import distance_transform_edt

    found, shape = _rectification(lens), (lens.camera.height, lens.camera.width)
    inside = ~found.outside
    drawn, is_drawn = np.zeros(shape, np.uint8), np.zeros(shape, np.bool_)
    drawn.ravel()[found.source[inside]] = labels[inside]
    is_drawn.ravel()[found.source[inside]] = True
    if is_drawn.all():
        return drawn
    rows, columns = distance_transform_edt(~is_drawn, return_distances=False, return_indices=True)
    return np.asarray(drawn[rows, columns])


_rectifications: dict[Lens, _Map] = {}
"""Cache of the last lenses, up to `_KEPT_PIXELS`."""


def _rectification(lens: Lens) -> _Map:
    """Return the index of each ideal pixel's distorted pixel, and whether there is none, (H, W)."""
    if lens not in _rectifications:
        made = _make_rectification(lens)
        size = made.source.size
        while _rectifications and size + sum(m.source.size for m in _rectifications.values()) > _KEPT_PIXELS:
            _rectifications.pop(next(iter(_rectifications)), None)
        _rectifications[lens] = made
    return _rectifications[lens]


def _make_rectification(lens: Lens) -> _Map:
    radius = largest_radius(lens.d, lens.model, 2.0 * MAX_TANGENT)
    camera = _ideal_camera(lens, radius)
    source, inside = _lookup(lens, camera, radius)
    rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    if len(rows) == 0:
        raise InputError(
            f"camera_info: no ray falls into the image with the coefficients d = {list(lens.d)} "
            f"of the {lens.model} model"
        )
    top, bottom, left, right = (int(i) for i in (rows[0], rows[-1] + 1, columns[0], columns[-1] + 1))
    if (bottom - top, right - left) != inside.shape:
        camera = camera.cropped(left, top, right - left, bottom - top)
        source, inside = source[top:bottom, left:right], inside[top:bottom, left:right]
    return _Map(camera, source, ~inside, float(inside.mean()))


def _ideal_camera(lens: Lens, radius: float) -> Camera:
    """Return a camera on the sensor's pixel grid that holds all rays of the image, and few others."""
    camera = lens.camera
    columns, rows = np.array([-0.5, camera.width - 0.5]), np.array([-0.5, camera.height - 0.5])
    reach = max(
        np.abs(columns - camera.cx).max() / camera.fx, np.abs(rows - camera.cy).max() / camera.fy, 1e-6
    )
    side = np.linspace(-1.0, 1.0, _GRID) * min(_WIDEST * reach, MAX_TANGENT)
    step = side[1] - side[0]
    inside = _pixels(lens, side[None, :], side[:, None], radius)[2]
    if not inside.any():
        return camera
    a, b = side[inside.any(axis=0)], side[inside.any(axis=1)]
    left, right = _range(a, step, camera.fx, camera.cx)
    top, bottom = _range(b, step, camera.fy, camera.cy)
    whole = camera.cropped(left, top, right - left + 1, bottom - top + 1)
    most = max(_LARGEST, camera.width * camera.height)
    share = np.sqrt(most / (whole.width * whole.height))
    if share >= 1.0:
        return whole
    width, height = int(whole.width * share), int(whole.height * share)
    return Camera(width, height, *(float(x * share) for x in (whole.fx, whole.fy, whole.cx, whole.cy)))


def _range(side: NDArray[np.float64], step: float, focal: float, centre: float) -> tuple[int, int]:
    """Return the first and the last pixel of the rays, with a step on both sides, within `MAX_TANGENT`."""
    low, high = max(side[0] - step, -MAX_TANGENT), min(side[-1] + step, MAX_TANGENT)
    return int(np.floor(focal * low + centre)), int(np.ceil(focal * high + centre))


def _lookup(lens: Lens, camera: Camera, radius: float) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return each ideal pixel's sensor pixel, and whether there is one; in bands of rows, to limit memory."""
    source = np.zeros((camera.height, camera.width), np.int64)
    inside = np.zeros((camera.height, camera.width), np.bool_)
    a = (np.arange(camera.width, dtype=np.float64) - camera.cx) / camera.fx
    for first in range(0, camera.height, _BAND):
        band = slice(first, min(first + _BAND, camera.height))
        v = np.arange(band.start, band.stop, dtype=np.float64)[:, None]
        column, row, seen = _pixels(lens, a[None, :], (v - camera.cy) / camera.fy, radius)
        source[band] = np.where(seen, row * lens.camera.width + column, 0)
        inside[band] = seen
    return source, inside


def _pixels(
    lens: Lens, a: NDArray[np.float64], b: NDArray[np.float64], radius: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Return column, row of the sensor's pixels nearest to the rays (a, b, 1), and whether they exist."""
    camera = lens.camera
    a, b = np.broadcast_arrays(a, b)
    with np.errstate(all="ignore"):  # a ray outside the lens model is marked as outside the image
        x, y = distort(a, b, lens.d, lens.model)
        column, row = np.rint(camera.fx * x + camera.cx), np.rint(camera.fy * y + camera.cy)
    inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    return column, row, inside & (a * a + b * b <= radius * radius)
