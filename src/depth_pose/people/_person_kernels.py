"""Compiled loop that takes a person out of a cloud; `depth_pose.people.person` uses it."""

from __future__ import annotations

from numba import njit


@njit(cache=True)
def take_person(points, labels, label, taken, depth):
    """Copy the person's points to ``taken`` and their depths to an image; returns their number."""
    count = 0
    for i in range(labels.shape[0]):
        for j in range(labels.shape[1]):
            depth[i, j] = 0.0
            if labels[i, j] == label:
                depth[i, j] = points[i, j, 2]
                for a in range(3):
                    taken[count, a] = points[i, j, a]
                count += 1
    return count
