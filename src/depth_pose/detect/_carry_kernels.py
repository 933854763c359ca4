"""Compiled loops that transfer people's pixels from the previous frame, for `last_people`."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from depth_pose.core.kernels import njit
from depth_pose.core.labels import BACKGROUND

_FAR_AWAY = 10_000
"""Number of rings around a pixel within which all labels are the same: the whole image."""


class Before(NamedTuple):
    """The previous frame.

    Attributes
    ----------
    depth : (h, w) float32
        Metres; 0 without depth.
    labels : (h, w) uint8
        Number of each pixel's person.
    """

    depth: Any
    labels: Any


class CarryLimits(NamedTuple):
    """Limits of movement from one frame to the next.

    Attributes
    ----------
    moved, jump : float
        Maximum movement of a point, and step between neighbours on one surface, metres.
    pixels : int
        Maximum movement in the image.
    """

    moved: float
    jump: float
    pixels: int


@njit(cache=True)
def carry_labels(before, depth, camera, limits, labels, is_new):
    """Label every pixel with the person of the nearest point of the previous frame.

    Writes ``labels`` (h, w), and ``is_new`` (h, w) where no point was within ``limits.moved``.
    """
    rows, cols = depth.shape
    most = limits.moved * limits.moved
    uniform = to_other_label(before.labels)
    for i in range(rows):
        for j in range(cols):
            labels[i, j], is_new[i, j] = BACKGROUND, False
            z = depth[i, j]
            if z <= 0.0:
                continue
            pixel, least = z / camera.fx, most
            same = min(most, (uniform[i, j] * pixel) ** 2)  # all points nearer than this have one label
            deep = before.depth[i, j] - z
            if deep * deep < same and before.depth[i, j] > 0.0:  # most pixels
                labels[i, j] = before.labels[i, j]
                continue
            for ring in range(limits.pixels + 1):
                if (ring * pixel) ** 2 >= least or least < same:
                    break
                for a in range(max(0, i - ring), min(rows, i + ring + 1)):
                    step = (
                        1 if abs(a - i) == ring else 2 * ring
                    )  # the upper and lower rows of a ring are complete
                    for b in range(j - ring, j + ring + 1, max(1, step)):
                        if b < 0 or b >= cols or before.depth[a, b] <= 0.0:
                            continue
                        deep = before.depth[a, b] - z
                        apart = ((a - i) ** 2 + (b - j) ** 2) * pixel * pixel + deep * deep
                        if apart < least:
                            least, labels[i, j] = apart, before.labels[a, b]
            is_new[i, j] = least >= most


@njit(cache=True)
def to_other_label(labels):
    """Compute each pixel's distance (rings) to the nearest one with a different label, (h, w) int32."""
    rows, cols = labels.shape
    rings = np.empty((rows, cols), np.int32)
    for i in range(rows):
        above, below = labels[max(i - 1, 0)], labels[min(i + 1, rows - 1)]
        find_borders(above, labels[i], below, rings[i])
    for i in range(rows):
        grow_rings(rings[max(i - 1, 0)], rings[i], 1)
    for i in range(rows - 1, -1, -1):
        grow_rings(rings[min(i + 1, rows - 1)], rings[i], -1)
    return rings


@njit(cache=True)
def find_borders(above, own, below, rings):
    """Write 1 where one of the eight neighbours has another label, else a large number."""
    cols = own.shape[0]
    for j in range(1, cols - 1):
        k = own[j]
        is_same = (own[j - 1] == k) & (own[j + 1] == k)
        is_same &= (above[j - 1] == k) & (above[j] == k) & (above[j + 1] == k)
        is_same &= (below[j - 1] == k) & (below[j] == k) & (below[j + 1] == k)
        rings[j] = _FAR_AWAY if is_same else 1
    rings[0] = rings[cols - 1] = 1


@njit(cache=True)
def grow_rings(before, own, step):
    """Propagate distances, plus one ring, from the previous row and from the previous pixel."""
    cols = own.shape[0]
    for j in range(1, cols - 1):
        own[j] = min(own[j], min(before[j - 1], min(before[j], before[j + 1])) + 1)
    for k in range(1, cols):
        j = k if step > 0 else cols - 1 - k
        own[j] = min(own[j], own[j - step] + 1)


@njit(cache=True)
def count_inside(marked):
    """Count the marked pixels with four marked neighbours; flying edges are too narrow to count."""
    count = 0
    for i in range(1, marked.shape[0] - 1):
        for j in range(1, marked.shape[1] - 1):
            is_upright = marked[i, j] and marked[i - 1, j] and marked[i + 1, j]
            count += is_upright and marked[i, j - 1] and marked[i, j + 1]
    return count


@njit(cache=True)
def take_new(depth, is_new, jump, labels):
    """Add new pixels to the people they are connected to: limbs that moved far, and flying edges.

    A surface continues over neighbours at most ``jump`` apart. Other new pixels that touch a person are added
    as well; `mark_unsupported` removes the flying ones. ``is_new`` is overwritten.
    """
    rows, cols = depth.shape
    queue = np.empty(rows * cols, np.int64)
    last = 0
    for at in range(rows * cols):
        if labels[at // cols, at % cols] != BACKGROUND:
            queue[last] = at
            last += 1
    first = 0
    while first < last:
        i, j = queue[first] // cols, queue[first] % cols
        first += 1
        for a in range(max(0, i - 1), min(rows, i + 2)):
            for b in range(max(0, j - 1), min(cols, j + 2)):
                if is_new[a, b] and abs(depth[a, b] - depth[i, j]) <= jump:
                    labels[a, b], is_new[a, b] = labels[i, j], False
                    queue[last] = a * cols + b
                    last += 1
    for n in range(last):
        i, j = queue[n] // cols, queue[n] % cols
        for a in range(max(0, i - 1), min(rows, i + 2)):
            for b in range(max(0, j - 1), min(cols, j + 2)):
                if is_new[a, b]:
                    labels[a, b] = labels[i, j]


@njit(cache=True)
def middle_of(depth, labels, label, camera, middle):
    """Write the mean (3,) of a person's points, metres; return their number."""
    count = 0
    middle[:] = 0.0
    for i in range(depth.shape[0]):
        for j in range(depth.shape[1]):
            z = depth[i, j]
            if labels[i, j] == label and z > 0.0:
                middle[0] += (j - camera.cx) / camera.fx * z
                middle[1] += (i - camera.cy) / camera.fy * z
                middle[2] += z
                count += 1
    middle /= max(count, 1)
    return count
