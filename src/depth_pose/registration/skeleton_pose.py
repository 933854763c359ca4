"""From a published skeleton back to a pose of the body, so that its mesh can be skinned again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.angles import rotation_between
from depth_pose.body.body import Body
from depth_pose.geometry import quat_to_matrix
from depth_pose.registration.articulated import BodyPose
from depth_pose.skeleton import JOINT_INDEX, JOINT_NODES, NODE_INDEX, NODES
from depth_pose.types import Skeleton

_AIMED = (
    ("left_shoulder", "left_elbow"),
    ("left_elbow", "left_wrist"),
    ("right_shoulder", "right_elbow"),
    ("right_elbow", "right_wrist"),
    ("left_hip", "left_knee"),
    ("left_knee", "left_ankle"),
    ("right_hip", "right_knee"),
    ("right_knee", "right_ankle"),
)
"""Segments that are turned to point to the joint at their end."""


def pose_from_skeleton(body: Body, skeleton: Skeleton) -> BodyPose:
    """Find the pose of a body that a skeleton describes.

    Segments take the rotations of their joints, corrected by the smallest turn that makes the limbs
    point to their next joint. A clavicle takes the chest's rotation and the smallest turn that
    points it to the shoulder.

    Parameters
    ----------
    body : Body
    skeleton : Skeleton
        With its 19 joints.

    Returns
    -------
    BodyPose
        In the skeleton's frame; its forward kinematics reaches the skeleton's joints where the
        skeleton has the body's proportions.
    """
    rotations = np.empty((len(NODES), 3, 3))
    rotations[JOINT_NODES] = quat_to_matrix(skeleton.quats_xyzw)
    at, scale = skeleton.positions, skeleton.scale
    for start, end in _AIMED:
        bone = body.nodes[NODE_INDEX[end]] - body.nodes[NODE_INDEX[start]]
        seen = at[JOINT_INDEX[end]] - at[JOINT_INDEX[start]]
        rotations[NODE_INDEX[start]] = _aim(rotations[NODE_INDEX[start]], bone, seen)
    chest = rotations[NODE_INDEX["chest"]]
    for side in ("left", "right"):
        clavicle, shoulder = NODE_INDEX[f"{side}_clavicle"], NODE_INDEX[f"{side}_shoulder"]
        root = at[JOINT_INDEX["chest"]] + scale * chest @ (
            body.nodes[clavicle] - body.nodes[NODE_INDEX["chest"]]
        )
        bone = body.nodes[shoulder] - body.nodes[clavicle]
        rotations[clavicle] = _aim(chest, bone, at[JOINT_INDEX[f"{side}_shoulder"]] - root)
    return BodyPose(rotations, at[JOINT_INDEX["pelvis"]].copy(), scale)


def _aim(
    rotation: NDArray[np.float64], bone: NDArray[np.float64], seen: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Turn a segment by the smallest rotation that brings its bone to a seen direction."""
    now = rotation @ bone
    sizes = float(np.linalg.norm(now)), float(np.linalg.norm(seen))
    if min(sizes) < 1e-6:
        return rotation
    return np.asarray(rotation_between(now / sizes[0], seen / sizes[1]) @ rotation)
