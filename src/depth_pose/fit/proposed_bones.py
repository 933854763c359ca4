r"""How long bones are as the finder proposes them, and how much of somebody's size is due to clothes.

A build (`depth_pose.fit.personal`) is told by where the skin lies, and clothes only ever add to that: a coat,
a skirt or thick hair pull the size up, by a quarter at worst. The finder's second look learned joints of
people in clothes; the lengths between its proposals are coarse in a single frame and for a single bone, but
their median over frames and bones is right within 3 %, whatever is worn (docs/builds.md). So they do not tell
the size, they bound it: with :math:`z` the mean logarithm of how much longer the build's bones are than the
proposed ones,

.. math:: \log s \leftarrow \log s - \frac{(2 o)^2}{(2 o)^2 + v}\, z, \qquad o = \max(0, z - z_0),

where :math:`v` is the variance of the proposed size: the estimate of two witnesses, of whom skin errs by
:math:`2 o`. Within :math:`z_0` skin is believed, far above it proposals are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.build import BuildSpace
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES, NODE_INDEX
from depth_pose.fit._aim_kernels import nearer_naming
from depth_pose.fit._articulated_kernels import Proposals

Array = NDArray[np.float64]

_BONES = {
    ("pelvis", "neck"): (-0.045, 0.036),
    ("neck", "head"): (-0.024, 0.064),
    ("left_shoulder", "right_shoulder"): (-0.040, 0.065),
    ("left_hip", "right_hip"): (0.0, 0.075),
    ("left_shoulder", "left_elbow"): (-0.040, 0.075),
    ("right_shoulder", "right_elbow"): (-0.040, 0.075),
    ("left_hip", "left_knee"): (-0.009, 0.060),
    ("right_hip", "right_knee"): (-0.009, 0.060),
    ("left_knee", "left_ankle"): (-0.002, 0.050),
    ("right_knee", "right_ankle"): (-0.002, 0.050),
}
"""How far proposed bones are off, logarithm: in the median of 102 simulated people, and about it (1.48 times
the median distance). Forearms (-.07, .13) and feet are proposed too poorly to tell a length."""

_ENDS = np.array([[JOINT_INDEX[joint] for joint in bone] for bone in _BONES]).T
_NODES = np.asarray(JOINT_NODES)[_ENDS]
_LEGS = [JOINT_INDEX[f"{side}_{joint}"] for side in ("left", "right") for joint in ("knee", "ankle")]
_BIAS, _SPREAD = np.array(list(_BONES.values())).T

_ONE_FRAME = 0.15
"""Standard deviation of a bone's proposed length in one frame, logarithm; set by hand."""

_SIZE_SPREAD = 0.025
"""Standard deviation of the size that many frames propose, logarithm: 2.3 to 3.1 % by kind of clip."""

_BELIEVED = 0.045
"""The z_0 above: so much larger than proposed skin may make somebody, logarithm. Less (.03, .035) helps those
in clothes a little more, and harms others by half a millimetre (docs/builds.md)."""

_FIRST_FRAMES = 3.0
"""Proposals do not object before so many frames in which all of somebody is clear to see."""

_SUREST = 0.68
"""Confidence of proposals that are clear to see."""

_STRAIGHT = 0.6
"""Legs of who stands, walks or runs are at least this straight: mean cosine between trunk and thighs,
thighs and shanks. In people who kneel, squat, sit or lie bones are proposed up to 30 % too short."""
_STRAIGHTER = 0.8
"""From this on a frame counts in full."""
_UPRIGHT = 0.5
"""Cosine between the trunk and the image's columns, at least."""

_SHORTEST_M, _STEP, _STEPS = 0.05, 0.02, 160
"""Lengths are counted in steps of 2 %, from 5 cm to 1.2 m."""


class BoneLengths(NamedTuple):
    """Logarithms of the proposed lengths of bones, metres, (10,), and how much each counts, (10,)."""

    lengths: Array
    sure: Array


NOTHING = BoneLengths(np.zeros(len(_BONES)), np.zeros(len(_BONES)))
"""Where nobody proposes joints."""


def measure(proposals: Proposals, nodes: Array) -> BoneLengths:
    """Give the bone lengths between proposed joints.

    Bones that point at the camera are proposed too short, and count the less: by the square of what is seen
    of them. Where legs are hidden or cut off nothing says whether somebody stands, and all bones count less.

    Parameters
    ----------
    proposals : Proposals
    nodes : (21, 3) float64
        Those of the fitted body, metres, camera frame: they say how bones lie, and which side is left.
    """
    if not len(proposals.nodes):
        return NOTHING
    side = nearer_naming(nodes[proposals.nodes], proposals.places, proposals.weights)
    places, weights = proposals.places[side], proposals.weights[side]
    apart = np.linalg.norm(places[_ENDS[0]] - places[_ENDS[1]], axis=1)
    bone, ray = nodes[_NODES[0]] - nodes[_NODES[1]], nodes[_NODES[0]] + nodes[_NODES[1]]
    along = (bone * ray).sum(axis=1) ** 2 / ((bone**2).sum(axis=1) * (ray**2).sum(axis=1))
    legs = float(weights[_LEGS].mean()) / _SUREST
    both = weights[_ENDS[0]] * weights[_ENDS[1]] / _SUREST**2
    sure = _stands(nodes) * legs**2 * both * (1.0 - along) ** 2
    return BoneLengths(np.log(np.maximum(apart, _SHORTEST_M)) - _BIAS, sure)


def _stands(nodes: Array) -> float:
    """Tell how much a pose is that of somebody upright on straight legs, 0 to 1."""

    def way(start: str, end: str) -> Array:
        bone = nodes[NODE_INDEX[end]] - nodes[NODE_INDEX[start]]
        return np.asarray(bone / np.linalg.norm(bone))

    trunk = way("neck", "pelvis")
    if trunk[1] < _UPRIGHT:
        return 0.0
    straight = 0.0
    for side in ("left", "right"):
        thigh, shank = way(f"{side}_hip", f"{side}_knee"), way(f"{side}_knee", f"{side}_ankle")
        straight += 0.25 * float(trunk @ thigh + thigh @ shank)
    return min(max((straight - _STRAIGHT) / (_STRAIGHTER - _STRAIGHT), 0.0), 1.0)


class ProposedBones:
    """Proposed bone lengths of one person: weighted medians over frames.

    Parameters
    ----------
    space : BuildSpace
    """

    def __init__(self, space: BuildSpace) -> None:
        rest = space.template.nodes
        self._rest = rest[_NODES[0]] - rest[_NODES[1]]
        self._parts = space.nodes[:, _NODES[0]] - space.nodes[:, _NODES[1]]
        self._counts = np.zeros((len(_BONES), _STEPS))

    def forget(self, kept: float) -> None:
        """Keep a share of what earlier frames proposed."""
        self._counts *= kept

    def add(self, bones: BoneLengths) -> None:
        """Add what a frame proposes."""
        steps = ((bones.lengths - np.log(_SHORTEST_M)) / _STEP).astype(np.int64)
        self._counts[np.arange(len(steps)), np.clip(steps, 0, _STEPS - 1)] += bones.sure

    def excess(self, x: Array) -> float:
        """Give how much of a size is due to clothes.

        Parameters
        ----------
        x : (14,) float64
            Logarithm of the size, and build.

        Returns
        -------
        float
            To be taken from the logarithm; 0 where proposals do not object.
        """
        total = self._counts.sum(axis=1)
        if total.max() < _FIRST_FRAMES:
            return 0.0
        told = total > 0.0
        weight = np.zeros(len(total))
        weight[told] = 1.0 / (_SPREAD[told] ** 2 + _ONE_FRAME**2 / total[told])
        z = float(weight @ (self._lengths(x) - self._medians(total)) / weight.sum())
        skin = (2.0 * max(0.0, z - _BELIEVED)) ** 2
        return skin / (skin + _SIZE_SPREAD**2 + 1.0 / float(weight.sum())) * z

    def _lengths(self, x: Array) -> Array:
        """Logarithms of a build's bone lengths, metres, (10,)."""
        bones = self._rest + np.tensordot(x[1:], self._parts, 1)
        return np.asarray(x[0] + np.log(np.linalg.norm(bones, axis=1)))

    def _medians(self, total: Array) -> Array:
        """Logarithms of the median proposed lengths, metres, (10,)."""
        up = np.cumsum(self._counts, axis=1)
        step, rows = np.argmax(up >= 0.5 * total[:, None], axis=1), np.arange(len(total))
        own = self._counts[rows, step]
        inside = (0.5 * total - up[rows, step] + own) / np.maximum(own, 1e-12)
        return np.asarray(np.log(_SHORTEST_M) + _STEP * (step + inside))
