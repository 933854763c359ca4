"""Compiled loops that extract one person from a frame, for `depth_pose.track.person`."""

from __future__ import annotations

from depth_pose.core.kernels import njit
from depth_pose.core.types import BACKGROUND, HIDDEN, PERSON, UNKNOWN

_BESIDE_M = 0.15
"""Pixels of another person up to this far (m) behind a person's centre may still hide the person."""


@njit(cache=True)
def unpack_points(numbers, octets, is_person, most, points, labels):
    """Copy points and labels of 16-byte records, (h, w, 4) float32 and (h, w, 16) uint8 of the same memory.

    Returns the flat index of the first point of a person (``is_person`` (256,)) with a number that is NaN or
    beyond ``most``, or -1.
    """
    rows, cols = labels.shape
    bad = -1
    for i in range(rows):
        for j in range(cols):
            x, y, z, label = numbers[i, j, 0], numbers[i, j, 1], numbers[i, j, 2], octets[i, j, 12]
            points[i, j, 0], points[i, j, 1], points[i, j, 2], labels[i, j] = x, y, z, label
            if is_person[label] and not (abs(x) <= most and abs(y) <= most and abs(z) <= most) and bad < 0:
                bad = i * cols + j
    return bad


@njit(cache=True)
def pack_points(points, labels, numbers, octets):
    """Write points and labels as 16-byte records, as `unpack_points` reads them."""
    for i in range(labels.shape[0]):
        for j in range(labels.shape[1]):
            for a in range(3):
                numbers[i, j, a] = points[i, j, a]
            numbers[i, j, 3] = 0.0
            octets[i, j, 12] = labels[i, j]


@njit(cache=True)
def take_person(points, labels, label, taken, depth):
    """Copy a person's points to ``taken`` and their depths to an image; return the number of points."""
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


@njit(cache=True)
def label_for(points, labels, label, distance, own):
    """Write the label of each pixel from the view of one person, whose centre is ``distance`` metres away."""
    for i in range(labels.shape[0]):
        for j in range(labels.shape[1]):
            k = labels[i, j]
            if k == label:
                own[i, j] = PERSON
            elif k == HIDDEN or (k != BACKGROUND and not points[i, j, 2] > distance + _BESIDE_M):
                own[i, j] = UNKNOWN
            else:
                own[i, j] = BACKGROUND
