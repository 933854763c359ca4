"""Compiled loop that measures how much of a person has moved between two depth images."""

from __future__ import annotations

from depth_pose.core.kernels import njit

_NOISE_M2 = 0.004
"""A changed area (m^2) below this is noise; that of structured light is .001."""


@njit(cache=True)
def moved_area(before, labels_before, label_before, depth, labels, label, camera, least_m):
    """Return the area (m^2) of a person, now or before, whose depth has changed by more than ``least_m``.

    Only pixels count all of whose neighbours have come nearer, too, or all gone away: the noise of single
    pixels moves nobody, nor that of a silhouette, which does both. Where depth was or is missing the surface
    may have done either. It is 0 where hardly anything has changed in either way (`_NOISE_M2`).
    """
    rows, cols = depth.shape
    moved_m2, changed_m2 = 0.0, 0.0
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
                if changed < 3 * (a + 2):
                    break
            if changed == 9:
                z = depth[i, j] if is_now else before[i, j]
                area = z * z / (camera.fx * camera.fy)
                changed_m2 += area
                if max(nearer, farther) == 9:
                    moved_m2 += area
    return moved_m2 if changed_m2 >= _NOISE_M2 else 0.0
