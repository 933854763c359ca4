"""Compiled loops that reduce a depth image to the working grid (`depth_pose.detect.working_grid`)."""

from __future__ import annotations

import numpy as np

from depth_pose.core.kernels import njit


@njit(cache=True)
def clip_depth(depth, near, far):
    """Copy a depth image without values that are outside the limits or not finite."""
    out = np.zeros(depth.shape, np.float32)
    for i in range(depth.shape[0]):
        for j in range(depth.shape[1]):
            if depth[i, j] >= near and depth[i, j] <= far:
                out[i, j] = depth[i, j]
    return out


@njit(cache=True)
def reduce_depth(depth, stride, jump, near, far):
    """Average blocks of ``stride`` x ``stride`` pixels over the surface of their median depth.

    A block with less than half of its pixels valid becomes a hole. Statistics of each block are first summed
    down its columns, over whole rows of the image, so that the loop over all pixels is vectorised.
    """
    rows, cols = depth.shape[0] // stride, depth.shape[1] // stride
    near, far, jump = np.float32(near), np.float32(far), np.float32(jump)
    out = np.zeros((rows, cols), np.float32)
    columns = np.empty((4, cols * stride), np.float32)  # count, sum, least, greatest
    blocks = np.empty((4, cols), np.float32)
    mixed, counts = np.empty(cols, np.int64), np.empty(cols, np.int64)
    values, means = np.empty((stride * stride, cols), np.float32), np.empty(cols, np.float32)
    for i in range(rows):
        part = depth[i * stride : (i + 1) * stride]
        sum_columns(part, near, far, columns)
        if stride == 2:  # the common case; with a constant stride the loop is vectorised
            sum_blocks(columns, 2, blocks)
        elif stride == 3:
            sum_blocks(columns, 3, blocks)
        else:
            sum_blocks(columns, stride, blocks)
        mean_blocks(blocks, np.float32(0.5 * stride * stride), out[i])
        found = 0
        for j in range(cols):
            mixed[found], counts[found] = j, int(blocks[0, j])
            found += (blocks[3, j] - blocks[2, j] > jump) & (out[i, j] > 0)  # more than one surface
        if found == 0:
            continue
        for a in range(stride):
            for b in range(stride):
                take_columns(part[a], mixed[:found], stride, b, near, far, values[a * stride + b])
        sort_columns(values, found)
        mean_near_middle(values, counts[:found], jump, means)
        for k in range(found):
            out[i, mixed[k]] = means[k]
    return out


@njit(cache=True)
def take_columns(row, blocks, stride, offset, near, far, out):
    """Copy one pixel of each of the ``blocks`` of a row; infinite if not valid."""
    for k in range(blocks.shape[0]):
        z = np.float32(row[blocks[k] * stride + offset])
        out[k] = z if (z >= near) & (z <= far) else np.float32(np.inf)


@njit(cache=True, inline="always")
def sum_blocks(columns, stride, out):
    """Compute count, sum, least and greatest depth of each ``stride`` columns, into ``out`` (4, cols)."""
    count, total, least, most = out[0], out[1], out[2], out[3]
    for j in range(out.shape[1]):
        n, s, low, high = np.float32(0.0), np.float32(0.0), np.float32(np.inf), np.float32(0.0)
        for b in range(stride):
            n += columns[0, j * stride + b]
            s += columns[1, j * stride + b]
            less, more = columns[2, j * stride + b], columns[3, j * stride + b]
            low, high = less if less < low else low, more if more > high else high
        count[j], total[j], least[j], most[j] = n, s, low, high


@njit(cache=True)
def mean_blocks(blocks, fewest, out):
    """Compute the mean of each block with at least ``fewest`` valid pixels; 0 for the others."""
    count, total = blocks[0], blocks[1]
    for j in range(out.shape[0]):
        mean = total[j] / max(count[j], np.float32(1.0))
        out[j] = mean if count[j] >= fewest else np.float32(0.0)


@njit(cache=True)
def sort_columns(values, count):
    """Sort each of the first columns of (n, k); whole rows are compared and exchanged, to be vectorised."""
    for last in range(1, values.shape[0]):
        for at in range(last, 0, -1):
            order_rows(values[at - 1, :count], values[at, :count])


@njit(cache=True)
def order_rows(low, high):
    """Move the lesser of each two into ``low``; a separate function, so that the loop is vectorised."""
    for k in range(low.shape[0]):
        a, b = low[k], high[k]
        low[k] = a if a < b else b
        high[k] = b if a < b else a


@njit(cache=True)
def mean_near_middle(ordered, counts, reach, means):
    """Compute the mean of the values of each sorted column that lie within ``reach`` of the median.

    Column k has ``counts[k]`` values; the rest is infinite.
    """
    middle, near = np.empty(counts.shape[0], np.float32), np.zeros(counts.shape[0], np.float32)
    for k in range(counts.shape[0]):
        middle[k], means[k] = ordered[counts[k] // 2, k], 0.0
    for n in range(ordered.shape[0]):
        add_near(ordered[n], middle, reach, means, near)
    for k in range(counts.shape[0]):
        means[k] /= near[k]


@njit(cache=True)
def add_near(values, middle, reach, total, count):
    """Add and count the values that lie within ``reach`` of their ``middle``."""
    for k in range(count.shape[0]):
        is_near = abs(values[k] - middle[k]) <= reach
        total[k] += values[k] if is_near else np.float32(0.0)
        count[k] += np.float32(1.0) if is_near else np.float32(0.0)


@njit(cache=True)
def sum_columns(depth, near, far, out):
    """Compute count, sum, least and greatest valid depth of every column of some rows, into ``out``."""
    count, total, least, most = out[0], out[1], out[2], out[3]
    width = out.shape[1]
    count[:], total[:], least[:], most[:] = 0.0, 0.0, np.inf, 0.0
    for a in range(depth.shape[0]):
        row = depth[a]
        for b in range(width):
            z = np.float32(row[b])
            valid = (z >= near) & (z <= far)
            low, high = z if valid else np.float32(np.inf), z if valid else np.float32(0.0)
            count[b] += np.float32(1.0) if valid else np.float32(0.0)
            total[b] += high
            least[b] = low if low < least[b] else least[b]
            most[b] = high if high > most[b] else most[b]
