"""Kernels of simulated scenes: a depth buffer of triangles, and the shadow of a projector."""

from __future__ import annotations

import numpy as np

from depth_pose.core._camera_kernels import project, ray
from depth_pose.core.kernels import njit


@njit(cache=True)
def raster(vertices, faces, camera, near, inverse, index):
    """Draw triangles (F, 3), both sides, into a buffer of 1/z (H, W) and of face numbers (H, W).

    A triangle that reaches behind the plane z = ``near`` is cut there.
    """
    corners = np.empty((4, 3))
    shown = np.empty((vertices.shape[0], 3))
    for k in range(vertices.shape[0]):
        x, y, z = vertices[k]
        if z >= near:
            shown[k, 0], shown[k, 1] = project(camera, x, y, z)
            shown[k, 2] = 1.0 / z
    for f in range(faces.shape[0]):
        i, j, k = faces[f]
        if vertices[i, 2] >= near and vertices[j, 2] >= near and vertices[k, 2] >= near:
            _draw(shown[i], shown[j], shown[k], f, inverse, index)
            continue
        count = 0
        for k in range(3):
            p = vertices[faces[f, k]]
            q = vertices[faces[f, (k + 1) % 3]]
            if p[2] >= near:
                corners[count, 0], corners[count, 1] = project(camera, p[0], p[1], p[2])
                corners[count, 2] = 1.0 / p[2]
                count += 1
            if (p[2] >= near) != (q[2] >= near):
                t = (near - p[2]) / (q[2] - p[2])
                x, y = p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])
                corners[count, 0], corners[count, 1] = project(camera, x, y, near)
                corners[count, 2] = 1.0 / near
                count += 1
        for k in range(1, count - 1):
            _draw(corners[0], corners[k], corners[k + 1], f, inverse, index)


@njit(cache=True)
def _draw(a, b, c, face, inverse, index):
    """Draw one triangle with corners (u, v, 1/z); 1/z is linear in the image."""
    height, width = inverse.shape
    top = max(0, int(np.ceil(min(a[1], b[1], c[1]))))
    bottom = min(height - 1, int(np.floor(max(a[1], b[1], c[1]))))
    if top > bottom:
        return
    left = max(0, int(np.ceil(min(a[0], b[0], c[0]))))
    right = min(width - 1, int(np.floor(max(a[0], b[0], c[0]))))
    if left > right:
        return
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    if abs(area) < 1e-12:
        return
    db_du, db_dv = (c[1] - a[1]) / area, -(c[0] - a[0]) / area
    dc_du, dc_dv = -(b[1] - a[1]) / area, (b[0] - a[0]) / area
    slope_b, slope_c = b[2] - a[2], c[2] - a[2]
    for v in range(top, bottom + 1):
        share_b = (left - a[0]) * db_du + (v - a[1]) * db_dv
        share_c = (left - a[0]) * dc_du + (v - a[1]) * dc_dv
        for u in range(left, right + 1):
            if share_b >= -1e-9 and share_c >= -1e-9 and share_b + share_c <= 1.0 + 1e-9:
                near_by = a[2] + share_b * slope_b + share_c * slope_c
                if near_by > inverse[v, u]:
                    inverse[v, u] = near_by
                    index[v, u] = face
            share_b += db_du
            share_c += dc_du


@njit(cache=True)
def cast_shadow(depth, reach, margin, shadow):
    """Mark what a projector beside the camera cannot reach, row by row.

    A pixel at column u and depth z falls into the projector's column u + reach / z, where reach is
    focal length times the offset of the projector to the left, pixels times metres (negative: to the
    right). What lies nearer and covers that column already hides it.
    """
    height, width = depth.shape
    step = 1 if reach >= 0 else -1
    for v in range(height):
        furthest = -1e9
        # toward the side away from the projector the columns must keep growing
        for i in range(width):
            u = i if step > 0 else width - 1 - i
            z = depth[v, u]
            if z <= 0:
                continue
            column = step * (u + reach / z)
            if column < furthest - margin:
                shadow[v, u] = True
            elif column > furthest:
                furthest = column


@njit(cache=True)
def shade(vertices, faces, index, camera, cosine):
    """Fill the cosine of the angle between each pixel's ray and the normal of its face."""
    for v in range(index.shape[0]):
        for u in range(index.shape[1]):
            f = index[v, u]
            if f < 0:
                continue
            a, b, c = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
            x1, y1, z1 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
            x2, y2, z2 = c[0] - a[0], c[1] - a[1], c[2] - a[2]
            nx, ny, nz = y1 * z2 - z1 * y2, z1 * x2 - x1 * z2, x1 * y2 - y1 * x2
            x, y = ray(camera, u, v)
            size = np.sqrt((nx * nx + ny * ny + nz * nz) * (x * x + y * y + 1.0))
            cosine[v, u] = abs(nx * x + ny * y + nz) / max(size, 1e-18)


@njit(cache=True)
def spread_bsplines(cell, weights):
    """Fill the weights (size, coarse) of cubic B-splines that are ``cell`` pixels apart; 0 elsewhere."""
    for i in range(weights.shape[0]):
        first, squares = int(i / cell), 0.0
        for k in range(first, min(first + 4, weights.shape[1])):
            away = abs(i / cell + 1.0 - k)
            outside = max(2.0 - away, 0.0)
            near = 2.0 / 3.0 - away * away * (1.0 - 0.5 * away)
            weights[i, k] = near if away < 1.0 else outside * outside * outside / 6.0
            squares += weights[i, k] ** 2
        for k in range(first, min(first + 4, weights.shape[1])):
            weights[i, k] /= np.sqrt(squares)


@njit(cache=True)
def nearest_and_farthest(depth, near, far):
    """Fill the least and greatest depth (H, W) of a pixel and its neighbours that have some; 0 for none."""
    height, width = depth.shape
    for v in range(height):
        for u in range(width):
            low, high = np.float32(np.inf), np.float32(0.0)
            for i in range(max(v - 1, 0), min(v + 2, height)):
                for j in range(max(u - 1, 0), min(u + 2, width)):
                    z = depth[i, j]
                    if z > 0.0:
                        low, high = min(low, z), max(high, z)
            near[v, u], far[v, u] = min(low, high), high


@njit(cache=True)
def look_aside(image, down, across, out):
    """Take each pixel (H, W) some rows and columns aside, rounded, or at the border."""
    height, width = image.shape
    for v in range(height):
        for u in range(width):
            i = min(max(v + int(np.rint(down[v, u])), 0), height - 1)
            j = min(max(u + int(np.rint(across[v, u])), 0), width - 1)
            out[v, u] = image[i, j]
