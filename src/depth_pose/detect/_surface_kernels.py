"""Compiled loops over connected surfaces, for `depth_pose.detect.plane_segmenter`."""

from __future__ import annotations

import numpy as np

from depth_pose.core.kernels import njit


@njit(cache=True)
def label_components(depth, mask, jump):
    """Label the 4-connected surfaces of ``mask`` from 1; 0 elsewhere."""
    rows, cols = depth.shape
    labels = np.zeros((rows, cols), np.int32)
    stack = np.empty((rows * cols, 2), np.int32)
    count = 0
    for i in range(rows):
        for j in range(cols):
            if not mask[i, j] or labels[i, j] != 0:
                continue
            count += 1
            labels[i, j] = count
            stack[0, 0], stack[0, 1] = i, j
            top = 1
            while top > 0:
                top -= 1
                a, b = stack[top, 0], stack[top, 1]
                for k in range(4):
                    c = a + (1 if k == 0 else -1 if k == 1 else 0)
                    d = b + (1 if k == 2 else -1 if k == 3 else 0)
                    if c < 0 or d < 0 or c >= rows or d >= cols or labels[c, d] != 0 or not mask[c, d]:
                        continue
                    if abs(depth[c, d] - depth[a, b]) <= jump:
                        labels[c, d] = count
                        stack[top, 0], stack[top, 1] = c, d
                        top += 1
    return labels, count


@njit(cache=True)
def component_boxes(points, labels, count, focal):
    """Compute area (m^2), bounding box (6), pixel count, and filled share of the image box, from label 1."""
    stats = np.zeros((count, 9))
    box = np.empty((count, 4), np.int64)
    box[:, :2] = 1_000_000
    box[:, 2:] = -1
    stats[:, 1:4] = np.inf
    stats[:, 4:7] = -np.inf
    for i in range(labels.shape[0]):
        for j in range(labels.shape[1]):
            k = labels[i, j] - 1
            if k < 0:
                continue
            stats[k, 0] += (points[i, j, 2] / focal) ** 2
            stats[k, 7] += 1
            box[k, 0], box[k, 1] = min(box[k, 0], i), min(box[k, 1], j)
            box[k, 2], box[k, 3] = max(box[k, 2], i), max(box[k, 3], j)
            for a in range(3):
                stats[k, 1 + a] = min(stats[k, 1 + a], points[i, j, a])
                stats[k, 4 + a] = max(stats[k, 4 + a], points[i, j, a])
    for k in range(count):
        stats[k, 8] = stats[k, 7] / ((box[k, 2] - box[k, 0] + 1) * (box[k, 3] - box[k, 1] + 1))
    return stats


@njit(cache=True)
def touching_components(depth, labels, chosen, small, reach, gap):
    """Mark components, except small ones, within ``reach`` pixels and ``gap`` m of a chosen one."""
    rows, cols = labels.shape
    touching = np.zeros(chosen.shape[0], np.bool_)
    for i in range(rows):
        for j in range(cols):
            k = labels[i, j]
            if k == 0 or chosen[k] or small[k] or touching[k]:
                continue
            for a in range(max(0, i - reach), min(rows, i + reach + 1)):
                for b in range(max(0, j - reach), min(cols, j + reach + 1)):
                    if chosen[labels[a, b]] and abs(depth[a, b] - depth[i, j]) < gap:
                        touching[k] = True
    return touching


@njit(cache=True)
def mark_mixed(depth, labels, person, unknown, gap):
    """Label pixels beside the person as unknown if they are nearer by ``gap`` than what is behind them.

    Such pixels are mixed, or show a limb too thin to be kept; they do not locate the person's border.
    """
    rows, cols = depth.shape
    for i in range(rows):
        for j in range(cols):
            if labels[i, j] == person or labels[i, j] == unknown or depth[i, j] <= 0.0:
                continue
            beside, far = False, depth[i, j]
            for a in range(max(0, i - 1), min(rows, i + 2)):
                for b in range(max(0, j - 1), min(cols, j + 2)):
                    beside |= labels[a, b] == person
                    far = max(far, depth[a, b])
            if beside and depth[i, j] < far - gap:
                labels[i, j] = unknown
