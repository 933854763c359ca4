"""Compiled loops that turn a simulated scene into the net's input and targets."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from depth_pose.core._camera_kernels import ray
from depth_pose.detect._finder_kernels import COLS, near_second

_NEAR, _FAR = np.float32(0.2), np.float32(12.0)
"""Depths outside this range are invalid, metres; as in `depth_pose.detect._crop_kernels`."""


class Cut(NamedTuple):
    """The part of a scene that fills the net's image: ``rows`` x ``cols`` of its pixels.

    It begins at column ``left`` and row ``top``, with ``stride`` pixels of the scene to a pixel.
    """

    left: float
    top: float
    stride: float
    rows: int
    cols: int
    mirrored: bool


@njit(cache=True)
def reduce_scene(depth_mm, person, reach, cut, grid, labels):
    """Sample a scene as `reduce_grid` does a frame, with the person that each pixel shows (0: nobody).

    The sensor's edges differ from those of the labels: pixels outside a person's ``reach`` (P, 2), their
    least and greatest depth, do not belong to the person.
    """
    left, top, stride, rows, cols, mirrored = cut
    grid[:] = 0.0
    labels[:] = 0
    height, width = depth_mm.shape
    z, who = np.empty(4, np.float32), np.empty(4, np.int64)
    for i in range(rows):
        for j in range(cols):
            column = cols - 1 - j if mirrored else j
            for k in range(4):
                a = min(height - 1, int(top + (i + (0.25 if k < 2 else 0.75)) * stride))
                b = min(width - 1, int(left + (column + (0.25 if k % 2 == 0 else 0.75)) * stride))
                z[k], who[k] = np.float32(0.001) * depth_mm[a, b], person[a, b]
            grid[i, j] = near_second(z[0], z[1], z[2], z[3], _NEAR, _FAR)
            if grid[i, j] > 0.0:
                closest = np.float32(np.inf)
                for k in range(4):
                    if z[k] > 0.0 and abs(z[k] - grid[i, j]) < closest:
                        closest, labels[i, j] = abs(z[k] - grid[i, j]), who[k]
                k = labels[i, j] - 1
                if k >= 0 and not (reach[k, 0] < grid[i, j] < reach[k, 1]):
                    labels[i, j] = 0


@njit(cache=True)
def cell_labels(labels, cells, out):
    """Fill in the person at each cell's representative pixel; 0 where there is no pixel or no person."""
    for i in range(cells.shape[0]):
        for j in range(cells.shape[1]):
            at = cells[i, j]
            out[i, j] = labels[at // COLS, at % COLS] if at >= 0 else 0


@njit(cache=True)
def fill_offsets(grid, labels, targets, camera, out):
    """Offsets (3, h, w) from every person pixel of the grid to its person's target (P, 3)."""
    for i in range(labels.shape[0]):
        for j in range(labels.shape[1]):
            k = labels[i, j] - 1
            if k >= 0:
                z = grid[i, j]
                x, y = ray(camera, j, i)
                out[0, i, j] = targets[k, 0] - x * z
                out[1, i, j] = targets[k, 1] - y * z
                out[2, i, j] = targets[k, 2] - z


@njit(cache=True)
def fill_joint_offsets(grid, cells, labels, joints, camera, out):
    """Offsets (3 J, h, w) from the representative pixel of each person cell to their joints (P, J, 3)."""
    for i in range(cells.shape[0]):
        for j in range(cells.shape[1]):
            k = labels[i, j] - 1
            if k < 0:
                continue
            a, b = cells[i, j] // COLS, cells[i, j] % COLS
            z = grid[a, b]
            x, y = ray(camera, b, a)
            x, y = x * z, y * z
            for n in range(joints.shape[1]):
                out[3 * n, i, j] = joints[k, n, 0] - x
                out[3 * n + 1, i, j] = joints[k, n, 1] - y
                out[3 * n + 2, i, j] = joints[k, n, 2] - z


@njit(cache=True)
def drape(grid, labels, person, share, hang, smooth, rows, cols):
    """Drape a blanket over a person: from their top down it grows no narrower and hides what is between.

    ``share`` of their height is covered; ``hang``: pixels by which each side moves outwards from one row
    to the next, at most; ``smooth``: how often the cloth is averaged with its neighbours. Nothing happens to
    fewer than six rows.
    """
    top, bottom = rows, -1
    for i in range(rows):
        for j in range(cols):
            if labels[i, j] == person:
                top, bottom = min(top, i), max(bottom, i)
    end = min(rows, top + int(share * (bottom - top + 1)))
    if end - top < 6:
        return
    left, right = cols, -1
    before = np.zeros(cols, np.float32)
    for i in range(top, end):
        first, last, total, count = cols, -1, 0.0, 0
        for j in range(cols):
            if labels[i, j] == person:
                first, last = min(first, j), max(last, j)
                total += grid[i, j]
                count += 1
        if count == 0:
            continue
        if right < 0:
            left, right = first, last
        left, right = max(left - hang, min(left, first)), min(right + hang, max(right, last))
        z = total / count
        middle, half = 0.5 * (left + right), max(0.5 * (right - left), 1.0)
        for j in range(max(0, left), min(cols, right + 1)):
            side = (j - middle) / half
            cloth = z + 0.12 * side * side
            if before[j] > 0.0:
                cloth = 0.5 * (cloth + before[j])
            if labels[i, j] == person:
                cloth = min(cloth, grid[i, j]) - 0.01
            elif 0.0 < grid[i, j] < cloth:
                continue  # something occludes them
            grid[i, j], labels[i, j] = cloth, person
            before[j] = cloth
    for _ in range(smooth):
        for i in range(top + 1, min(end, rows) - 1):
            for j in range(1, cols - 1):
                if labels[i, j] != person:
                    continue
                total, count = 0.0, 0
                for a in range(i - 1, i + 2):
                    for b in range(j - 1, j + 2):
                        if labels[a, b] == person and abs(grid[a, b] - grid[i, j]) < 0.3:
                            total += grid[a, b]
                            count += 1
                grid[i, j] = total / count


@njit(cache=True)
def choose_cells(grid, rows, cols, side, cells):
    """Choose a representative pixel for each block of ``side`` x ``side`` pixels; -1 where all are holes.

    It is the pixel at the lower quartile of the block's depths, so that the foreground is kept.
    """
    keep = side * side // 4 + 1
    flat, least = np.empty(keep, np.int64), np.empty(keep, np.float32)
    for i in range(cells.shape[0]):
        for j in range(cells.shape[1]):
            count = 0
            for a in range(i * side, min(rows, (i + 1) * side)):
                for b in range(j * side, min(cols, (j + 1) * side)):
                    z = grid[a, b]
                    if z <= 0.0:
                        continue
                    count += 1
                    if count > keep and z >= least[keep - 1]:
                        continue
                    k = min(count, keep) - 1
                    while k > 0 and least[k - 1] > z:
                        least[k], flat[k] = least[k - 1], flat[k - 1]
                        k -= 1
                    least[k], flat[k] = z, a * COLS + b
            cells[i, j] = flat[count // 4] if count > 0 else -1
