"""Pose of the body from a published skeleton, so that its mesh can be skinned again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.body.pose import BodyPose
from depth_pose.core.result import Skeleton
from depth_pose.core.rotations import quat_to_matrix
from depth_pose.core.skeleton import JOINT_NODES, MIRROR_NODES, NODE_INDEX, NODES
from depth_pose.refine import _aim_kernels as kernels

AIMED = np.array(
    [
        (NODE_INDEX[f"{side}_{start}"], NODE_INDEX[f"{side}_{end}"])
        for side in ("left", "right")
        for start, end in (
            ("clavicle", "shoulder"),
            ("shoulder", "elbow"),
            ("elbow", "wrist"),
            ("hip", "knee"),
            ("knee", "ankle"),
        )
    ]
).T
"""Segments that are turned toward the node at their end, and those nodes."""

_ABOUT_FACE = np.diag([-1.0, 1.0, -1.0])
"""Half a turn about the vertical."""


def pose_from_skeleton(body: Body, skeleton: Skeleton) -> BodyPose:
    """Find the pose of a body that a skeleton describes.

    Parameters
    ----------
    body : Body
    skeleton : Skeleton
        A skeleton has no clavicles; they take the chest's rotation.

    Returns
    -------
    BodyPose
        In the skeleton's frame (`pose_from_nodes`).
    """
    rotations = np.empty((len(NODES), 3, 3))
    nodes = np.empty((len(NODES), 3))
    rotations[JOINT_NODES], nodes[JOINT_NODES] = quat_to_matrix(skeleton.quats_xyzw), skeleton.positions
    chest = NODE_INDEX["chest"]
    for side in ("left", "right"):
        clavicle = NODE_INDEX[f"{side}_clavicle"]
        rotations[clavicle] = rotations[chest]
        reach = skeleton.scale * (body.nodes[clavicle] - body.nodes[chest])
        nodes[clavicle] = nodes[chest] + rotations[chest] @ reach
    return pose_from_nodes(body, rotations, nodes, skeleton.scale)


def about_face(pose: BodyPose) -> BodyPose:
    """Turn a body about its own vertical, limbs in place: left and right, front and back are exchanged."""
    return replace(pose, rotations=pose.rotations[MIRROR_NODES] @ _ABOUT_FACE)


def aim_limbs(body: Body, rotations: NDArray[np.float64], nodes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn limbs by the smallest rotations that point them at their next node; return (21, 3, 3)."""
    rotations = rotations.copy()
    kernels.aim_segments(body.nodes, AIMED, nodes, rotations)
    return rotations


def pose_from_nodes(
    body: Body, rotations: NDArray[np.float64], nodes: NDArray[np.float64], scale: float
) -> BodyPose:
    """Find the pose of a body from approximate segment rotations and nodes.

    Parameters
    ----------
    body : Body
    rotations : (21, 3, 3) float64
    nodes : (21, 3) float64
        Metres; need not have the body's proportions.
    scale : float

    Returns
    -------
    BodyPose
        Limbs are turned by the smallest rotations that point them at their next node, and the
        pelvis is placed so that the nodes of the pose lie around the given ones. If these have
        the body's proportions, they are met exactly.
    """
    rotations = aim_limbs(body, rotations, nodes)
    reached = body.place(rotations, nodes[0], scale)
    return BodyPose(rotations, nodes[0] + (nodes - reached).mean(axis=0), scale)
