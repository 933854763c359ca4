"""Compiled loops of the joint net's crops; `depth_pose.detect.joint_net` uses them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core._select_kernels import kth_smallest
from depth_pose.core.kernels import njit
from depth_pose.core.labels import BACKGROUND
from depth_pose.core.measurement import CropView
from depth_pose.detect._finder_kernels import bounded, near_second

CHANNELS = 8
"""Features of a pixel; `fill_features` lists them."""

_NEAR, _FAR = np.float32(0.2), np.float32(12.0)
"""Depths outside this range are invalid, metres. Set by hand."""

_UNIT_M = 0.5
"""Unit of depths relative to the torso, which are clipped at `FARTHEST` units."""

FARTHEST = 2.4
"""In units of `_UNIT_M`: 1.2 m. Set by hand."""


STRAIGHTEST = np.float32(1e-4)
"""Least value of `measure_bend`, metres."""


class MaskLimits(NamedTuple):
    """When a mask changes labels (`apply_mask`).

    Attributes
    ----------
    least, most : float
        Logits.
    near : float
        Metres.
    """

    least: float
    most: float
    near: float


@njit(cache=True)
def sample_crop(depth, labels, camera, look, grid, whose):
    """Sample depth (metres) and labels to a square crop (``grid``, ``whose``), as `reduce_grid` does.

    Pixels outside the image get no depth and the label -1.
    """
    if look.sin == 0.0:  # rows and columns stay rows and columns
        _sample_level(depth, labels, camera, look, grid, whose)
        return
    height, width = depth.shape
    side = grid.shape[0]
    px, py = look.cell * camera.fx / look.z, look.cell * camera.fy / look.z
    u0, v0 = camera.fx * look.x / look.z + camera.cx, camera.fy * look.y / look.z + camera.cy
    z, who = np.empty(4, np.float32), np.empty(4, np.int64)
    for i in range(side):
        for j in range(side):
            count = 0
            for k in range(4):
                b = i + (-0.25 if k < 2 else 0.25) - 0.5 * (side - 1)
                a = look.flip * (j + (-0.25 if k % 2 == 0 else 0.25) - 0.5 * (side - 1))
                u = int(np.floor(u0 + px * (look.cos * a - look.sin * b) + 0.5))
                v = int(np.floor(v0 + py * (look.sin * a + look.cos * b) + 0.5))
                z[k], who[k] = np.float32(0.0), -1
                if 0 <= u < width and 0 <= v < height:
                    u, v = u - u % look.coarse, v - v % look.coarse
                    z[k], who[k] = depth[v, u], labels[v, u]
                    count += 1
            _join_samples(z, who, count, i, j, grid, whose)


@njit(cache=True)
def _sample_level(depth, labels, camera, look, grid, whose):
    """Do the same for a crop that is not rotated: samples are located by row and column."""
    height, width = depth.shape
    side = grid.shape[0]
    px, py = look.cell * camera.fx / look.z, look.cell * camera.fy / look.z
    u0, v0 = camera.fx * look.x / look.z + camera.cx, camera.fy * look.y / look.z + camera.cy
    us, vs = np.empty(2 * side, np.int64), np.empty(2 * side, np.int64)
    for n in range(2 * side):
        middle = 0.5 * n - 0.25 - 0.5 * (side - 1)
        u = int(np.floor(u0 + px * (look.cos * look.flip * middle) + 0.5))
        v = int(np.floor(v0 + py * (look.cos * middle) + 0.5))
        us[n] = u - u % look.coarse if 0 <= u < width else -1
        vs[n] = v - v % look.coarse if 0 <= v < height else -1
    z, who = np.empty(4, np.float32), np.empty(4, np.int64)
    for i in range(side):
        for j in range(side):
            left, right, top, bottom = us[2 * j], us[2 * j + 1], vs[2 * i], vs[2 * i + 1]
            if left >= 0 and right >= 0 and top >= 0 and bottom >= 0:
                own = labels[top, left]
                others = own == labels[top, right] and own == labels[bottom, left]
                if others and own == labels[bottom, right]:
                    middle = near_second(
                        depth[top, left], depth[top, right], depth[bottom, left], depth[bottom, right],
                        _NEAR, _FAR,
                    )  # fmt: skip
                    grid[i, j], whose[i, j] = middle, own if middle > np.float32(0.0) else 0
                    continue
            count = 0
            for k in range(4):
                u, v = us[2 * j + k % 2], vs[2 * i + k // 2]
                z[k], who[k] = np.float32(0.0), -1
                if u >= 0 and v >= 0:
                    z[k], who[k] = depth[v, u], labels[v, u]
                    count += 1
            _join_samples(z, who, count, i, j, grid, whose)


@njit(cache=True)
def _join_samples(z, who, count, i, j, grid, whose):
    """Set a crop's pixel to the depth of its four samples and the label of the nearest one."""
    grid[i, j], whose[i, j] = np.float32(0.0), -1
    if count < 2:
        return
    middle = near_second(z[0], z[1], z[2], z[3], _NEAR, _FAR)
    grid[i, j], whose[i, j] = middle, 0
    if middle <= np.float32(0.0):
        return
    closest = np.float32(np.inf)
    for k in range(4):
        if z[k] > np.float32(0.0) and abs(z[k] - middle) < closest:
            closest, whose[i, j] = abs(z[k] - middle), who[k]


@njit(cache=True)
def fill_features(grid, whose, label, look, out):
    """Describe every pixel of a crop to the net.

    0 depth of the person's pixels from the torso's; 1 whether it shows the person; 2 depth of all
    pixels; 3 whether there is a depth; 4 whether it lies in the image; 5, 6 slopes of the ray to the
    torso; 7 inverse of its distance (1/m).
    """
    out[:] = 0.0
    x, y = look.flip * look.x / look.z, look.y / look.z
    out[5], out[6] = look.cos * x + look.flip * look.sin * y, look.cos * y - look.flip * look.sin * x
    out[7] = min(1.0 / look.z, 2.5)
    for i in range(grid.shape[0]):
        for j in range(grid.shape[1]):
            if whose[i, j] >= 0:
                out[4, i, j] = 1.0
            if grid[i, j] <= np.float32(0.0):
                continue
            off = bounded((grid[i, j] - np.float32(look.z)) / np.float32(_UNIT_M), FARTHEST)
            out[2, i, j], out[3, i, j] = off, 1.0
            if whose[i, j] == label:
                out[0, i, j], out[1, i, j] = off, 1.0


@njit(cache=True)
def find_window(whose, label, joints, look, margin, stride):
    """Find the smallest window of a crop with a person's pixels and joints, and a margin (m) around both.

    ``joints`` (J, 3) are in the camera frame, metres. Returns the first row, the one behind the last, and the
    same of the columns, all multiples of ``stride`` that lie in the crop.
    """
    side = whose.shape[0]
    places = np.empty(joints.shape)
    to_crop(joints, look, places)
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for k in range(places.shape[0]):
        for axis in range(2):
            at = places[k, 1 - axis] / look.cell + 0.5 * side
            low[axis], high[axis] = min(low[axis], at), max(high[axis], at)
    for i in range(side):
        for j in range(side):
            if whose[i, j] == label:
                low[0], high[0] = min(low[0], i), max(high[0], i + 1)
                low[1], high[1] = min(low[1], j), max(high[1], j + 1)
    first, end = np.empty(2, np.int64), np.empty(2, np.int64)
    for axis in range(2):  # joints beyond the crop leave a window at its border
        down = stride * int(np.floor((low[axis] - margin / look.cell) / stride))
        up = stride * int(np.ceil((high[axis] + margin / look.cell) / stride))
        first[axis] = min(max(down, 0), side - stride)
        end[axis] = min(max(up, first[axis] + stride), side)
    return first[0], end[0], first[1], end[1]


@njit(cache=True)
def take_pixels(features, chosen, out):
    """Copy some rows of features (C, H, W), and the columns of the same numbers: the coarse net's input."""
    for c in range(features.shape[0]):
        for i in range(chosen.shape[0]):
            for j in range(chosen.shape[0]):
                out[c, i, j] = features[c, chosen[i], chosen[j]]


@njit(cache=True)
def measure_bend(grid, whose, label, step):
    """Compute the bend of a person's depth, the median over columns of a crop (m).

    It is the second difference over three pixels that are ``step`` apart and show the person; `STRAIGHTEST`
    where there are none. Over one pixel it shows the noise of pixels, over several that of matched blocks.
    """
    bends, count = np.empty(grid.size, np.float32), 0
    for i in range(step, grid.shape[0] - step):
        for j in range(grid.shape[1]):
            if whose[i - step, j] == label and whose[i, j] == label and whose[i + step, j] == label:
                bends[count] = abs(grid[i - step, j] - np.float32(2.0) * grid[i, j] + grid[i + step, j])
                count += 1
    if count == 0:
        return STRAIGHTEST
    return max(kth_smallest(bends[:count], count // 2), STRAIGHTEST)


@njit(cache=True)
def apply_mask(depth, labels, camera, look, logits, label, limits):
    """Correct a person's pixels by the mask of a crop that is neither turned nor mirrored.

    ``logits`` (side, side). The person's pixels with a logit below ``limits.least`` become background;
    background within ``limits.near`` metres of the torso's depth with a logit above ``limits.most``
    becomes the person's.
    """
    height, width = depth.shape
    side = logits.shape[0]
    px, py = look.cell * camera.fx / look.z, look.cell * camera.fy / look.z
    u0, v0 = camera.fx * look.x / look.z + camera.cx, camera.fy * look.y / look.z + camera.cy
    half = 0.5 * side
    for v in range(max(0, int(v0 - half * py) + 1), min(height, int(v0 + half * py))):
        i = min(max(int((v - v0) / py + half), 0), side - 1)
        for u in range(max(0, int(u0 - half * px) + 1), min(width, int(u0 + half * px))):
            own = labels[v, u]
            if own != label and own != BACKGROUND:
                continue
            logit = logits[i, min(max(int((u - u0) / px + half), 0), side - 1)]
            if own == label:
                if logit < limits.least:
                    labels[v, u] = BACKGROUND
            elif logit > limits.most and abs(depth[v, u] - look.z) < limits.near and depth[v, u] > 0.0:
                labels[v, u] = label


@njit(cache=True)
def to_crop(points, look, out):
    """Convert points (J, 3) in the camera frame, metres, to the crop's coordinates.

    The first two are a point's position in the image, metres at the torso's distance, right and down of the
    crop's middle; the third is its depth relative to the torso.
    """
    for k in range(points.shape[0]):
        z = max(points[k, 2], 0.1)
        a = look.z * (points[k, 0] / z) - look.x
        b = look.z * (points[k, 1] / z) - look.y
        out[k, 0] = look.flip * (look.cos * a + look.sin * b)
        out[k, 1] = look.cos * b - look.sin * a
        out[k, 2] = points[k, 2] - look.z


def from_crop(places: NDArray[np.float64], look: CropView) -> NDArray[np.float64]:
    """Convert the crop's coordinates (J, 3), neither rotated nor mirrored, to points in the camera frame."""
    z = np.maximum(look.z + places[:, 2], _NEAR)
    x, y = (look.x + places[:, 0]) / look.z, (look.y + places[:, 1]) / look.z
    points = np.empty(places.shape)
    points[:, 0], points[:, 1], points[:, 2] = x * z, y * z, z
    return points
