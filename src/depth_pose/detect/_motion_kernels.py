"""Compiled loop that measures how much of a person has moved between two depth images."""

from __future__ import annotations

from depth_pose.core.kernels import njit


@njit(cache=True)
def moved_area(before, labels_before, label_before, depth, labels, label, camera, least_m):
    """Return the area (m^2) of a person, now or before, whose depth has changed by more than ``least_m``.

    Only pixels count with all of whose neighbours the surface has gone away, or come nearer: the noise of
    single pixels, and of the silhouette, which does both, moves nobody. Where depth was or is missing it may
    have done either.
    """
    rows, cols = depth.shape
    area = 0.0
    for i in range(1, rows - 1):
        for j in range(1, cols - 1):
            is_now, was = labels[i, j] == label, labels_before[i, j] == label_before
            if not (is_now or was):
                continue
            nearer, farther = 0, 0
            for a in range(-1, 2):
                for b in range(-1, 2):
                    y, z = before[i + a, j + b], depth[i + a, j + b]
                    is_one = (y > 0.0) != (z > 0.0)
                    nearer += is_one or y - z > least_m
                    farther += is_one or z - y > least_m
                if max(nearer, farther) < 3 * (a + 2):
                    break
            if max(nearer, farther) == 9:
                z = depth[i, j] if is_now else before[i, j]
                area += z * z / (camera.fx * camera.fy)
    return area
