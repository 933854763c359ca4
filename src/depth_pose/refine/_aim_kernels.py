"""Compiled loops that turn a pose's segments toward joints and measure joint distances."""

from __future__ import annotations

import numpy as np

from depth_pose.body._skin_kernels import place_nodes
from depth_pose.core._rotation_kernels import multiply, rotation_between
from depth_pose.core.kernels import njit
from depth_pose.core.skeleton import NODE_PARENTS

SHARED_M = 0.04
"""Standard deviation (m) added to each proposal's: errors that all frames of a person share; chosen on three
simulated and three real sets."""

_SHORT_M = 1e-6
"""Bones shorter than this have no direction."""


@njit(cache=True)
def aim_segments(rest, segments, nodes, rotations):
    """Turn segments by the smallest rotations that make them point at their end node.

    ``segments`` (2, K): start and end node of each; ``rest``, ``nodes`` (21, 3); ``rotations`` (21, 3, 3) is
    updated in place.
    """
    now, seen, turn, turned = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    for k in range(segments.shape[1]):
        start, end = segments[0, k], segments[1, k]
        r = rotations[start]
        for a in range(3):
            seen[a] = nodes[end, a] - nodes[start, a]
            now[a] = 0.0
            for b in range(3):
                now[a] += r[a, b] * (rest[end, b] - rest[start, b])
        long_now, long_seen = np.sqrt((now**2).sum()), np.sqrt((seen**2).sum())
        if min(long_now, long_seen) < _SHORT_M:
            continue
        rotation_between(now / long_now, seen / long_seen, turn)
        multiply(turn, r, turned)
        r[:] = turned


@njit(cache=True)
def nearer_naming(joints, places, weights):
    """Return which of two left/right namings puts ``places`` (2, J, 3) nearer to joints (J, 3)."""
    apart = np.zeros(2)
    for side in range(2):
        for j in range(joints.shape[0]):
            for a in range(3):
                gap = places[side, j, a] - joints[j, a]
                apart[side] += weights[side, j] * gap * gap
    return 0 if apart[0] <= apart[1] else 1


@njit(cache=True)
def aim_at_measured(rest, rotations, root, scale, measured, limbs, least, segments, aimed):
    """Turn each kind of limbs of a pose to its measured joints with at least this confidence.

    ``limbs`` (L, 19) are the joints of each kind. Writes the rotations (L, 21, 3, 3) to ``aimed``; returns
    which kinds have such joints.
    """
    nodes, goal = np.empty(rest.shape), np.empty(rest.shape)
    place_nodes(rest, NODE_PARENTS, rotations, root, scale, nodes)
    side = nearer_naming(nodes[measured.nodes], measured.places, measured.weights)
    is_aimed = np.zeros(limbs.shape[0], np.bool_)
    for k in range(limbs.shape[0]):
        goal[:] = nodes
        for j in range(limbs.shape[1]):
            if limbs[k, j] and measured.weights[side, j] >= least:
                goal[measured.nodes[j]] = measured.places[side, j]
                is_aimed[k] = True
        aimed[k] = rotations
        aim_segments(rest, segments, goal, aimed[k])
    return is_aimed


@njit(cache=True)
def mean_deviation(joints, places, sigmas, most):
    """Compute the mean Mahalanobis distance of joints (J, 3) from ``places``, each clipped at ``most``.

    ``sigmas`` (J, 2) are the deviations of the places across their rays and along them, metres; `SHARED_M` is
    added to both.
    """
    total = 0.0
    for j in range(places.shape[0]):
        far, along, long = 0.0, 0.0, 0.0
        for a in range(3):
            gap = joints[j, a] - places[j, a]
            far += gap * gap
            along += gap * places[j, a]
            long += places[j, a] * places[j, a]
        along *= along / max(long, 1e-12)
        across_2, along_2 = sigmas[j, 0] ** 2 + SHARED_M**2, sigmas[j, 1] ** 2 + SHARED_M**2
        total += min(np.sqrt((far - along) / across_2 + along / along_2), most)
    return total / places.shape[0]
