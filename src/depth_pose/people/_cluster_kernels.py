"""Compiled loops from what the net says of every pixel to persons; `depth_pose.people.finder` says why.

``image`` is a `NetImage`. Flat indices count its pixels, row by row, `COLS` to a row.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from depth_pose.core._camera_kernels import ray
from depth_pose.people._finder_kernels import COLS

_CELL_M = 0.1
"""Cells in which votes are counted to find where they are dense."""

CELLS = (128, 64, 128)
"""Cells along x, y, z; votes beyond 6.4 m, 3.2 m and 12.8 m are counted at the edge."""

_LEAST_IN_CELL = 0.1
"""Share of the least area of a person that the densest cell of their votes holds."""

_SHIFTS = 8
"""Most moves of a mean; most come to rest in four."""

_REST_M = 0.01

_KEEN_M = 0.1
"""A vote whose own error is wider than this counts less."""

_ALONG = 0.5
"""Weight of the squared distance of votes along the camera's axis."""

_SAME_M = 0.1
"""Pixels of two grids that differ by less in depth show the same surface."""

MEASURES = 28
"""What `measure_clusters`, `measure_joints` and `measure_neighbours` tell of a cluster."""

_ALONE_M = 2.0
"""Distance that a cluster without a neighbour is said to be from one."""


class TorsoVotes(NamedTuple):
    """The pixels that vote.

    Attributes
    ----------
    flat : (N,) int64
        Which pixels.
    points : (N, 3) float64
        Where they see the torso, camera frame, metres.
    weights, areas : (N,) float64
        What they weigh, and the area that they show, m^2.
    """

    flat: NDArray[np.int64]
    points: NDArray[np.float64]
    weights: NDArray[np.float64]
    areas: NDArray[np.float64]

    def first(self, count: int) -> TorsoVotes:
        """Give the first ``count`` of them, not copied."""
        return TorsoVotes(self.flat[:count], self.points[:count], self.weights[:count], self.areas[:count])


class SeenJoints(NamedTuple):
    """Where the joints of each cluster seem to be.

    Attributes
    ----------
    joints : (P, J, 3) float64
        Camera frame, metres.
    width, spread : (P, J) float64
        Mean error that the votes claim, and how far they lie apart, metres.
    behind : (P,) float64
        Probability that the person is seen from behind.
    """

    joints: NDArray[np.float64]
    width: NDArray[np.float64]
    spread: NDArray[np.float64]
    behind: NDArray[np.float64]


class LimbRule(NamedTuple):
    """Which surfaces beside a person are their limbs.

    Attributes
    ----------
    least : float
        Mean probability of a person, at least.
    jump : float
        Step in depth within a surface per metre of distance, less than this.
    most : float
        Area, m^2, less than this.
    """

    least: float
    jump: float
    most: float


class FloodSpace(NamedTuple):
    """Work space: a list of flat indices, (h w,) int64, and marks, (h, w) int32."""

    queue: NDArray[np.int64]
    marks: NDArray[np.int32]


@njit(cache=True)
def collect_votes(image, mask, torso, least, out):
    """List pixels whose mask logit is at least ``least``, where they see the torso, and their weight.

    The weight is the area that the pixel shows (m^2), times the probability, less where the vote is
    unsure. ``out`` (TorsoVotes) has room for all pixels. Returns how many there are.
    """
    grid, camera = image.depth, image.camera
    flat, votes, weights, areas = out
    count = 0
    for i in range(image.rows):
        for j in range(image.cols):
            z = grid[i, j]
            if z <= 0.0 or mask[i, j] < least:
                continue
            x, y = ray(camera, j, i)
            votes[count, 0] = x * z + torso[0, i, j]
            votes[count, 1] = y * z + torso[1, i, j]
            votes[count, 2] = z + torso[2, i, j]
            width = np.exp(torso[3, i, j])
            areas[count] = z * z / (camera.fx * camera.fy)
            weights[count] = areas[count] / (1.0 + np.exp(-mask[i, j])) * min(1.0, _KEEN_M / width)
            flat[count] = i * COLS + j
            count += 1
    return count


@njit(cache=True)
def cell_of(vote):
    """Index of the cell that a vote lies in."""
    index = 0
    for a in range(3):
        low = 0.0 if a == 2 else -0.5 * CELLS[a]
        k = int(np.floor(vote[a] / _CELL_M - low))
        index = index * CELLS[a] + max(0, min(CELLS[a] - 1, k))
    return index


@njit(cache=True)
def find_modes(votes, weights, density, radius, least, most, modes):
    """Where votes gather: means of all votes within ``radius``, each of at least ``least`` m^2.

    ``density`` (all cells) is zero on entry and again on return. Returns how many modes there are.
    """
    n = votes.shape[0]
    cells = np.empty(n, np.int64)
    for k in range(n):
        cells[k] = cell_of(votes[k])
        density[cells[k]] += weights[k]
    taken = np.zeros(n, np.bool_)
    count = 0
    for _ in range(4 * most):
        best, seed = 0.0, -1
        for k in range(n):
            if not taken[k] and density[cells[k]] > best:
                best, seed = density[cells[k]], k
        if best < _LEAST_IN_CELL * least or count == most:
            break
        mean = votes[seed].copy()
        total = shift_mean(votes, weights, mean, radius)
        apart = True
        for m in range(count):
            apart &= apart2(modes[m], mean) > radius * radius
        if apart and total >= least:
            modes[count] = mean
            count += 1
        for k in range(n):
            if apart2(votes[k], mean) < radius * radius or cells[k] == cells[seed]:
                taken[k] = True
    for k in range(n):
        density[cells[k]] = 0.0
    return count


@njit(cache=True)
def shift_mean(votes, weights, mean, radius):
    """Move ``mean`` to the mean of the votes within ``radius`` until it rests; returns their weight."""
    total = 0.0
    for _ in range(_SHIFTS):
        total, x, y, z = 0.0, 0.0, 0.0, 0.0
        for k in range(votes.shape[0]):
            if apart2(votes[k], mean) < radius * radius:
                w = weights[k]
                total += w
                x += w * votes[k, 0]
                y += w * votes[k, 1]
                z += w * votes[k, 2]
        if total <= 0.0:
            break
        x, y, z = x / total, y / total, z / total
        moved = abs(x - mean[0]) + abs(y - mean[1]) + abs(z - mean[2])
        mean[0], mean[1], mean[2] = x, y, z
        if moved < _REST_M:
            break
    return total


@njit(cache=True)
def apart2(a, b):
    """Squared distance of two votes; they err more along the camera's axis, so that counts less."""
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + _ALONG * (a[2] - b[2]) ** 2


@njit(cache=True)
def distance2(a, b):
    """Squared distance of two points."""
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2


@njit(cache=True)
def assign_votes(flat, votes, modes, reach, labels, owner):
    """Give every listed pixel the nearest mode within ``reach`` (from 1), in the image and in the list."""
    for k in range(votes.shape[0]):
        best, owner[k] = reach * reach, 0
        for m in range(modes.shape[0]):
            d = apart2(votes[k], modes[m])
            if d < best:
                best, owner[k] = d, m + 1
        labels[flat[k] // COLS, flat[k] % COLS] = owner[k]


@njit(cache=True)
def gather_joints(image, labels, cells, votes, out):
    """Where each cluster's cells see its joints.

    ``votes`` (4 J + 1, h, w): offsets, logarithms of their errors, logit of being seen from behind. A
    joint is the mean of the votes weighed by one over their squared error, taken again with those off
    the mean weighing less. Fills ``out`` (SeenJoints).
    """
    grid, camera = image.depth, image.camera
    joints, width, spread, behind = out
    count, n = joints.shape[:2]
    cast = np.zeros(count)
    behind[:] = 0.0
    total = np.zeros((count, n))
    first = np.zeros((count, n, 3))
    for turn in range(2):
        total[:] = 0.0
        joints[:], width[:], spread[:] = 0.0, 0.0, 0.0
        for i in range(cells.shape[0]):
            for j in range(cells.shape[1]):
                at = cells[i, j]
                if at < 0:
                    continue
                a, b = at // COLS, at % COLS
                p = labels[a, b] - 1
                if p < 0:
                    continue
                z = grid[a, b]
                x, y = ray(camera, b, a)
                x, y = x * z, y * z
                if turn == 0:
                    behind[p] += votes[4 * n, i, j]
                    cast[p] += 1.0
                for m in range(n):
                    u = x + votes[3 * m, i, j]
                    v = y + votes[3 * m + 1, i, j]
                    w = z + votes[3 * m + 2, i, j]
                    error = 0.02 + np.exp(min(2.0, max(-6.0, votes[3 * n + m, i, j])))
                    weight = 1.0 / (error * error)
                    if turn == 1:
                        off = (
                            (u - first[p, m, 0]) ** 2 + (v - first[p, m, 1]) ** 2 + (w - first[p, m, 2]) ** 2
                        )
                        weight /= 1.0 + off / (0.15 * 0.15)
                        spread[p, m] += weight * off
                    total[p, m] += weight
                    joints[p, m, 0] += weight * u
                    joints[p, m, 1] += weight * v
                    joints[p, m, 2] += weight * w
                    width[p, m] += weight * error
        for p in range(count):
            for m in range(n):
                if total[p, m] > 0.0:
                    for a in range(3):
                        joints[p, m, a] /= total[p, m]
                    width[p, m] /= total[p, m]
                    spread[p, m] = np.sqrt(spread[p, m] / total[p, m])
                else:
                    width[p, m], spread[p, m] = 2.0, 2.0
        first[:] = joints
    for p in range(count):
        behind[p] = 1.0 / (1.0 + np.exp(-behind[p] / max(cast[p], 1.0)))


@njit(cache=True)
def measure_clusters(image, mask, torso, votes, owner, modes, out):
    """Measure what tells persons from things: see the lines below.

    ``out`` (P, MEASURES), the last ones of which the other two fill.
    """
    grid, rows, cols, camera = image.depth, image.rows, image.cols, image.camera
    flat, points, areas = votes.flat, votes.points, votes.areas
    count = modes.shape[0]
    out[:] = 0.0
    pixels = np.zeros(count)
    area = np.zeros(count)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    moment, mean = np.zeros((count, 3, 3)), np.zeros((count, 3))
    edge, jump = np.zeros(count), np.zeros(count)
    for k in range(flat.shape[0]):
        p = owner[k] - 1
        if p < 0:
            continue
        i, j = flat[k] // COLS, flat[k] % COLS
        z = grid[i, j]
        x, y = ray(camera, j, i)
        q = (np.float64(x * z), np.float64(y * z), np.float64(z))
        prob = 1.0 / (1.0 + np.exp(-mask[i, j]))
        pixels[p] += 1.0
        area[p] += areas[k]
        out[p, 0] += prob
        out[p, 1] += prob > 0.8
        out[p, 2] = max(out[p, 2], prob)
        out[p, 3] += distance2(points[k], modes[p])
        out[p, 4] += torso[3, i, j]
        out[p, 5] += i == 0 or j == 0 or i == rows - 1 or j == cols - 1
        for a in range(3):
            low[p, a], high[p, a] = min(low[p, a], q[a]), max(high[p, a], q[a])
            mean[p, a] += q[a]
            for b in range(3):
                moment[p, a, b] += q[a] * q[b]
        for d in range(4):  # at the cluster's edge: does the depth jump there, or does the surface go on?
            a = i + (1 if d == 0 else -1 if d == 1 else 0)
            b = j + (1 if d == 2 else -1 if d == 3 else 0)
            if a < 0 or b < 0 or a >= rows or b >= cols or grid[a, b] <= 0.0 or mask[a, b] > 0.0:
                continue
            edge[p] += 1.0
            jump[p] += abs(grid[a, b] - z) > 0.1
    for p in range(count):
        n = max(pixels[p], 1.0)
        out[p, 0] /= n
        out[p, 1] /= n
        out[p, 3] = np.sqrt(out[p, 3] / n)
        out[p, 4] /= n
        out[p, 5] /= n
        out[p, 6] = np.log(area[p] + 1e-4)
        out[p, 7] = np.log(n)
        out[p, 8] = modes[p, 2]
        for a in range(3):
            out[p, 9 + a] = high[p, a] - low[p, a] if pixels[p] > 0 else 0.0
            mean[p, a] /= n
        out[p, 12] = (jump[p] + 1.0) / (edge[p] + 2.0)
        out[p, 13] = np.log1p(edge[p] / np.sqrt(n))
        cover = moment[p] / n
        for a in range(3):
            for b in range(3):
                cover[a, b] -= mean[p, a] * mean[p, b]
        spread = np.sqrt(np.maximum(np.linalg.eigvalsh(cover), 0.0))
        out[p, 14], out[p, 15] = spread[0], spread[1]


@njit(cache=True)
def measure_joints(seen, modes, image, mask, parts, out):
    """Fill the measures of the joints, from 16 on.

    ``parts``: indices of pelvis, neck, head, both shoulders, both hips, and the number of joints.
    """
    pelvis, neck, head, left, right, hip_left, hip_right = parts
    joints, width, spread = seen.joints, seen.width, seen.spread
    rows, cols, camera = image.rows, image.cols, image.camera
    n = joints.shape[1]
    for p in range(joints.shape[0]):
        q = joints[p]
        total, inside = 0.0, 0
        for m in range(n):
            total += width[p, m]
            z = max(q[m, 2], 0.1)
            i = int(q[m, 1] / z * camera.fy + camera.cy + 0.5)
            j = int(q[m, 0] / z * camera.fx + camera.cx + 0.5)
            inside += i >= 0 and j >= 0 and i < rows and j < cols and mask[i, j] > -0.6
        out[p, 16] = total / n
        out[p, 17] = inside / n
        out[p, 18] = width[p, head]
        out[p, 19] = spread[p, head]
        out[p, 20] = 0.5 * (spread[p, pelvis] + spread[p, neck])
        trunk = 0.25 * (q[left] + q[right] + q[hip_left] + q[hip_right])
        out[p, 21] = np.sqrt(distance2(trunk, modes[p]))
        out[p, 22] = np.sqrt(distance2(q[pelvis], q[neck]))
        out[p, 23] = np.sqrt(distance2(q[left], q[right]))


@njit(cache=True)
def measure_neighbours(image, labels, modes, out, neighbour):
    """Fill the measures, from 24 on, of each cluster beside the nearest one with more area.

    A part of a person whose votes went astray touches the rest and is small. ``neighbour`` (P,) becomes
    that other cluster, -1 for none within `_ALONE_M`.
    """
    grid, rows, cols = image.depth, image.rows, image.cols
    count = modes.shape[0]
    contact = np.zeros((count + 1, count + 1))
    for i in range(rows):
        for j in range(cols):
            a = labels[i, j]
            if a == 0:
                continue
            for d in range(2):
                u, v = (i + 1, j) if d == 0 else (i, j + 1)
                if u >= rows or v >= cols or labels[u, v] == a or labels[u, v] == 0:
                    continue
                if abs(grid[u, v] - grid[i, j]) < _SAME_M:
                    contact[a, labels[u, v]] += 1.0
                    contact[labels[u, v], a] += 1.0
    for p in range(count):
        best, neighbour[p] = _ALONE_M, -1
        for q in range(count):
            away = np.sqrt(distance2(modes[p], modes[q]))
            if q != p and away < best and (out[q, 6] > out[p, 6] or (out[q, 6] == out[p, 6] and q < p)):
                best, neighbour[p] = away, q
        out[p, 24], out[p, 25], out[p, 26], out[p, 27] = _ALONE_M, _ALONE_M, 0.0, 0.0
        q = neighbour[p]
        if q >= 0:
            out[p, 24] = best
            out[p, 25] = np.hypot(modes[p, 0] - modes[q, 0], modes[p, 1] - modes[q, 1])
            out[p, 26] = contact[p + 1, q + 1] / np.exp(0.5 * out[p, 7])
            out[p, 27] = out[q, 6] - out[p, 6]


@njit(cache=True)
def mark_near(labels, mask, least, rows, cols, chance, near):
    """Mark what lies within a pixel of a person or of a probability (``chance``) of ``least``."""
    near[:] = False
    chance[:] = 0.0
    logit = np.log(least / (1.0 - least))
    for i in range(rows):
        for j in range(cols):
            if labels[i, j] > 0 or mask[i, j] >= logit:
                chance[i, j] = 1.0 / (1.0 + np.exp(-mask[i, j]))
                for a in range(max(0, i - 1), min(rows, i + 2)):
                    for b in range(max(0, j - 1), min(cols, j + 2)):
                        near[a, b] = True


@njit(cache=True)
def carry_labels(depth, camera, image, labels, net_chance, near, out, chance):
    """Carry labels (0: nobody) from the net's image to another grid, ``depth`` with its ``camera``.

    A pixel takes, of the nine net pixels around it, what those near it in depth say, the nearer the
    more. ``chance`` becomes the probability of a person there, -1 where no net pixel has this depth.
    """
    net_depth, rows, cols = image.depth, image.rows, image.cols
    ratio = image.camera.fx / camera.fx
    offset_x, offset_y = image.camera.cx - ratio * camera.cx, image.camera.cy - ratio * camera.cy
    votes = np.zeros(256)
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
            total, sure, count = 0.0, 0.0, 0
            for a in range(max(0, a0 - 1), min(rows, a0 + 2)):
                for b in range(max(0, b0 - 1), min(cols, b0 + 2)):
                    off = abs(net_depth[a, b] - z)
                    if net_depth[a, b] <= 0.0 or off > _SAME_M:
                        continue
                    weight = 1.0 / ((0.25 + (a - y) ** 2 + (b - x) ** 2) * (0.03 + off))
                    total += weight
                    sure += weight * net_chance[a, b]
                    who = labels[a, b]
                    if who > 0:
                        if votes[who] == 0.0:
                            seen[count] = who
                            count += 1
                        votes[who] += weight
            best, chosen = 0.0, 0
            for k in range(count):
                if votes[seen[k]] > best:
                    best, chosen = votes[seen[k]], seen[k]
                votes[seen[k]] = 0.0
            chance[i, j] = sure / total if total > 0.0 else -1.0
            if chance[i, j] >= 0.5:
                out[i, j] = chosen


@njit(cache=True)
def grow_labels(depth, labels, chance, least, jump, pixels, queue):
    """Let persons grow along their surfaces into pixels that the net is not sure are background.

    A step goes to one of four neighbours with ``chance`` of at least ``least`` (or unknown, -1) whose
    depth differs by less than ``jump`` per metre of distance; at most ``pixels`` / distance steps.
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


@njit(cache=True)
def label_boxes(labels, boxes, pixels):
    """Least and greatest column and row (P, 4) of every label from 1, and how many pixels it has."""
    pixels[:] = 0
    boxes[:, :2] = 1_000_000
    boxes[:, 2:] = -1
    for i in range(labels.shape[0]):
        for j in range(labels.shape[1]):
            k = np.int64(labels[i, j]) - 1
            if 0 <= k < pixels.shape[0]:
                pixels[k] += 1
                boxes[k, 0], boxes[k, 1] = min(boxes[k, 0], j), min(boxes[k, 1], i)
                boxes[k, 2], boxes[k, 3] = max(boxes[k, 2], j), max(boxes[k, 3], i)


@njit(cache=True)
def adopt_limbs(depth, camera, labels, chance, rule, space):
    """Give people the small surfaces that go on from them: hands and forearms that the mask missed.

    A surface is what can be reached in steps of less than ``rule.jump`` per metre of distance without
    crossing anybody. It is a limb if it shows less than ``rule.most`` m^2 (a floor, a desk or a wall that
    they touch is larger) and the net thinks it a person with a mean probability of at least ``rule.least``.
    """
    queue, marks = space
    rows, cols = depth.shape
    marks[:] = 0
    turn = 0
    for start in range(rows * cols):
        i, j = start // cols, start % cols
        who = labels[i, j]
        if who == 0:
            continue
        for d in range(4):
            a = i + (1 if d == 0 else -1 if d == 1 else 0)
            b = j + (1 if d == 2 else -1 if d == 3 else 0)
            if not is_free(depth, labels, a, b) or marks[a, b] > 0:
                continue
            if abs(depth[a, b] - depth[i, j]) >= rule.jump * depth[i, j]:
                continue
            turn += 1
            count, area = flood_free(depth, camera, labels, rule, space, a, b, turn)
            sure = 0.0
            for k in range(count):
                sure += max(0.0, chance[queue[k] // cols, queue[k] % cols])
            if area < rule.most and sure >= rule.least * count:
                for k in range(count):
                    labels[queue[k] // cols, queue[k] % cols] = who


@njit(cache=True)
def is_free(depth, labels, a, b):
    """Whether a pixel is in the image, has a depth, and is nobody's."""
    inside = a >= 0 and b >= 0 and a < depth.shape[0] and b < depth.shape[1]
    return inside and labels[a, b] == 0 and depth[a, b] > 0.0


@njit(cache=True)
def flood_free(depth, camera, labels, rule, space, a, b, turn):
    """List the surface around a pixel in the queue; gives how many pixels, and their area, m^2.

    It stops where the area passes ``rule.most``, and where it meets a surface that was looked at before (its
    marks are of another ``turn``), which was too large: the area is then infinite.
    """
    queue, marks = space
    cols, focal2 = depth.shape[1], camera.fx * camera.fy
    queue[0], count, area, done = a * cols + b, 1, 0.0, 0
    marks[a, b] = turn
    while done < count:
        i, j = queue[done] // cols, queue[done] % cols
        done += 1
        z = depth[i, j]
        area += z * z / focal2
        if area >= rule.most:
            return count, np.inf
        for d in range(4):
            u = i + (1 if d == 0 else -1 if d == 1 else 0)
            v = j + (1 if d == 2 else -1 if d == 3 else 0)
            if not is_free(depth, labels, u, v) or abs(depth[u, v] - z) >= rule.jump * z:
                continue
            if marks[u, v] != turn:
                if marks[u, v] > 0:
                    return count, np.inf
                marks[u, v] = turn
                queue[count] = u * cols + v
                count += 1
    return count, area
