"""Limb search: try the bank's arm and leg poses on what the fitted body leaves unexplained.

A whole-body exemplar seldom has both arms right, and a fit that starts with a limb far from its
place does not find it. But the limbs' poses of all exemplars, mirrored and thinned to a few
hundred, cover what limbs can do. After a fit, the points that the rest of the body does not
explain are put against every configuration of the left and of the right limb: balls along the
limb that stand in free space or before the seen surface cost their area, points off every ball
cost theirs, and the pair with the least sum is one more start for the fit. The idea of
re-assembling partial matches is that of C. Plagemann et al., *Real-time identification and
localization of body parts from depth images* (ICRA 2010), in spirit; the scoring here is our own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.body._selection import farthest_rows
from depth_pose.body.body import Body
from depth_pose.geometry import quat_to_matrix
from depth_pose.registration import _limb_kernels as kernels
from depth_pose.registration.articulated import BodyPose
from depth_pose.render import DepthComparer
from depth_pose.skeleton import NODE_INDEX, forward_kinematics, mirror_rotations
from depth_pose.types import PERSON

_LIMBS: tuple[tuple[str, tuple[str, ...], tuple[str, ...]], ...] = (
    ("chest", ("clavicle", "shoulder", "elbow", "wrist"), ("shoulder", "elbow", "wrist")),
    ("pelvis", ("hip", "knee", "ankle", "foot"), ("hip", "knee", "ankle")),
)
"""For arms and legs: the segment they hang on, the nodes that they turn, the bones that are sampled."""

_CONFIGURATIONS = 400
_POSES = 6000
_EXPLAINED_M = 0.06
_MOST_POINTS = 80
_BEST = 24


@dataclass(frozen=True)
class _LimbPair:
    """Configurations of a left and a right limb; index 0 is left.

    Attributes
    ----------
    anchor : int
        Node of the segment that both hang on.
    nodes : (2, n) int
    rotations : (2, L, n, 3, 3)
        ``R_anchor_segment`` of each node's segment.
    samples : (2, L, S, 3)
        Ball centres in the anchor's frame, from the anchor node, scale 1, metres.
    radii, areas : (S,)
        Of the balls, metres and square metres of limb seen from the side.
    faces : (F, 3)
        Faces of the body without both limbs.
    """

    anchor: int
    nodes: NDArray[np.int64]
    rotations: NDArray[np.float64]
    samples: NDArray[np.float64]
    radii: NDArray[np.float64]
    areas: NDArray[np.float64]
    faces: NDArray[np.int32]


class LimbSearch:
    """Proposes poses with one pair of limbs exchanged."""

    def __init__(self, bank: Bank) -> None:
        step = max(1, bank.poses // _POSES)
        rotations = quat_to_matrix(bank.pose_quats[::step].astype(np.float64))
        self._pairs = tuple(_make_pair(bank.body, rotations, *limb) for limb in _LIMBS)

    def propose(
        self, pose: BodyPose, vertices: NDArray[np.float64], comparer: DepthComparer
    ) -> list[BodyPose]:
        """Exchange the arms, and the legs, where others explain more.

        Parameters
        ----------
        pose : BodyPose
            A fitted pose.
        vertices : (V, 3) float64
            The body in that pose, camera frame.
        comparer : DepthComparer
            For the same input.

        Returns
        -------
        list of BodyPose
            At most one for the arms and one for the legs.
        """
        nodes = forward_kinematics(pose.rotations, pose.root, self._rest_nodes, pose.scale)
        proposals = []
        for pair in self._pairs:
            changed = _exchange(pair, pose, nodes, vertices, comparer)
            if changed is not None:
                proposals.append(changed)
        return proposals
