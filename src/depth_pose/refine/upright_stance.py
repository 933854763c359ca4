"""Proposed joints of a standing person, used to learn builds besides the skin.

When people kneel, squat, sit or lie, bones are proposed up to 30 % too short; when legs are hidden or cut
off, standing cannot be verified. Both cases are excluded.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.measurement import Proposals
from depth_pose.core.rotations import length_of
from depth_pose.core.skeleton import JOINT_INDEX, NODE_INDEX, Nodes
from depth_pose.refine._aim_kernels import nearer_naming

Array = NDArray[np.float64]

SUREST = 0.68
"""Confidence of proposals for clearly visible joints."""

_LEGS = [JOINT_INDEX[f"{side}_{joint}"] for side in ("left", "right") for joint in ("knee", "ankle")]

_STRAIGHT = 0.6
"""Least straightness of standing, walking or running legs: mean cosine trunk-thigh and thigh-shank."""
_STRAIGHTER = 0.8
"""Straightness from which a frame has full weight."""
_UPRIGHT = 0.5
"""Least cosine between the trunk and the image columns."""


class Standing(NamedTuple):
    """Proposed joints of a standing person, with sides named as in the fitted body.

    Attributes
    ----------
    places : (19, 3) float64
        Metres, camera frame.
    weights : (19,) float64
        0 to 1.
    sure : float
        Confidence that the person stands, 0 to 1.
    """

    places: Array
    weights: Array
    sure: float


def find_standing(proposals: Proposals, nodes: Nodes) -> Standing | None:
    """Return the proposed joints of a standing person; None if not standing or without proposals.

    Parameters
    ----------
    proposals : Proposals
    nodes : (21, 3) float64
        Nodes of the fitted body, metres, camera frame; they define bone directions and sides.
    """
    if not len(proposals.nodes):
        return None
    side = nearer_naming(nodes[proposals.nodes], proposals.places, proposals.weights)
    weights = proposals.weights[side]
    sure = _stands(nodes) * (float(weights[_LEGS].mean()) / SUREST) ** 2
    return Standing(proposals.places[side], weights, sure) if sure > 0.0 else None


def _stands(nodes: Nodes) -> float:
    """Compute how well a pose matches an upright person on straight legs, 0 to 1."""

    def way(start: str, end: str) -> Array:
        bone = nodes[NODE_INDEX[end]] - nodes[NODE_INDEX[start]]
        return np.asarray(bone / length_of(bone))

    trunk = way("neck", "pelvis")
    if trunk[1] < _UPRIGHT:
        return 0.0
    straight = 0.0
    for side in ("left", "right"):
        thigh, shank = way(f"{side}_hip", f"{side}_knee"), way(f"{side}_knee", f"{side}_ankle")
        straight += 0.25 * float(trunk @ thigh + thigh @ shank)
    return min(max((straight - _STRAIGHT) / (_STRAIGHTER - _STRAIGHT), 0.0), 1.0)
