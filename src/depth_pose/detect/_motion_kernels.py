"""Compiled loop that measures how much of a person has moved between two depth images."""

from __future__ import annotations

from depth_pose.core.kernels import njit


@njit(cache=True)
def moved_area(before, labels_before, label_before, depth, labels, label, camera, least_m, one_way):
    """Return the area (m^2) of a person, now or before, whose depth has changed by more than ``least_m``.

    Only pixels count all of whose neighbours have changed, too: the noise of single pixels and of the
    silhouette moves nobody. ``one_way``: all of them must have come nearer, or all gone away, since a noisy
    silhouette does both; where depth was or is missing the surface may have done either.
    """
    rows, cols = depth.shape
    area = 0.0
    for i in range(1, rows - 1):
        for j in range(1, cols - 1):
            is_now, was = labels[i, j] == label, labels_before[i, j] == label_before
            if not (is_now or was):
                continue
            changed, nearer, farther = 0, 0, 0
            for a in range(-1, 2):
                for b in range(-1, 2):
                    y, z = before[i + a, j + b], depth[i + a, j + b]
                    is_one = (y > 0.0) != (z > 0.0)
                    changed += is_one or abs(z - y) > least_m
                    nearer += is_one or y - z > least_m
                    farther += is_one or z - y > least_m
                count = max(nearer, farther) if one_way else changed
                if count < 3 * (a + 2):
                    break
            if count == 9:
                z = depth[i, j] if is_now else before[i, j]
                area += z * z / (camera.fx * camera.fy)
    return area
