"""Compiled loops of the segmentation; `depth_pose.people.plane_segmenter` says what they are for."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from depth_pose.core.types import BACKGROUND, HIDDEN

_FLOOR_STEPS = 2.0
"""Of a level floor one metre below the camera, neighbouring rows differ by z^2 / f; this many times that is
no floor any more."""

_HIDES_M = 0.6
"""How far beside a person's pixels something nearer may hide more of them: a limb's length, metres."""


@njit(cache=True)
def clip_depth(depth, near, far):
    """Copy a depth image without what lies outside the limits, or is not finite."""
    out = np.zeros(depth.shape, np.float32)
    for i in range(depth.shape[0]):
        for j in range(depth.shape[1]):
            if depth[i, j] >= near and depth[i, j] <= far:
                out[i, j] = depth[i, j]
    return out


@njit(cache=True)
def reduce_depth(depth, stride, jump, near, far):
    """Average blocks of ``stride`` x ``stride`` pixels over the surface of their median depth."""
    rows, cols = depth.shape[0] // stride, depth.shape[1] // stride
    out = np.zeros((rows, cols), np.float32)
    block = np.empty(stride * stride, np.float32)
    for i in range(rows):
        for j in range(cols):
            n, total, least, most = 0, 0.0, np.float32(np.inf), np.float32(0.0)
            for a in range(i * stride, (i + 1) * stride):
                for b in range(j * stride, (j + 1) * stride):
                    z = depth[a, b]
                    if z >= near and z <= far:
                        block[n] = z
                        n += 1
                        total += z
                        least, most = min(least, z), max(most, z)
            if 2 * n < stride * stride or n == 0:
                continue
            out[i, j] = total / n if most - least <= jump else near_median(block[:n], jump)
    return out


@njit(cache=True)
def near_median(values, reach):
    """Mean of the values within ``reach`` of the median; sorts them."""
    for n in range(1, values.shape[0]):  # in place: sorting by insertion suits so few
        value, k = values[n], n
        while k > 0 and values[k - 1] > value:
            values[k] = values[k - 1]
            k -= 1
        values[k] = value
    middle = values[values.shape[0] // 2]
    total, count = 0.0, 0
    for value in values:
        if abs(value - middle) <= reach:
            total += value
            count += 1
    return total / count


@njit(cache=True)
def draw_samples(points, most, reach, focal):
    """Take about ``most`` points of smooth surfaces, evenly over the image.

    Normals come from the neighbours ``reach`` pixels away; where one is missing there is no sample.
    Returns points (n, 3), unit normals (n, 3) and the areas (n,) that the samples would cover if they
    faced the camera, square metres.
    """
    rows, cols = points.shape[:2]
    valid = 0
    for i in range(rows):
        for j in range(cols):
            valid += points[i, j, 2] == points[i, j, 2]
    step = max(1, valid // most)
    room = valid // step + 1
    samples, normals, areas = np.empty((room, 3)), np.empty((room, 3)), np.empty(room)
    normal = np.empty(3)
    count, seen = 0, 0
    for i in range(rows):
        for j in range(cols):
            if points[i, j, 2] != points[i, j, 2]:
                continue
            seen += 1
            if (seen - 1) % step == 0 and normal_at(points, i, j, reach, normal):
                for a in range(3):
                    samples[count, a], normals[count, a] = points[i, j, a], normal[a]
                areas[count] = step * (samples[count, 2] / focal) ** 2
                count += 1
    return samples[:count], normals[:count], areas[:count]


@njit(cache=True)
def normal_at(points, i, j, reach, normal):
    """Find the unit normal at a pixel from neighbours ``reach`` away; False where one is missing."""
    if i < reach or j < reach or i + reach >= points.shape[0] or j + reach >= points.shape[1]:
        return False
    e0, e1, e2 = points[i, j + reach] - points[i, j - reach]
    f0, f1, f2 = points[i + reach, j] - points[i - reach, j]
    n0, n1, n2 = e1 * f2 - e2 * f1, e2 * f0 - e0 * f2, e0 * f1 - e1 * f0
    norm = np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
    if not norm > 0.0:  # a neighbour is NaN
        return False
    normal[0], normal[1], normal[2] = n0 / norm, n1 / norm, n2 / norm
    return True


@njit(cache=True)
def is_inlier(p, n, plane, tolerance):
    """Whether a point lies on a plane and its surface faces the plane's way, within 37 degrees."""
    off = plane[0] * p[0] + plane[1] * p[1] + plane[2] * p[2] - plane[3]
    along = plane[0] * n[0] + plane[1] * n[1] + plane[2] * n[2]
    return abs(off) < tolerance * p[2] and abs(along) > 0.8


@njit(cache=True)
def plane_inliers(samples, normals, areas, plane, tolerance):
    """Which samples lie on a plane, and their area on it.

    ``areas`` are what the samples would cover if they faced the camera.
    """
    on = np.zeros(samples.shape[0], np.bool_)
    total = 0.0
    for i in range(samples.shape[0]):
        p = samples[i]
        on[i] = is_inlier(p, normals[i], plane, tolerance)
        if on[i]:
            slant = abs(plane[3]) / np.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
            total += areas[i] / max(slant, 0.25)
    return on, total


@njit(cache=True)
def moments(samples, on):
    """Count, mean (3,) and covariance (3, 3) of some of the samples."""
    count, mean, square = 0, np.zeros(3), np.zeros((3, 3))
    for i in range(samples.shape[0]):
        if on[i]:
            count += 1
            for a in range(3):
                mean[a] += samples[i, a]
    mean /= max(count, 1)
    for i in range(samples.shape[0]):
        if on[i]:
            for a in range(3):
                for b in range(3):
                    square[a, b] += (samples[i, a] - mean[a]) * (samples[i, b] - mean[b])
    return count, mean, square / max(count - 1, 1)


@njit(cache=True)
def best_plane(samples, normals, areas, seeds, tolerance):
    """Plane (n, d), ``n . p = d``, through one of the seeds along its normal, with the most area."""
    best = np.zeros(4)
    most = 0.0
    plane = np.empty(4)
    for seed in seeds:
        plane[:3] = normals[seed]
        plane[3] = (normals[seed] * samples[seed]).sum()
        area = plane_inliers(samples, normals, areas, plane, 2.0 * tolerance)[1]
        if area > most:
            most = area
            best[:] = plane
    return best


@njit(cache=True)
def mark_plane(points, plane, tolerance, window, out):
    """Set ``out`` where a pixel and at least half of its window's pixels lie on the plane."""
    rows, cols = points.shape[:2]
    on = np.zeros((rows, cols), np.bool_)
    # sums over all pixels above and to the left: of those on the plane less half of the valid ones
    sums = np.zeros((rows + 1, cols + 1), np.int32)
    for i in range(rows):
        row = 0
        for j in range(cols):
            z = points[i, j, 2]
            if z == z:
                r = plane[0] * points[i, j, 0] + plane[1] * points[i, j, 1] + plane[2] * z - plane[3]
                on[i, j] = abs(r) < tolerance * z
                row += 1 if on[i, j] else -1
            sums[i + 1, j + 1] = sums[i, j + 1] + row
    for i in range(rows):
        top, bottom = max(0, i - window), min(rows, i + window + 1)
        for j in range(cols):
            if on[i, j]:
                left, right = max(0, j - window), min(cols, j + window + 1)
                more = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
                if more >= 0:
                    out[i, j] = True


@njit(cache=True)
def label_components(depth, mask, jump):
    """Give numbers to the 4-connected surfaces of ``mask`` from 1; 0 elsewhere."""
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
    """Area (m^2), bounding box (6), pixel count, and filled share of the image box, from label 1."""
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
    """Mark components, other than the small ones, within ``reach`` pixels and ``gap`` m of a chosen one."""
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
def filter_support(depth, mask, jump, least):
    """Keep the pixels of ``mask`` with at least ``least`` of 24 neighbours within ``jump`` in depth."""
    rows, cols = depth.shape
    out = np.zeros((rows, cols), np.bool_)
    for i in range(rows):
        for j in range(cols):
            if not mask[i, j]:
                continue
            support = -1
            for a in range(max(0, i - 2), min(rows, i + 3)):
                for b in range(max(0, j - 2), min(cols, j + 3)):
                    if mask[a, b] and abs(depth[a, b] - depth[i, j]) <= jump:
                        support += 1
            out[i, j] = support >= least
    return out


@njit(cache=True)
def mark_mixed(depth, labels, person, unknown, gap):
    """Label as unknown what lies beside the person and nearer by ``gap`` than what is behind it.

    Such pixels saw both, or a limb too thin to be kept: they say nothing about where the person ends.
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


@njit(cache=True)
def mark_nearer(depth, labels, camera, gap):
    """Label as hidden what is nearer than the person beside it, and may hide more of them.

    From each border pixel of a person the image is followed `_HIDES_M` far. Something hides from where the
    depth drops by more than ``gap``, and than the floor's can, to where it is no longer nearer by ``gap``.
    The floor itself, which rises to the feet without a step, hides nothing.
    """
    rows, cols = depth.shape
    hides = np.zeros((rows, cols), np.bool_)
    for i in range(rows):
        for j in range(cols):
            if labels[i, j] in (BACKGROUND, HIDDEN):
                continue
            z = depth[i, j]
            reach, step = int(_HIDES_M * camera.fx / z), max(gap, _FLOOR_STEPS * z * z / camera.fy)
            for way in range(4):
                di = 1 if way == 0 else -1 if way == 1 else 0
                dj = 1 if way == 2 else -1 if way == 3 else 0
                before, is_behind = z, False
                for n in range(1, reach + 1):
                    a, b = i + n * di, j + n * dj
                    if a < 0 or b < 0 or a >= rows or b >= cols or labels[a, b] == labels[i, j]:
                        break
                    d = depth[a, b]
                    if d <= 0.0:
                        continue
                    is_behind = d < z - gap and (is_behind or d < before - step)
                    if is_behind and labels[a, b] == BACKGROUND:
                        hides[a, b] = True
                    before = d
    for i in range(rows):
        for j in range(cols):
            if hides[i, j]:
                labels[i, j] = HIDDEN


class LimbLimits(NamedTuple):
    """What `attach_limbs` takes for a limb.

    Attributes
    ----------
    jump : float
        Greatest step in depth between neighbours, metres.
    area, width : float
        Greatest area, square metres, and mean width, metres.
    chance : float
        Least mean chance of a person.
    """

    jump: float
    area: float
    width: float
    chance: float


@njit(cache=True)
def attach_limbs(depth, labels, chance, camera, limits):
    """Give people the small surfaces that go on from theirs: limbs that the net took for something else.

    From every person's border, what is nobody's is followed over neighbours at most ``limits.jump`` apart
    in ``depth``, in which floor and walls are 0. A surface of less than ``limits.area`` square metres and
    of a limb's width and chance is theirs; all else is furniture and stays nobody's.
    """
    rows, cols = depth.shape
    size = rows * cols
    seen = np.zeros(size, np.uint8)  # 1: on the present surface, 2: on one that is too large
    flat_depth, flat, flat_chance = depth.ravel(), labels.ravel(), chance.ravel()
    queue = np.empty(size, np.int64)
    pixel = 1.0 / (camera.fx * camera.fy)
    for start in range(size):
        if flat[start] != BACKGROUND or flat_depth[start] <= 0.0 or seen[start] != 0:
            continue
        owner = beside_person(flat_depth, flat, start, cols, limits.jump)
        if owner == BACKGROUND:
            continue
        queue[0], seen[start] = start, 1
        first, last, area, total = 0, 1, 0.0, 0.0
        is_small = True
        while first < last and is_small:
            at = queue[first]
            first += 1
            area += flat_depth[at] * flat_depth[at] * pixel
            total += flat_chance[at]
            is_small = area <= limits.area
            i, j = at // cols, at % cols
            for a in range(max(0, i - 1), min(rows, i + 2)):
                for b in range(max(0, j - 1), min(cols, j + 2)):
                    k = a * cols + b
                    if flat[k] != BACKGROUND or flat_depth[k] <= 0.0 or seen[k] == 1:
                        continue
                    if abs(flat_depth[k] - flat_depth[at]) > limits.jump:
                        continue
                    if seen[k] == 2:
                        is_small = False
                    else:
                        queue[last], seen[k] = k, 1
                        last += 1
        far, i, j = 0.0, start // cols, start % cols
        for n in range(last):
            across = (queue[n] % cols - j) / camera.fx
            along = (queue[n] // cols - i) / camera.fy
            far = max(far, flat_depth[queue[n]] * np.sqrt(across * across + along * along))
        is_thin = area <= limits.width * (far + limits.width)
        is_theirs = is_small and is_thin and total >= limits.chance * last
        for n in range(last):
            if is_theirs:
                flat[queue[n]] = owner
            seen[queue[n]] = 0 if is_theirs else 2


@njit(cache=True)
def beside_person(depth, labels, at, cols, jump):
    """Label of a person whose surface goes on at a pixel (of a flat image); `BACKGROUND` for nobody."""
    i, j = at // cols, at % cols
    rows = depth.size // cols
    for a in range(max(0, i - 1), min(rows, i + 2)):
        for b in range(max(0, j - 1), min(cols, j + 2)):
            k = a * cols + b
            label = labels[k]
            if label not in (BACKGROUND, HIDDEN) and abs(depth[k] - depth[at]) <= jump:
                return label
    return np.uint8(BACKGROUND)
