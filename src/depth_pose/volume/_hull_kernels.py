"""Kernels of `depth_pose.volume.hull`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core._camera_kernels import project
from depth_pose.core.kernels import njit

OUTSIDE = -1
"""Table entry where a camera does not see a voxel; the camera is ignored there."""


NEAR_M = 0.05
"""Voxels nearer to a camera, or behind it, are not seen by it, metres."""


class Grid(NamedTuple):
    """Voxels of a space, in blocks of ``side`` along each edge.

    ``origin`` (3,) is the corner with the least coordinates, ``voxel`` the edge of a voxel, metres;
    ``blocks`` are the numbers of blocks along x, y and z.
    """

    origin: NDArray[np.float64]
    voxel: float
    blocks: tuple[int, int, int]
    side: int


@njit(cache=True)
def project_voxels(grid, T_camera_world, camera, c, tables, rects):
    """Pixel of every voxel in camera number ``c``, block by block, and the blocks' rectangles.

    ``tables`` is (blocks, cameras, side^3): row * width + column, or OUTSIDE; ``rects`` is
    (blocks, cameras, 4): first and last row and column, with first row OUTSIDE where the camera
    sees nothing of the block, and last column negative (-1 - column) where it sees a part.
    """
    bx, by, bz = grid.blocks
    origin, voxel, side, T = grid.origin, grid.voxel, grid.side, T_camera_world
    for block in range(bx * by * bz):
        i0, rest = block // (by * bz), block % (by * bz)
        j0, k0 = rest // bz, rest % bz
        top, bottom, left, right, seen, n = camera.height, -1, camera.width, -1, 0, 0
        for i in range(side):
            x = origin[0] + (i0 * side + i + 0.5) * voxel
            for j in range(side):
                y = origin[1] + (j0 * side + j + 0.5) * voxel
                for k in range(side):
                    z = origin[2] + (k0 * side + k + 0.5) * voxel
                    d = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
                    tables[block, c, n] = OUTSIDE
                    if d > NEAR_M:
                        a = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
                        b = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
                        u, v = project(camera, a, b, d)
                        col, row = int(np.rint(u)), int(np.rint(v))
                        if 0 <= col < camera.width and 0 <= row < camera.height:
                            tables[block, c, n] = row * camera.width + col
                            top, bottom = min(top, row), max(bottom, row)
                            left, right = min(left, col), max(right, col)
                            seen += 1
                    n += 1
        rects[block, c, 0] = top if seen else OUTSIDE
        rects[block, c, 1], rects[block, c, 2] = bottom, left
        rects[block, c, 3] = right if seen == n else -1 - right


@njit(cache=True)
def integrate(silhouette, sums):
    """Integral image: ``sums[i, j]`` counts the set pixels above row i and left of column j."""
    height, width = silhouette.shape
    for j in range(width + 1):
        sums[0, j] = 0
    for i in range(height):
        line = 0
        sums[i + 1, 0] = 0
        for j in range(width):
            line += 1 if silhouette[i, j] != 0 else 0
            sums[i + 1, j + 1] = sums[i, j + 1] + line


@njit(cache=True)
def carve(tables, rects, silhouettes, sums, present, least_views, blocks, marks):
    """Mark the voxels that lie in the silhouettes of all cameras that see them.

    ``silhouettes`` is (cameras, H * W), ``sums`` (cameras, H + 1, W + 1), padded to the largest
    camera; ``blocks`` (B,) becomes 0 empty, 1 mixed, 2 full; ``marks`` (B, side^3) is 0 or 1 for
    mixed and full blocks, and untouched for empty ones.
    """
    n_blocks, n_cameras, n = tables.shape
    open_cameras = np.empty(n_cameras, np.int64)
    for block in range(n_blocks):
        views, count, empty = 0, 0, False
        for c in range(n_cameras):
            if not present[c]:
                continue
            top, bottom, left, right = rects[block, c]
            if top == OUTSIDE:
                continue
            whole = right >= 0
            if not whole:
                right = -1 - right
            s = sums[c]
            inside = s[bottom + 1, right + 1] - s[top, right + 1] - s[bottom + 1, left] + s[top, left]
            if inside == 0 and whole:
                empty = True
                break
            views += 1
            if not whole or inside < (bottom - top + 1) * (right - left + 1):
                open_cameras[count] = c
                count += 1
        if empty or views < least_views:
            blocks[block] = 0
            continue
        if count == 0:
            blocks[block] = 2
            for q in range(n):
                marks[block, q] = 1
            continue
        for q in range(n):
            marks[block, q] = 1
        for m in range(count):
            c = open_cameras[m]
            for q in range(n):
                at = tables[block, c, q]
                if at >= 0 and silhouettes[c, at] == 0:
                    marks[block, q] = 0
        total = 0
        for q in range(n):
            total += marks[block, q]
        # voxels that too few cameras see are not known to be the person's
        if total and views - count < least_views:
            total = 0
            for q in range(n):
                if marks[block, q]:
                    votes = views - count
                    for m in range(count):
                        if tables[block, open_cameras[m], q] >= 0:
                            votes += 1
                    if votes < least_views:
                        marks[block, q] = 0
                    total += marks[block, q]
        blocks[block] = 1 if total else 0


@njit(cache=True)
def keep_largest(grid, blocks, marks, stack, labels):
    """Empty all blocks except those of the largest connected group; return its number of voxels."""
    bx, by, bz = grid.blocks
    labels[:] = 0
    best, best_size, label = 0, 0, 0
    for start in range(blocks.shape[0]):
        if blocks[start] == 0 or labels[start] != 0:
            continue
        label += 1
        labels[start] = label
        stack[0], top, size = start, 1, 0
        while top:
            top -= 1
            block = stack[top]
            for q in range(marks.shape[1]):
                size += marks[block, q]
            i0, rest = block // (by * bz), block % (by * bz)
            j0, k0 = rest // bz, rest % bz
            for i in range(max(i0 - 1, 0), min(i0 + 2, bx)):
                for j in range(max(j0 - 1, 0), min(j0 + 2, by)):
                    for k in range(max(k0 - 1, 0), min(k0 + 2, bz)):
                        other = (i * by + j) * bz + k
                        if blocks[other] != 0 and labels[other] == 0:
                            labels[other] = label
                            stack[top] = other
                            top += 1
        if size > best_size:
            best, best_size = label, size
    for block in range(blocks.shape[0]):
        if labels[block] != best:
            blocks[block] = 0
    return best_size


@njit(cache=True)
def find_surface(grid, blocks, marks, points, centre):
    """Write centres of voxels with an empty one of six neighbours, and the mean of all voxels.

    Returns the number of surface voxels, and of all; ``points`` may be too small for them.
    """
    bx, by, bz = grid.blocks
    origin, voxel, side = grid.origin, grid.voxel, grid.side
    n, total, row, last = 0, 0, side * side, side - 1
    centre[:] = 0.0
    for block in range(blocks.shape[0]):
        if blocks[block] == 0:
            continue
        i0, rest = block // (by * bz), block % (by * bz)
        j0, k0 = rest // bz, rest % bz
        own, x0, y0, z0 = marks[block], i0 * side, j0 * side, k0 * side
        buried = blocks[block] == 2
        if buried and 0 < i0 < bx - 1 and 0 < j0 < by - 1 and 0 < k0 < bz - 1:
            buried = (
                blocks[block - by * bz] == 2
                and blocks[block + by * bz] == 2
                and blocks[block - bz] == 2
                and blocks[block + bz] == 2
                and blocks[block - 1] == 2
                and blocks[block + 1] == 2
            )
        else:
            buried = False
        for i in range(side):
            for j in range(side):
                for k in range(side):
                    q = (i * side + j) * side + k
                    if own[q] == 0:
                        continue
                    x = origin[0] + (i0 * side + i + 0.5) * voxel
                    y = origin[1] + (j0 * side + j + 0.5) * voxel
                    z = origin[2] + (k0 * side + k + 0.5) * voxel
                    total += 1
                    centre[0] += x
                    centre[1] += y
                    centre[2] += z
                    if buried:
                        continue
                    # the six neighbours: in this block, or in the next one
                    if (
                        (own[q - row] if i > 0 else _filled(grid, blocks, marks, x0 - 1, y0 + j, z0 + k))
                        and (
                            own[q + row]
                            if i < last
                            else _filled(grid, blocks, marks, x0 + side, y0 + j, z0 + k)
                        )
                        and (own[q - side] if j > 0 else _filled(grid, blocks, marks, x0 + i, y0 - 1, z0 + k))
                        and (
                            own[q + side]
                            if j < last
                            else _filled(grid, blocks, marks, x0 + i, y0 + side, z0 + k)
                        )
                        and (own[q - 1] if k > 0 else _filled(grid, blocks, marks, x0 + i, y0 + j, z0 - 1))
                        and (
                            own[q + 1]
                            if k < last
                            else _filled(grid, blocks, marks, x0 + i, y0 + j, z0 + side)
                        )
                    ):
                        continue
                    if n < points.shape[0]:
                        points[n, 0], points[n, 1], points[n, 2] = x, y, z
                    n += 1
    if total:
        centre /= total
    return n, total


@njit(cache=True)
def _filled(grid, blocks, marks, x, y, z):
    """Mark of one voxel by its indices along the axes; 0 outside the space."""
    side, counts = grid.side, grid.blocks
    if x < 0 or y < 0 or z < 0:
        return np.uint8(0)
    i, j, k = x // side, y // side, z // side
    if i >= counts[0] or j >= counts[1] or k >= counts[2]:
        return np.uint8(0)
    block = (i * counts[1] + j) * counts[2] + k
    if blocks[block] == 0:
        return np.uint8(0)
    return marks[block, ((x - i * side) * side + (y - j * side)) * side + (z - k * side)]


@njit(cache=True)
def mark_points(points, origin, voxel, shape, seen, found):
    """Centres of the voxels that hold points, each once; ``seen`` (all voxels) is left clear."""
    n = 0
    for p in range(points.shape[0]):
        i = int(np.floor((points[p, 0] - origin[0]) / voxel))
        j = int(np.floor((points[p, 1] - origin[1]) / voxel))
        k = int(np.floor((points[p, 2] - origin[2]) / voxel))
        if i < 0 or j < 0 or k < 0 or i >= shape[0] or j >= shape[1] or k >= shape[2]:
            continue
        at = (i * shape[1] + j) * shape[2] + k
        if seen[at] == 0:
            seen[at] = 1
            found[n] = at
            n += 1
    out = np.empty((n, 3))
    for m in range(n):
        at = found[m]
        seen[at] = 0
        i, rest = at // (shape[1] * shape[2]), at % (shape[1] * shape[2])
        out[m, 0] = origin[0] + (i + 0.5) * voxel
        out[m, 1] = origin[1] + (rest // shape[2] + 0.5) * voxel
        out[m, 2] = origin[2] + (rest % shape[2] + 0.5) * voxel
    return out
