"""Compiled loops that find and mark large planes (`depth_pose.detect.planes`)."""

from __future__ import annotations

import numpy as np

from depth_pose.core.kernels import njit


@njit(cache=True)
def draw_samples(points, most, reach, focal):
    """Draw about ``most`` samples of smooth surfaces, evenly over the image.

    Normals are computed from the neighbours ``reach`` pixels away; a pixel with a missing neighbour is
    skipped. Returns points (n, 3), unit normals (n, 3) and the areas (n,) that the samples would cover if
    they faced the camera, square metres.
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
    """Compute the unit normal at a pixel from neighbours ``reach`` away; return False if one is missing."""
    if i < reach or j < reach or i + reach >= points.shape[0] or j + reach >= points.shape[1]:
        return False
    left, right, up, down = j - reach, j + reach, i - reach, i + reach
    e0 = points[i, right, 0] - points[i, left, 0]
    e1 = points[i, right, 1] - points[i, left, 1]
    e2 = points[i, right, 2] - points[i, left, 2]
    f0 = points[down, j, 0] - points[up, j, 0]
    f1 = points[down, j, 1] - points[up, j, 1]
    f2 = points[down, j, 2] - points[up, j, 2]
    n0, n1, n2 = e1 * f2 - e2 * f1, e2 * f0 - e0 * f2, e0 * f1 - e1 * f0
    norm = np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
    if not norm > 0.0:  # a neighbour is NaN
        return False
    normal[0], normal[1], normal[2] = n0 / norm, n1 / norm, n2 / norm
    return True


@njit(cache=True)
def is_inlier(p, n, plane, tolerance):
    """Check that a point lies on a plane and its normal agrees with the plane's within 37 degrees."""
    off = plane[0] * p[0] + plane[1] * p[1] + plane[2] * p[2] - plane[3]
    along = plane[0] * n[0] + plane[1] * n[1] + plane[2] * n[2]
    return abs(off) < tolerance * p[2] and abs(along) > 0.8


@njit(cache=True)
def plane_inliers(samples, normals, areas, plane, tolerance):
    """Find the samples on a plane, and their total area on it.

    ``areas`` are those of the samples if they faced the camera.
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
def fit_plane(samples, normals, areas, plane, tolerance, rounds, fewest, on):
    """Move ``plane`` to the samples near it, until these stay the same, and mark them in ``on``.

    Returns their total area, and their standard deviation along the plane's narrower side.
    """
    area, width = 0.0, 0.0
    for n in range(rounds):
        near, area = plane_inliers(samples, normals, areas, plane, tolerance)
        is_settled = n > 0 and (near == on).all()
        on[:] = near
        if is_settled:
            break
        count, middle, covariance = moments(samples, on)
        if count < fewest:
            break
        variances, axes = np.linalg.eigh(covariance)
        plane[:3] = axes[:, 0]
        plane[3] = plane[0] * middle[0] + plane[1] * middle[1] + plane[2] * middle[2]
        width = np.sqrt(max(variances[1], 0.0))
    return area, width


@njit(cache=True)
def add_near(samples, plane, tolerance, on):
    """Mark in ``on`` also the samples whose distance from a plane is below this share of their range."""
    for i in range(samples.shape[0]):
        p = samples[i]
        off = abs(p[0] * plane[0] + p[1] * plane[1] + p[2] * plane[2] - plane[3])
        on[i] = on[i] or off < tolerance * p[2]


@njit(cache=True)
def remove(samples, normals, areas, on):
    """Remove the samples of ``on``, and their normals and areas; return how many are left, in front."""
    count = 0
    for i in range(samples.shape[0]):
        if not on[i]:
            samples[count], normals[count], areas[count] = samples[i], normals[i], areas[i]
            count += 1
    return count


@njit(cache=True)
def moments(samples, on):
    """Compute count, mean (3,) and covariance (3, 3) of the selected samples."""
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
    """Find the plane (n, d), ``n . p = d``, with the most area.

    Candidates pass through one of the seeds, along its normal.
    """
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
def mark_planes(points, planes, tolerance, window, out):
    """Set ``out`` where a pixel and at least half of its window's pixels lie on one of ``planes``, (P, 4)."""
    rows, cols = points.shape[:2]
    count, wide = planes.shape[0], cols + 2 * window
    # 1 on the plane, -1 beside it, 0 without depth and around the image
    signs = np.zeros((count, rows + 2 * window, wide), np.int8)
    x, y, z = np.empty(cols, np.float32), np.empty(cols, np.float32), np.empty(cols, np.float32)
    for i in range(rows):
        for j in range(cols):
            x[j], y[j], z[j] = points[i, j, 0], points[i, j, 1], points[i, j, 2]
        for p in range(count):
            mark_row(x, y, z, planes[p], tolerance, signs[p, i + window, window : window + cols])
    for p in range(count):
        add_majorities(signs[p], window, out)


@njit(cache=True)
def mark_row(x, y, z, plane, tolerance, signs):
    """Write the signs of one row of pixels; compiled to vector instructions."""
    n0, n1, n2, d = plane[0], plane[1], plane[2], plane[3]
    for j in range(x.shape[0]):
        off = abs(n0 * x[j] + n1 * y[j] + n2 * z[j] - d)
        signs[j] = (1 if off < tolerance * z[j] else -1) if z[j] == z[j] else 0


@njit(cache=True)
def add_majorities(signs, window, out):
    """Set ``out`` at positive signs whose window's sum is not negative; compiled to vector instructions.

    Sums of windows of up to 11 by 11 pixels fit into eight bits.
    """
    rows, cols = out.shape
    down, sums = np.zeros(signs.shape[1], np.int8), np.empty(cols, np.int8)
    for i in range(-2 * window, rows):
        entering = signs[i + 2 * window]
        for j in range(down.shape[0]):
            down[j] += entering[j]
        if i < 0:
            continue
        sums[:] = 0
        for k in range(2 * window + 1):
            shifted = down[k : k + cols]
            for j in range(cols):
                sums[j] += shifted[j]
        own, marked, leaving = signs[i + window, window : window + cols], out[i], signs[i]
        for j in range(cols):
            marked[j] |= (own[j] > 0) & (sums[j] >= 0)
        for j in range(down.shape[0]):
            down[j] -= leaving[j]
