r"""Proposed bone lengths, and how much of a person's apparent size is due to clothes.

A build (`refine.personal`) is measured on the visible surface, and clothes only ever add to that: a coat, a
skirt or thick hair increase the size, by up to a quarter. The joint net is trained on joints of
people in clothes. The lengths between its proposals are coarse in a single frame and for a single bone, but
their median over frames and bones is right within 3 % for any clothes. Clothes also make arms and legs
thicker. With :math:`z` the mean log ratio of the build's bone lengths to the proposed ones, and :math:`g` the
mean of its girths of arms and legs,

.. math:: \log s \leftarrow \log s - \max(0,\; z + a\, g - z_0).

The skin counts more for thin limbs and less for thick ones.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.build import BUILD_NAMES, BuildSpace, combine
from depth_pose.core.rotations import lengths_of
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES
from depth_pose.refine.running_median import Bins
from depth_pose.refine.upright_stance import SUREST, Standing
from depth_pose.track.state import Histogram

Array = NDArray[np.float64]

BONES = {
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
"""Bias and standard deviation of the log length of proposed bones, measured on 81 simulated people.
Forearms and feet are excluded: their proposals are too imprecise."""

_ENDS = np.array([[JOINT_INDEX[joint] for joint in bone] for bone in BONES]).T
NODES = np.asarray(JOINT_NODES)[_ENDS]
"""Body nodes (2, B) at the two ends of each bone."""
BIAS, _SPREAD = np.array(list(BONES.values())).T
"""Bias and standard deviation (B,) of each bone's log length, in the order of `BONES`."""

_ONE_FRAME = 0.15
"""Standard deviation of a bone's log length in one frame; .08 and .3 err as much."""

_GIRTHS = [1 + BUILD_NAMES.index(girth) for girth in ("arm_girth", "leg_girth")]

_PER_GIRTH, _BELIEVED = 0.25, 0.03
"""The `a` and `z_0` of the module's equation, chosen on 77 simulated people with and without clothes."""

FIRST_FRAMES = 3.0
"""Number of frames with the whole person clearly visible before proposals are used."""

_SHORTEST_M = 0.05
"""Minimum length of a bone (m)."""

LENGTHS = Bins(len(BONES), float(np.log(_SHORTEST_M)), 0.02, 160)
"""Histogram of the log lengths: 2 % steps from 5 cm to 1.2 m."""


class BoneLengths(NamedTuple):
    """Log lengths of the proposed bones (m), (10,), and their weights, (10,)."""

    lengths: Array
    sure: Array


def measure_bones(standing: Standing, nodes: Array) -> BoneLengths:
    """Compute the bone lengths between proposed joints.

    Bones that point at the camera are proposed too short; their weight is the square of their visible share.

    Parameters
    ----------
    standing : Standing
    nodes : (21, 3) float64
        Nodes of the fitted body, metres, camera frame; they define the bone directions.
    """
    places, weights = standing.places, standing.weights
    apart = lengths_of(places[_ENDS[0]] - places[_ENDS[1]])
    bone, ray = nodes[NODES[0]] - nodes[NODES[1]], nodes[NODES[0]] + nodes[NODES[1]]
    along = (bone * ray).sum(axis=1) ** 2 / ((bone**2).sum(axis=1) * (ray**2).sum(axis=1))
    both = weights[_ENDS[0]] * weights[_ENDS[1]] / SUREST**2
    return BoneLengths(
        np.log(np.maximum(apart, _SHORTEST_M)) - BIAS, standing.sure * both * (1.0 - along) ** 2
    )


class ProposedBones:
    """Compares a build with proposed bone lengths, weighted medians over frames.

    Parameters
    ----------
    space : BuildSpace
    """

    def __init__(self, space: BuildSpace) -> None:
        rest = space.template.nodes
        self._rest = rest[NODES[0]] - rest[NODES[1]]
        self._parts = space.nodes[:, NODES[0]] - space.nodes[:, NODES[1]]

    def excess(self, told: Histogram, x: Array) -> float:
        """Compute how much of the log size is due to clothes.

        Parameters
        ----------
        told : Histogram
            Of `LENGTHS`, over the person's frames.
        x : (14,) float64
            Logarithm of the size, and build.

        Returns
        -------
        float
            Amount to subtract from the log size; 0 where the proposals agree.
        """
        total = told.total
        if total.max() < FIRST_FRAMES:
            return 0.0
        known = total > 0.0
        weight = np.zeros(len(total))
        weight[known] = 1.0 / (_SPREAD[known] ** 2 + _ONE_FRAME**2 / total[known])
        z = float(weight @ (self._lengths(x) - LENGTHS.medians(told)) / weight.sum())
        return max(0.0, z + _PER_GIRTH * float(x[_GIRTHS].mean()) - _BELIEVED)

    def _lengths(self, x: Array) -> Array:
        """Compute the log bone lengths (m) of a build, (10,)."""
        bones = self._rest + combine(x[1:], self._parts)
        return np.asarray(x[0] + np.log(lengths_of(bones)))
