"""Compiled loops that transfer labels from the net's image to another grid (`depth_pose.detect.outline`).

``image`` is a `NetImage`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from depth_pose.core.kernels import njit

_SAME_M = 0.1
"""Pixels of two grids that differ by less in depth (m) show the same surface."""

_LEAST_CHANCE = 0.35
"""Person probability from which a pixel belongs to a person, as for votes; higher values lose shanks below
a desk."""

_SOFT_PX2, _SOFT_M = 0.25, 0.03
"""Scales of the weight of a net pixel: squared distance (px^2) and depth difference (m) at which it is
halved."""


class Marks(NamedTuple):
    """Masks of the net's pixels: near a person, and the label of those inside one (`mark_near`)."""

    near: Any
    solid: Any


@njit(cache=True)
def mark_near(labels, chance, least, rows, cols, near, solid):
    """Mark pixels within one pixel of a person or of a ``chance`` of ``least``, and the interiors of people.

    ``chance`` becomes 0 elsewhere. ``solid`` holds the label of pixels whose eight neighbours all belong to
    the same person with more than even probability; 0 for all others.
    """
    near[:] = False
    solid[:] = 0
    for i in range(rows):
        for j in range(cols):
            if labels[i, j] == 0 and not chance[i, j] >= least:
                chance[i, j] = 0.0
                continue
            same = True
            for a in range(max(0, i - 1), min(rows, i + 2)):
                for b in range(max(0, j - 1), min(cols, j + 2)):
                    near[a, b] = True
                    same &= labels[a, b] == labels[i, j] and chance[a, b] >= 0.5
            if same:
                solid[i, j] = labels[i, j]


@njit(cache=True)
def carry_labels(depth, camera, image, labels, net_chance, marks, out, chance):
    """Transfer labels (0: background) from the net's image to another grid, ``depth`` with its ``camera``.

    A pixel takes the weighted vote of the nine net pixels around it, near ones in image and depth weighing
    more. ``chance`` becomes the person probability there, -1 where no net pixel has this depth. Where all
    nine agree (``solid``) no weights are computed.
    """
    net_depth, rows, cols = image.depth, image.rows, image.cols
    near, solid = marks.near, marks.solid
    ratio = image.camera.fx / camera.fx
    offset_x, offset_y = image.camera.cx - ratio * camera.cx, image.camera.cy - ratio * camera.cy
    same, soft = np.float32(_SAME_M), np.float32(_SOFT_M)
    votes = np.zeros(256, np.float32)
    seen = np.empty(9, np.int64)
    for i in range(depth.shape[0]):
        y = i * ratio + offset_y
        a0 = min(rows - 1, max(0, int(np.floor(y + 0.5))))
        for j in range(depth.shape[1]):
            x = j * ratio + offset_x
            b0 = min(cols - 1, max(0, int(np.floor(x + 0.5))))
            out[i, j] = 0
            chance[i, j] = 0.0
            z = depth[i, j]
            if z <= 0.0 or not near[a0, b0]:
                continue
            if solid[a0, b0] > 0 and abs(net_depth[a0, b0] - z) <= same:
                out[i, j], chance[i, j] = solid[a0, b0], net_chance[a0, b0]
                continue
            total, sure, count = np.float32(0.0), np.float32(0.0), 0
            for a in range(max(0, a0 - 1), min(rows, a0 + 2)):
                aside_y = np.float32(_SOFT_PX2 + (a - y) * (a - y))
                for b in range(max(0, b0 - 1), min(cols, b0 + 2)):
                    off = abs(net_depth[a, b] - z)
                    if net_depth[a, b] <= 0.0 or off > same:
                        continue
                    aside_x = np.float32(b - x)
                    weight = np.float32(1.0) / ((aside_y + aside_x * aside_x) * (soft + off))
                    total += weight
                    sure += weight * net_chance[a, b]
                    who = labels[a, b]
                    if who > 0:
                        if votes[who] == 0.0:
                            seen[count] = who
                            count += 1
                        votes[who] += weight
            best, chosen = np.float32(0.0), 0
            for k in range(count):
                if votes[seen[k]] > best:
                    best, chosen = votes[seen[k]], seen[k]
                votes[seen[k]] = 0.0
            chance[i, j] = sure / total if total > 0.0 else np.float32(-1.0)
            if chance[i, j] >= _LEAST_CHANCE:
                out[i, j] = chosen


@njit(cache=True)
def grow_labels(depth, labels, chance, least, jump, pixels, queue):
    """Grow people along their surfaces into pixels that are not clearly background.

    A step leads to one of four neighbours with ``chance`` of at least ``least`` (or unknown, -1) whose depth
    differs by less than ``jump`` per metre of distance; at most ``pixels`` / distance steps.
    """
    rows, cols = depth.shape
    count = 0
    for i in range(rows):
        for j in range(cols):
            if labels[i, j] > 0:
                queue[count] = i * cols + j
                count += 1
    begin = 0
    for step in range(1_000):
        end = count
        if begin == end:
            break
        for k in range(begin, end):
            i, j = queue[k] // cols, queue[k] % cols
            z = depth[i, j]
            if step * z > pixels:
                continue
            for d in range(4):
                a = i + (1 if d == 0 else -1 if d == 1 else 0)
                b = j + (1 if d == 2 else -1 if d == 3 else 0)
                if a < 0 or b < 0 or a >= rows or b >= cols or labels[a, b] != 0 or depth[a, b] <= 0.0:
                    continue
                if abs(depth[a, b] - z) < jump * z and (chance[a, b] < 0.0 or chance[a, b] >= least):
                    labels[a, b] = labels[i, j]
                    queue[count] = a * cols + b
                    count += 1
        begin = end
