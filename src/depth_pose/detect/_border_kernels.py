"""Compiled loops along the borders of people: what belongs to them, what may hide more of them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from depth_pose.core.kernels import njit
from depth_pose.core.types import BACKGROUND, HIDDEN

_FLOOR_STEPS = 2.0
"""Of a level floor one metre below the camera, neighbouring rows differ by z^2 / f; this many times that is
no floor any more."""

_HIDES_M = 0.6
"""How far beside a person's pixels something nearer may hide more of them: a limb's length, metres."""


@njit(cache=True)
def mark_unsupported(depth, labels, jump, least):
    """Label as hidden every pixel of a person with fewer than ``least`` of 24 neighbours on their surface.

    A neighbour is if it is the same person's and within ``jump`` in depth. Such pixels fly between the
    person and what is behind.
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
    """How many of 24 neighbours are on a pixel's surface; ``enough``, or a few more, once there are."""
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


class Surfaces(NamedTuple):
    """Flat images in which surfaces are followed, all (h * w,).

    Attributes
    ----------
    depth, labels : float32, uint8
    seen : uint8
        1: on the present surface, 2: on one that is nobody's limb.
    queue : int64
        Pixels of the present surface.
    """

    depth: Any
    labels: Any
    seen: Any
    queue: Any


@njit(cache=True)
def attach_limbs(depth, labels, chance, camera, limits):
    """Give people the small surfaces that go on from theirs: limbs that the net took for something else.

    From every person's border, what is nobody's is followed over neighbours at most ``limits.jump`` apart
    in ``depth``, in which floor and walls are 0. A surface of less than ``limits.area`` square metres and
    of a limb's width and chance is theirs; all else is furniture and stays nobody's.
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
    """Give people the small surfaces by themselves that vote for them: shanks below a desk.

    As `attach_limbs`, but for surfaces that touch nobody. ``claims`` (h, w) says for whose torso a pixel
    votes, 0 for nobody's; ``limits.chance`` is the least share of a surface that votes for one.
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
    """Begin to follow surfaces; ``labels`` (contiguous) are written through."""
    size = depth.size
    return Surfaces(depth.ravel(), labels.ravel(), np.zeros(size, np.uint8), np.empty(size, np.int64))


@njit(cache=True)
def may_start(flat, at):
    """Whether a pixel is nobody's, has a depth, and was not followed."""
    return flat.labels[at] == BACKGROUND and flat.depth[at] > 0.0 and flat.seen[at] == 0


@njit(cache=True)
def follow_surface(flat, start, camera, limits):
    """Follow what is nobody's from a pixel; give how many pixels are in the queue, negative if it is no limb.

    No limb is what is larger than ``limits.area``, wider than ``limits.width``, or meets what is no limb.
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
    """Give the surface that was followed to somebody, or leave it as nobody's (`BACKGROUND`)."""
    for n in range(abs(count)):
        at = flat.queue[n]
        if owner != BACKGROUND:
            flat.labels[at] = owner
        flat.seen[at] = 0 if owner != BACKGROUND else 2


@njit(cache=True)
def beside_anybody(labels):
    """Mark the pixels that have a person's pixel among their eight neighbours, and people's own, (h, w)."""
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
