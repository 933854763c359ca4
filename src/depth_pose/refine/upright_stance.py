"""Proposed joints of somebody who stands: with them builds are told besides skin.

Of people who kneel, squat, sit or lie bones are proposed up to 30 % too short, and where legs are hidden or
cut off nothing says whether somebody stands; so neither counts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.skeleton import JOINT_INDEX, NODE_INDEX
from depth_pose.refine._aim_kernels import nearer_naming
from depth_pose.track.target import Proposals

Array = NDArray[np.float64]

SUREST = 0.68
"""Confidence of proposals that are clear to see."""

_LEGS = [JOINT_INDEX[f"{side}_{joint}"] for side in ("left", "right") for joint in ("knee", "ankle")]

_STRAIGHT = 0.6
"""Legs of who stands, walks or runs are at least this straight: mean cosine between trunk and thighs,
thighs and shanks."""
_STRAIGHTER = 0.8
"""From this on a frame counts in full."""
_UPRIGHT = 0.5
"""Cosine between the trunk and the image's columns, at least."""


class Standing(NamedTuple):
    """Proposed joints of somebody who stands, sides named as in the fitted body.

    Attributes
    ----------
    places : (19, 3) float64
        Metres, camera frame.
    weights : (19,) float64
        0 to 1.
    sure : float
        How clear it is that they stand, 0 to 1.
    """

    places: Array
    weights: Array
    sure: float


def find_standing(proposals: Proposals, nodes: Array) -> Standing | None:
    """Give the proposed joints of somebody who stands; None where nobody does, or none are proposed.

    Parameters
    ----------
    proposals : Proposals
    nodes : (21, 3) float64
        Those of the fitted body, metres, camera frame: they say how bones lie, and which side is left.
    """
    if not len(proposals.nodes):
        return None
    side = nearer_naming(nodes[proposals.nodes], proposals.places, proposals.weights)
    weights = proposals.weights[side]
    sure = _stands(nodes) * (float(weights[_LEGS].mean()) / SUREST) ** 2
    return Standing(proposals.places[side], weights, sure) if sure > 0.0 else None


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
