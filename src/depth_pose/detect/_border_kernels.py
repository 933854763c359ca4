"""Compiled loops along mask borders: what belongs to a person, and what may occlude more of the person."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from depth_pose.core.kernels import njit
from depth_pose.core.labels import BACKGROUND, HIDDEN

_FLOOR_STEPS = 2.0
"""Factor on the depth step z^2 / f between rows of a level floor one metre below; larger steps are not
floor."""

_HIDES_M = 0.6
"""Distance (m) beside a person's mask within which a nearer object may occlude more of the person: a limb."""

_SURE_M, _ACROSS = 0.05, 1.5
"""Deviation (m) of a measured limb up to which its silhouette is trusted, set by hand; and how far beyond it
may lie to either side, in deviations: 2.5 is no better."""


@njit(cache=True)
def mark_unsupported(depth, labels, jump, least):
    """Label as hidden every pixel of a person with fewer than ``least`` of 24 neighbours on the same surface.

    A neighbour counts if it belongs to the same person and lies within ``jump`` in depth. The removed pixels
    are flying pixels between the person and the background.
    """
    rows, cols = depth.shape
    flying = np.empty(rows * cols, np.int64)
    count = 0
    for i in range(rows):
        for j in range(cols):
            own = labels[i, j]
            if own in (BACKGROUND, HIDDEN):
                continue
            if support(depth, labels, i, j, jump, least) < least:
                flying[count] = i * cols + j
                count += 1
    for k in range(count):
        labels[flying[k] // cols, flying[k] % cols] = HIDDEN


@njit(cache=True)
def support(depth, labels, i, j, jump, enough):
    """Count the neighbours, of 24, on a pixel's surface; may stop at ``enough``."""
    rows, cols = depth.shape
    z, own, count = depth[i, j], labels[i, j], -1
    for a in range(max(0, i - 2), min(rows, i + 3)):
        for b in range(max(0, j - 2), min(cols, j + 3)):
            count += labels[a, b] == own and abs(depth[a, b] - z) <= jump
        if count >= enough:
            break
    return count


@njit(cache=True)
def mark_nearer(depth, labels, camera, gap):
    """Label as hidden what is nearer than the adjacent person and may occlude more of the person.

    From each border pixel of a person the image is searched `_HIDES_M` far. An occluder begins where the
    depth drops by more than ``gap`` and more than the floor's slope, and ends where it is no longer nearer by
    ``gap``. The floor itself, which rises to the feet without a step, is not an occluder.
    """
    rows, cols = depth.shape
    hides = np.zeros((rows, cols), np.bool_)
    for i in range(rows):
        for j in range(cols):
            if labels[i, j] in (BACKGROUND, HIDDEN):
                continue
            z = depth[i, j]
            step = max(gap, _FLOOR_STEPS * z * z / camera.fy)
            for way in range(4):
                reach = int(_HIDES_M * (camera.fy if way < 2 else camera.fx) / z)
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


@njit(cache=True)
def mark_at_limbs(depth, labels, camera, ends, places, sigma):
    """Label as hidden the background that is not behind a measured limb: a limb may be there unseen.

    Skin is contradicted by background that is farther away, but not by a table in front of a shin, nor by a
    shin that the mask misses. Each part of a limb runs from a joint of ``ends`` to the joint before it.
    ``places`` (J, 3) are in the camera frame; ``sigma`` (J, 2) are their deviations across and along the ray,
    metres. A limb that is sure marks nothing, since the silhouette beside it is trusted.
    """
    rows, cols = depth.shape
    for k in ends:
        z0, z1 = places[k - 1, 2], places[k, 2]
        if not min(z0, z1) > 0.0:
            continue
        u0 = camera.fx * places[k - 1, 0] / z0 + camera.cx
        v0 = camera.fy * places[k - 1, 1] / z0 + camera.cy
        du = camera.fx * places[k, 0] / z1 + camera.cx - u0
        dv = camera.fy * places[k, 1] / z1 + camera.cy - v0
        most = _unsure(max(sigma[k - 1, 0], sigma[k, 0])) * camera.fx / min(z0, z1)
        if most <= 0.0:
            continue
        top, bottom = int(min(v0, v0 + dv) - most), int(max(v0, v0 + dv) + most) + 2
        left, right = int(min(u0, u0 + du) - most), int(max(u0, u0 + du) + most) + 2
        for i in range(max(0, top), min(rows, bottom)):
            for j in range(max(0, left), min(cols, right)):
                if labels[i, j] != BACKGROUND or depth[i, j] <= 0.0:
                    continue
                t = ((j - u0) * du + (i - v0) * dv) / max(du * du + dv * dv, 1e-6)
                t = min(max(t, 0.0), 1.0)
                z = z0 + t * (z1 - z0)
                reach = _unsure(sigma[k - 1, 0] + t * (sigma[k, 0] - sigma[k - 1, 0])) * camera.fx / z
                if (j - u0 - t * du) ** 2 + (i - v0 - t * dv) ** 2 > reach * reach:
                    continue
                if depth[i, j] < z + sigma[k - 1, 1] + t * (sigma[k, 1] - sigma[k - 1, 1]):
                    labels[i, j] = HIDDEN


@njit(cache=True)
def _unsure(sigma):
    """Compute how far to either side a limb may lie, metres; 0 up to a deviation of `_SURE_M`."""
    return _ACROSS * np.sqrt(max(0.0, sigma * sigma - _SURE_M * _SURE_M))


class LimbLimits(NamedTuple):
    """Limits of `attach_limbs` on a limb.

    Attributes
    ----------
    jump : float
        Maximum step in depth between neighbours, metres.
    area, width : float
        Maximum area, square metres, and mean width, metres.
    chance : float
        Least mean probability of a person.
    """

    jump: float
    area: float
    width: float
    chance: float


class Surfaces(NamedTuple):
    """Flat images for following surfaces, all (h * w,).

    Attributes
    ----------
    depth, labels : float32, uint8
    seen : uint8
        1: on the current surface, 2: on a rejected one.
    queue : int64
        Pixels of the current surface.
    """

    depth: Any
    labels: Any
    seen: Any
    queue: Any


@njit(cache=True)
def attach_limbs(depth, labels, chance, camera, limits):
    """Add small adjacent surfaces to people: limbs that the net missed.

    From every person's border, unlabelled pixels are followed over neighbours at most ``limits.jump`` apart
    in ``depth``, in which floor and walls are 0. A surface of less than ``limits.area`` square metres with a
    limb's width and probability is added to the person. All else is furniture and stays unlabelled.
    """
    flat = flat_surfaces(depth, labels)
    is_beside, flat_chance, cols = beside_anybody(labels).ravel(), chance.ravel(), depth.shape[1]
    for start in range(flat.seen.size):
        if not is_beside[start] or not may_start(flat, start):
            continue
        owner = beside_person(flat.depth, flat.labels, start, cols, limits.jump)
        if owner == BACKGROUND:
            continue
        count = follow_surface(flat, start, camera, limits)
        total = 0.0
        for n in range(count):
            total += flat_chance[flat.queue[n]]
        settle_surface(flat, count, owner if count > 0 and total >= limits.chance * count else BACKGROUND)


@njit(cache=True)
def attach_apart(depth, labels, claims, camera, limits):
    """Add small separate surfaces that vote for a person: shanks below a desk.

    As `attach_limbs`, but for surfaces that touch nobody. ``claims`` (h, w) is the person whose torso a pixel
    votes for, 0 for none; ``limits.chance`` is the least share of a surface that votes for one person.
    """
    flat = flat_surfaces(depth, labels)
    votes, cols = claims.ravel(), depth.shape[1]
    for start in range(flat.seen.size):
        owner = votes[start]
        if owner == 0 or not may_start(flat, start):
            continue
        count = follow_surface(flat, start, camera, limits)
        total, is_apart = 0, True
        for n in range(count):
            at = flat.queue[n]
            total += votes[at] == owner
            is_apart &= beside_person(flat.depth, flat.labels, at, cols, limits.jump) == BACKGROUND
        is_theirs = count > 0 and is_apart and total >= limits.chance * count
        settle_surface(flat, count, owner if is_theirs else BACKGROUND)


@njit(cache=True)
def flat_surfaces(depth, labels):
    """Prepare flat images for following surfaces; ``labels`` (contiguous) is written through."""
    size = depth.size
    return Surfaces(depth.ravel(), labels.ravel(), np.zeros(size, np.uint8), np.empty(size, np.int64))


@njit(cache=True)
def may_start(flat, at):
    """Check that a pixel is unlabelled, has a depth, and was not followed."""
    return flat.labels[at] == BACKGROUND and flat.depth[at] > 0.0 and flat.seen[at] == 0


@njit(cache=True)
def follow_surface(flat, start, camera, limits):
    """Follow unlabelled pixels from a start; return the queue's length, negative if it is not a limb.

    A surface is not a limb if it exceeds ``limits.area`` or ``limits.width``, or meets a rejected surface.
    """
    rows, cols = camera.height, camera.width
    pixel = 1.0 / (camera.fx * camera.fy)
    queue, seen = flat.queue, flat.seen
    queue[0], seen[start] = start, 1
    first, last, area = 0, 1, 0.0
    is_small = True
    while first < last and is_small:
        at = queue[first]
        first += 1
        area += flat.depth[at] * flat.depth[at] * pixel
        is_small = area <= limits.area
        i, j = at // cols, at % cols
        for a in range(max(0, i - 1), min(rows, i + 2)):
            for b in range(max(0, j - 1), min(cols, j + 2)):
                k = a * cols + b
                if flat.labels[k] != BACKGROUND or flat.depth[k] <= 0.0 or seen[k] == 1:
                    continue
                if abs(flat.depth[k] - flat.depth[at]) > limits.jump:
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
        far = max(far, flat.depth[queue[n]] * np.sqrt(across * across + along * along))
    is_thin = area <= limits.width * (far + limits.width)
    return last if is_small and is_thin else -last


@njit(cache=True)
def settle_surface(flat, count, owner):
    """Label the followed surface with its owner, or reject it (`BACKGROUND`)."""
    for n in range(abs(count)):
        at = flat.queue[n]
        if owner != BACKGROUND:
            flat.labels[at] = owner
        flat.seen[at] = 0 if owner != BACKGROUND else 2


@njit(cache=True)
def beside_anybody(labels):
    """Mark the pixels of people and their eight neighbours, (h, w)."""
    rows, cols = labels.shape
    marked = np.zeros((rows, cols), np.bool_)
    for i in range(rows):
        for j in range(cols):
            if labels[i, j] != BACKGROUND and labels[i, j] != HIDDEN:
                for a in range(max(0, i - 1), min(rows, i + 2)):
                    for b in range(max(0, j - 1), min(cols, j + 2)):
                        marked[a, b] = True
    return marked


@njit(cache=True)
def beside_person(depth, labels, at, cols, jump):
    """Return the person whose surface continues at a pixel (of a flat image); `BACKGROUND` for none."""
    i, j = at // cols, at % cols
    rows = depth.size // cols
    for a in range(max(0, i - 1), min(rows, i + 2)):
        for b in range(max(0, j - 1), min(cols, j + 2)):
            k = a * cols + b
            label = labels[k]
            if label not in (BACKGROUND, HIDDEN) and abs(depth[k] - depth[at]) <= jump:
                return label
    return np.uint8(BACKGROUND)
