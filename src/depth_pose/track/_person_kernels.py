"""Compiled loops that extract people from a frame, for `depth_pose.track.person_view`."""

from __future__ import annotations

import numpy as np

from depth_pose.core._camera_kernels import ray
from depth_pose.core.kernels import njit
from depth_pose.core.labels import BACKGROUND, HIDDEN, PERSON, UNKNOWN

_BESIDE_M = 0.15
"""Pixels of another person up to this far (m) behind a person's centre may still hide the person."""


@njit(cache=True)
def pack_points(points, labels, numbers, octets):
    """Write points and labels as 16-byte records, (h, w, 4) float32 and (h, w, 16) uint8 of one memory."""
    for i in range(labels.shape[0]):
        for j in range(labels.shape[1]):
            for a in range(3):
                numbers[i, j, a] = points[i, j, a]
            numbers[i, j, 3] = 0.0
            octets[i, j, 12] = labels[i, j]


@njit(cache=True)
def find_boxes(depth, labels, boxes):
    """Write the number of pixels of each label, its first and last row and column, to ``boxes``, (256, 5).

    Here and in the loops below pixels without depth are nobody's.
    """
    boxes[:, 0], boxes[:, 1], boxes[:, 3] = 0, labels.shape[0], labels.shape[1]
    boxes[:, 2], boxes[:, 4] = -1, -1
    for i in range(labels.shape[0]):
        for j in range(labels.shape[1]):
            k = labels[i, j]
            if k != BACKGROUND and depth[i, j] > 0.0:
                boxes[k, 0] += 1
                boxes[k, 1], boxes[k, 2] = min(boxes[k, 1], i), i
                boxes[k, 3], boxes[k, 4] = min(boxes[k, 3], j), max(boxes[k, 4], j)


@njit(cache=True)
def take_depths(depth, labels, label, box, depths):
    """Copy the depths of a person's pixels within a box, in the order of the image; return their mean."""
    count, total = 0, 0.0
    for i in range(box[1], box[2] + 1):
        for j in range(box[3], box[4] + 1):
            if labels[i, j] == label and depth[i, j] > 0.0:
                depths[count] = depth[i, j]
                total += depth[i, j]
                count += 1
    return total / max(count, 1)


@njit(cache=True)
def cut_window(depth, labels, label, distance, top, left, own_depth, own):
    """Write the window that begins at (top, left) from the view of one person ``distance`` metres away."""
    for i in range(own.shape[0]):
        for j in range(own.shape[1]):
            k, z = labels[top + i, left + j], depth[top + i, left + j]
            own_depth[i, j] = 0.0
            if k == label and z > 0.0:
                own[i, j], own_depth[i, j] = PERSON, z
            elif k in (HIDDEN, label) or (k != BACKGROUND and not z > distance + _BESIDE_M):
                own[i, j] = UNKNOWN
            else:
                own[i, j] = BACKGROUND


@njit(cache=True)
def window_points(depth, labels, camera, top, left, most, points):
    """Write the points of the person's pixels of a window, (N, 3), and return their number.

    ``camera`` is that of the whole grid. Returns -1 where a pixel of the person has a depth that is not
    between 0 and ``most``, or a label is none.
    """
    count = 0
    for i in range(labels.shape[0]):
        for j in range(labels.shape[1]):
            if labels[i, j] > UNKNOWN:
                return -1
            if labels[i, j] == PERSON:
                z = depth[i, j]
                if not 0.0 < z <= most:
                    return -1
                x, y = ray(camera, left + j, top + i)
                points[count, 0], points[count, 1] = np.float32(x * z), np.float32(y * z)
                points[count, 2] = z
                count += 1
    return count
