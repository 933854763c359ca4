"""Compiled z-buffer, used by `depth_pose.body.rendered_depth`.

The loops replace branches by arithmetic where both outcomes are frequent, as in back-face tests and the
pixels of a small box: with thousands of faces a frame, branch mispredictions cost more than the arithmetic.
"""

from __future__ import annotations

import numpy as np

from depth_pose.core._camera_kernels import project
from depth_pose.core.kernels import njit

NEAR_M = 0.05
"""Surfaces nearer to the camera than this are not drawn, metres: no sensor sees them."""

_FAR_PX = 1e6
"""Distance from the image (pixels) beyond which a coordinate is clipped, to keep it finite."""


@njit(cache=True, fastmath=True, forceinline=True)
def rasterize(vertices, faces, camera, zbuffer):
    """Draw a mesh in the camera frame into ``zbuffer``, which is cleared to infinity first."""
    rows, cols = zbuffer.shape
    zbuffer[:] = 0.0  # holds inverse depths, which are linear in the image, until the end
    n, m = vertices.shape[0], faces.shape[0]
    image = np.empty((n, 4), np.float32)
    for i in range(n):
        z = vertices[i, 2] if vertices[i, 2] > NEAR_M else -1.0
        u, v = project(camera, vertices[i, 0], vertices[i, 1], z)
        image[i, 0], image[i, 1] = min(max(u, -_FAR_PX), _FAR_PX), min(max(v, -_FAR_PX), _FAR_PX)
        image[i, 2] = 1.0 / z
    # faces that look at the camera and have a pixel in their box
    front = np.empty(m + 1, np.int32)
    areas = np.empty(m + 1, np.float32)
    boxes = np.empty((m + 1, 4), np.int32)
    count = np.int64(0)
    right, bottom = np.float32(cols - 1), np.float32(rows - 1)
    for k in range(m):
        a, b, c = np.uint32(faces[k, 0]), np.uint32(faces[k, 1]), np.uint32(faces[k, 2])
        ua, va, ub, vb = image[a, 0], image[a, 1], image[b, 0], image[b, 1]
        uc, vc = image[c, 0], image[c, 1]
        area = (ub - ua) * (vc - va) - (uc - ua) * (vb - va)
        low_j = np.int32(np.ceil(max(np.float32(0.0), min(ua, ub, uc))))
        high_j = np.int32(np.floor(min(right, max(ua, ub, uc))))
        low_i = np.int32(np.ceil(max(np.float32(0.0), min(va, vb, vc))))
        high_i = np.int32(np.floor(min(bottom, max(va, vb, vc))))
        at = np.uint32(count)
        front[at] = k
        areas[at] = area
        boxes[at, 0], boxes[at, 1], boxes[at, 2], boxes[at, 3] = low_j, high_j, low_i, high_i
        # y points down: outward faces that are seen turn clockwise
        count += np.int64(area < 0.0) & np.int64(low_j <= high_j) & np.int64(low_i <= high_i)
    one, none = np.float32(1.0), np.float32(0.0)
    for f in range(count):
        face = faces[front[f]]
        a, b, c = np.uint32(face[0]), np.uint32(face[1]), np.uint32(face[2])
        ua, va, wa = image[a, 0], image[a, 1], image[a, 2]
        ub, vb, wb = image[b, 0], image[b, 1], image[b, 2]
        uc, vc, wc = image[c, 0], image[c, 1], image[c, 2]
        if min(wa, wb, wc) < 0.0:  # reaches behind the camera
            continue
        low_j, high_j, low_i, high_i = boxes[f, 0], boxes[f, 1], boxes[f, 2], boxes[f, 3]
        # barycentric weights go up by a fixed step from pixel to pixel
        inverse = one / areas[f]
        left, top = np.float32(low_j), np.float32(low_i)
        s_j, t_j = (vb - vc) * inverse, (vc - va) * inverse
        s_i, t_i = (uc - ub) * inverse, (ua - uc) * inverse
        s_row = ((ub - left) * (vc - top) - (uc - left) * (vb - top)) * inverse
        t_row = ((uc - left) * (va - top) - (ua - left) * (vc - top)) * inverse
        for i in range(np.uint32(low_i), np.uint32(high_i + 1)):
            s, t = s_row, t_row
            for j in range(np.uint32(low_j), np.uint32(high_j + 1)):
                r = one - s - t
                w = s * wa + t * wb + r * wc
                zbuffer[i, j] = max(zbuffer[i, j], w if min(s, t, r) >= none else none)
                s += s_j
                t += t_j
            s_row += s_i
            t_row += t_i
    for i in range(rows):
        for j in range(cols):
            w = zbuffer[i, j]
            zbuffer[i, j] = one / w if w > none else np.float32(np.inf)


@njit(cache=True)
def compare(zbuffer, depth, labels, band, out):
    """Rendered-depth score: mean of min(|dz|, band) / band over the union of the silhouettes.

    A pixel in only one silhouette counts 1; pixels where nothing is known are left out. Writes
    to ``out``: the score; over the overlap, the mean |dz| cut at the band and the mean dz cut at
    three bands; and the silhouettes' difference in mean column and row, observed less drawn.
    """
    total, count, gap, signed, overlap = 0.0, 0, 0.0, 0.0, 0
    drawn_j, drawn_i, drawn_count, seen_j, seen_i, seen_count = 0.0, 0.0, 0, 0.0, 0.0, 0
    for i in range(depth.shape[0]):
        for j in range(depth.shape[1]):
            label = labels[i, j]
            drawn = zbuffer[i, j] < np.inf
            if label == 2:
                continue
            if drawn:
                drawn_i += i
                drawn_j += j
                drawn_count += 1
            if label == 1:
                seen_i += i
                seen_j += j
                seen_count += 1
                count += 1
                if drawn:
                    dz = depth[i, j] - zbuffer[i, j]
                    signed += min(max(dz, -3.0 * band), 3.0 * band)
                    cut = min(abs(dz), band)
                    total += cut / band
                    gap += cut
                    overlap += 1
                else:
                    total += 1.0
            elif drawn:
                count += 1
                total += 1.0
    out[0] = total / max(count, 1)
    out[1] = gap / max(overlap, 1)
    out[2] = signed / max(overlap, 1)
    out[3] = out[4] = 0.0
    if drawn_count > 0 and seen_count > 0:
        out[3] = seen_j / seen_count - drawn_j / drawn_count
        out[4] = seen_i / seen_count - drawn_i / drawn_count


@njit(cache=True)
def score_mesh(vertices, faces, observed, band, zbuffer, out):
    """Render a mesh and compare it with an observation.

    Writes to ``out``: the score and the mean |dz| as `compare` does, and the translation that would bring
    the silhouettes and the mean depths together, metres.
    """
    camera, z = observed.camera, 0.0
    rasterize(vertices, faces, camera, zbuffer)
    compare(zbuffer, observed.depth, observed.labels, band, out)
    for i in range(vertices.shape[0]):
        z += vertices[i, 2]
    z /= vertices.shape[0]
    deeper = out[2]
    out[2], out[3], out[4] = out[3] * z / camera.fx, out[4] * z / camera.fy, deeper
