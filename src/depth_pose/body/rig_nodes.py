"""Map the project's nodes to a foreign rig: their positions, and the bones that move with each."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.source_motion import SourceMotion
from depth_pose.core.errors import InputError
from depth_pose.core.skeleton import NODE_INDEX, NODES, rest_nodes

Array = NDArray[np.float64]

_TRUNK = ("pelvis", "spine", "chest", "neck")
_LIMBS = ("clavicle", "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "foot")

_SLACK = 0.03
"""Maximum height of a node above a trunk bone assigned to it, in statures."""


def model_turn(name: str, heads: Array, found: dict[str, int]) -> Array:
    """Estimate the rotation from the file's axes to the model frame from hips, shoulders and head.

    Parameters
    ----------
    name : str
        Of the file, for errors.
    heads : (B, 3) float64
        Origins of the bones, in the file's axes and unit.
    found : dict
        Row of each joint (`depth_pose.body.joint_names.find_joints`).

    Returns
    -------
    (3, 3) float64

    Raises
    ------
    InputError
        Where these joints lie in one place.
    """
    names = ("left_hip", "right_hip", "left_shoulder", "right_shoulder", "head")
    theirs = _trunk_axes(heads[[found[n] for n in names]])
    if not np.isfinite(theirs).all():
        raise InputError(f"{name}: head, hips and shoulders of the rig lie in one place")
    return np.asarray(_trunk_axes(rest_nodes()[[NODE_INDEX[n] for n in names]]).T @ theirs)


def _trunk_axes(points: Array) -> Array:
    """Axes to the left, up and forward, as rows, of two hips, two shoulders and a head."""
    with np.errstate(invalid="ignore", divide="ignore"):
        up = points[4] - points[:2].mean(axis=0)
        up = up / np.linalg.norm(up)
        left = points[2] - points[3]
        left = left - up * (left @ up)
        left = left / np.linalg.norm(left)
    return np.stack([left, up, np.cross(left, up)])


def place_nodes(heads: Array, found: dict[str, int]) -> Array:
    """Place our nodes: limbs and head at the rig's joints, the trunk between hips, shoulders and head.

    Parameters
    ----------
    heads : (B, 3) float64
        Origins of the bones, in our axes and the file's unit.
    found : dict
        Row of each joint.

    Returns
    -------
    (21, 3) float64
    """
    ours = rest_nodes()

    def middle(at: Any, part: str) -> Array:
        return np.asarray((at(f"left_{part}") + at(f"right_{part}")) / 2)

    def rest(name: str) -> Array:
        return np.asarray(ours[NODE_INDEX[name]])

    def rig(name: str) -> Array:
        return np.asarray(heads[found[name]])

    hips, shoulders, rest_hips = middle(rig, "hip"), middle(rig, "shoulder"), middle(rest, "hip")
    size = np.linalg.norm(shoulders - hips) / np.linalg.norm(middle(rest, "shoulder") - rest_hips)
    nodes = hips + size * (ours - rest_hips)
    rise = (rest("neck")[1] - middle(rest, "shoulder")[1]) / (rest("head")[1] - middle(rest, "shoulder")[1])
    nodes[NODE_INDEX["head"]] = rig("head")
    nodes[NODE_INDEX["neck"]] = shoulders + rise * (rig("head") - shoulders)
    for side in ("left_", "right_"):
        for part in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle"):
            nodes[NODE_INDEX[side + part]] = rig(side + part)
        toes = rest(f"{side}foot") - rest(f"{side}ankle")
        toe = side + "toe"
        foot = rig(toe) if toe in found else nodes[NODE_INDEX[f"{side}ankle"]] + size * toes
        nodes[NODE_INDEX[f"{side}foot"]] = foot
    return nodes


def bone_owners(rig: SourceMotion, heads: Array, found: dict[str, int], nodes: Array) -> NDArray[np.int64]:
    """Assign each bone to a node: limbs by descent, the trunk by height.

    Parameters
    ----------
    rig : SourceMotion
        Its bones, parents before children.
    heads : (B, 3) float64
        Their origins, in our axes.
    found : dict
        Row of each joint.
    nodes : (21, 3) float64
        As `place_nodes` gives them.

    Returns
    -------
    (B,) int64
    """
    limb = {row: name.replace("toe", "foot") for name, row in found.items() if name.split("_")[-1] != "chest"}
    limb = {row: name for row, name in limb.items() if name == "head" or name.split("_")[-1] in _LIMBS}
    slack = _SLACK * np.ptp(nodes[:, 1])
    owners = np.zeros(len(heads), np.int64)
    for k, parent in enumerate(rig.parents.tolist()):
        if k in limb:
            owners[k] = NODE_INDEX[limb[k]]
        elif parent >= 0 and NODES[owners[parent]] not in _TRUNK:
            owners[k] = owners[parent]
        else:
            below = [n for n in _TRUNK if nodes[NODE_INDEX[n], 1] <= heads[k, 1] + slack]
            owners[k] = NODE_INDEX[below[-1]] if below else NODE_INDEX["pelvis"]
    return owners
