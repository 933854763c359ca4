"""Compiled loops that bend known limbs so that they end at given points, for `depth_pose.refine.limbs`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core._rotation_kernels import multiply, rotation_between
from depth_pose.core.kernels import njit

_SHORT_M = 1e-3
"""Shorter directions (m at scale 1) are ignored."""

_FOLDED_M = 0.02
"""Least distance of a limb's ends (m), beyond the difference of its bone lengths."""


class Limbs(NamedTuple):
    """Known limbs.

    Attributes
    ----------
    samples : (L, 9, 3) float64
        Balls at a third, two thirds and the end of three bones (`refine.limbs`), metres at scale 1.
    tips : (3, L) float64
        End of the second bone, in columns.
    rotations : (L, n, 3, 3) float64
        Rotations of the segments that a limb turns.
    first : int
        Index of the segment of the first bone among them.
    """

    samples: NDArray[np.float64]
    tips: NDArray[np.float64]
    rotations: NDArray[np.float64]
    first: int


@njit(cache=True)
def reach(known, targets, count, out_samples, out_rotations):
    """For each target, bend the ``count`` limbs with the nearest ends so that they end there.

    The plane of the bend rotates with the line from the limb's start to its end, so that elbow or
    knee remain as plausible as before; the bend itself follows from the distance, by the law of cosines.

    Parameters
    ----------
    known : Limbs
    targets : (P, 3)
        In the frame of the samples.
    count : int
    out_samples, out_rotations : (P * count, 9, 3), (P * count, n, 3, 3)
        Written.
    """
    samples, tips, rotations, first = known.samples, known.tips, known.rotations, known.first
    limbs = samples.shape[0]
    gaps, nearest = np.empty(count), np.empty(count, np.int64)
    turn, upper, lower = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    row = 0
    for p in range(targets.shape[0]):
        x, y, z = targets[p, 0], targets[p, 1], targets[p, 2]
        gaps[:] = np.inf
        for k in range(limbs):
            gap = (tips[0, k] - x) ** 2 + (tips[1, k] - y) ** 2 + (tips[2, k] - z) ** 2
            if gap < gaps[count - 1]:  # insert into the ascending list
                at = count - 1
                while at > 0 and gaps[at - 1] > gap:
                    gaps[at], nearest[at] = gaps[at - 1], nearest[at - 1]
                    at -= 1
                gaps[at], nearest[at] = gap, k
        for k in nearest:
            limb = samples[k]
            start = 1.5 * limb[0] - 0.5 * limb[2]
            own_upper, own_lower = limb[2] - start, limb[5] - limb[2]
            one, two = np.sqrt((own_upper**2).sum()), np.sqrt((own_lower**2).sum())
            line, aim = limb[5] - start, targets[p] - start
            long, far = np.sqrt((line**2).sum()), np.sqrt((aim**2).sum())
            if min(long, far) < _SHORT_M:
                out_samples[row], out_rotations[row] = limb, rotations[k]
                row += 1
                continue
            line, aim = line / long, aim / far
            far = min(max(far, abs(one - two) + _FOLDED_M), one + two - _SHORT_M)
            rotation_between(line, aim, turn)
            side = turn @ (own_upper - (own_upper * line).sum() * line)
            width = np.sqrt((side**2).sum())
            along = (one * one - two * two + far * far) / (2.0 * far)
            off = np.sqrt(max(one * one - along * along, 0.0))
            to_joint = along * aim
            if width > _SHORT_M:
                to_joint = to_joint + (off / width) * side
            to_end = far * aim - to_joint
            one, two = np.sqrt((to_joint**2).sum()), np.sqrt((to_end**2).sum())
            rotation_between(own_upper / np.sqrt((own_upper**2).sum()), to_joint / one, upper)
            rotation_between(own_lower / np.sqrt((own_lower**2).sum()), to_end / two, lower)
            tip = lower @ (limb[8] - limb[5])
            for s in range(3):
                share = (s + 1) / 3.0
                out_samples[row, s] = start + share * to_joint
                out_samples[row, 3 + s] = start + to_joint + share * to_end
                out_samples[row, 6 + s] = start + to_joint + to_end + share * tip
            for n in range(rotations.shape[1]):
                if n < first:
                    out_rotations[row, n] = rotations[k, n]
                else:
                    multiply(upper if n == first else lower, rotations[k, n], out_rotations[row, n])
            row += 1
