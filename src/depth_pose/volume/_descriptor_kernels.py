"""Kernels of `depth_pose.volume.descriptor`."""

from __future__ import annotations

import numpy as np

from depth_pose.core.kernels import njit


@njit(cache=True)
def count_fine(points, axis, scale, top, outer, fine):
    """Add every point (y up) to its bins of height and radius, softly, and of fine azimuth.

    ``fine`` is (heights, radii, azimuths); the azimuth is atan2(x, z) about the vertical through ``axis``.
    """
    fine[:] = 0.0
    n_h, n_r, n_fine = fine.shape
    for p in range(points.shape[0]):
        dx, dz = points[p, 0] - axis[0], points[p, 2] - axis[2]
        a = np.arctan2(dx, dz) / (2.0 * np.pi) * n_fine - 0.5
        a0 = int(np.floor(a))
        wa = a - a0
        a1 = (a0 + 1) % n_fine
        a0 = a0 % n_fine
        h = min(max(points[p, 1] * scale / top * n_h - 0.5, 0.0), n_h - 1.0)
        r = min(max(np.sqrt(dx * dx + dz * dz) * scale / outer * n_r - 0.5, 0.0), n_r - 1.0)
        h0, r0 = int(h), int(r)
        wh, wr = h - h0, r - r0
        for i in range(2):
            u = wh if i else 1.0 - wh
            if u == 0.0:
                continue
            for j in range(2):
                w = u * (wr if j else 1.0 - wr)
                if w == 0.0:
                    continue
                line = fine[h0 + i, r0 + j]
                line[a0] += w * (1.0 - wa)
                line[a1] += w * wa


@njit(cache=True)
def sum_rotations(fine, n_a, out):
    """Descriptors of all headings from cumulative sums; (n_fine, n_h * n_a * n_r)."""
    n_h, n_r, n_fine = fine.shape
    width = n_fine // n_a
    total = fine.sum()
    sums = np.empty(2 * n_fine + 1)
    for i in range(n_h):
        for j in range(n_r):
            sums[0] = 0.0
            for f in range(2 * n_fine):
                sums[f + 1] = sums[f] + fine[i, j, f % n_fine]
            for s in range(n_fine):
                for a in range(n_a):
                    first = (s + a * width) % n_fine
                    share = max(sums[first + width] - sums[first], 0.0) / total
                    out[s, (i * n_a + a) * n_r + j] = np.sqrt(share)
