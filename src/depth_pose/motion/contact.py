"""Contact of the reference body with the floor and with itself.

The body is a set of capsules around the skeleton's bones (half-breadths rounded from NASA-STD-3000,
*Man-Systems Integration Standards*, section 3.3.1, 50th percentile). Arms that enter the trunk, the
head, a leg or each other are turned about their shoulder until they do not; legs that enter
each other are turned about the hip.

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.skeleton import ADULT_STATURE_M, NODE_INDEX, forward_kinematics, rest_nodes
from depth_pose.motion._contact_kernels import push_apart

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Separated:
    """Poses after their limbs were pushed out of the body.

    Attributes
    ----------
    rotations : (N, 21, 3, 3) float64
    depth : (N,) float64
        Deepest remaining penetration, metres.
    """

    rotations: Array
    depth: Array


def separate_limbs(rotations: Array, rounds: int = 16) -> Separated:
    """Push arms and legs out of the body.

    Parameters
    ----------
    rotations : (N, 21, 3, 3)
        Segment rotations.
    rounds : int
        Corrections tried for each pose.
    """
    out = np.ascontiguousarray(rotations, dtype=np.float64).copy()
    depth = push_apart(out, rest_nodes() * ADULT_STATURE_M, rounds)
    return Separated(out, depth)


_HEEL_M, _TIP_M = 0.045, 0.055
"""Heel behind the ankle and tip of the toes before the toe joint, metres (as `tools/body/anatomy.py`)."""
_KNEECAP_M = 0.06
"""Front of the knee before its joint, metres."""
_SEAT_M = (-0.10, -0.06)
"""Seat below and behind the pelvis' joint, metres."""
_SOFTNESS_M = 0.008
"""Points within about this height (m) of the lowest one share the ground contact."""
_IN_THE_AIR_M = 0.02
"""Height of the lowest point (m) above which there is no ground contact."""


def _support_points() -> tuple[tuple[int, ...], Array]:
    """Node of the segment with each supporting point, and the point relative to it at rest."""
    at = rest_nodes() * ADULT_STATURE_M
    nodes, offsets = [], []
    for side in ("left", "right"):
        ankle, toe = NODE_INDEX[f"{side}_ankle"], NODE_INDEX[f"{side}_foot"]
        for z in (at[ankle, 2] - _HEEL_M, at[toe, 2], at[toe, 2] + _TIP_M):
            nodes.append(ankle)
            offsets.append(np.array([0.0, -at[ankle, 1], z - at[ankle, 2]]))
        knee = NODE_INDEX[f"{side}_knee"]
        nodes.append(knee)
        offsets.append(np.array([0.0, 0.0, _KNEECAP_M]))
    nodes.append(0)
    offsets.append(np.array([0.0, *_SEAT_M]))
    return tuple(nodes), np.array(offsets)


_SUPPORT_NODES, _SUPPORT_OFFSETS = _support_points()


def support_points(rotations: Array) -> Array:
    """Places where the body can rest on the floor: soles, knees, seat.

    Parameters
    ----------
    rotations : (..., 21, 3, 3)

    Returns
    -------
    (..., 9, 3) float64
        Metres for a 1.75 m body, relative to the pelvis, axes of the model frame.
    """
    nodes = forward_kinematics(rotations, np.zeros(3), rest_nodes() * ADULT_STATURE_M)
    picked = list(_SUPPORT_NODES)
    turned = (rotations[..., picked, :, :] @ _SUPPORT_OFFSETS[..., None])[..., 0]
    return nodes[..., picked, :] + turned


def pelvis_height(rotations: Array) -> Array:
    """Height of the pelvis with the body's lowest point on the floor, (..., 21, 3, 3) to (...)."""
    return np.asarray(-support_points(rotations)[..., 1].min(axis=-1))


def walk_on_floor(rotations: Array, lift: Array) -> Array:
    """Return the pelvis positions that keep the lower foot in place.

    Parameters
    ----------
    rotations : (T, 21, 3, 3)
        Segment rotations of successive frames.
    lift : (T,)
        Height of the lowest point above the floor (jumps), metres.

    Returns
    -------
    (T, 3) float64
        Pelvis, metres, y up from the floor, starting above the origin.
    """
    points = support_points(rotations)
    height = points[..., 1] - points[..., 1].min(axis=-1, keepdims=True)
    hold = np.exp(-height / _SOFTNESS_M)
    step = np.diff(points, axis=0)
    hold = hold[:-1] * hold[1:]
    moved = -np.sum(hold[..., None] * step, axis=1) / np.sum(hold, axis=1)[..., None]
    # In the air the body keeps its horizontal velocity.
    grounded = np.clip(1.0 - lift[1:] / _IN_THE_AIR_M, 0.0, 1.0)
    velocity = moved[:, [0, 2]]
    for t in range(1, len(velocity)):
        velocity[t] = grounded[t] * velocity[t] + (1.0 - grounded[t]) * velocity[t - 1]
    roots = np.zeros((len(rotations), 3))
    roots[1:, [0, 2]] = np.cumsum(velocity, axis=0)
    roots[:, 1] = -points[..., 1].min(axis=-1) + lift
    return roots
