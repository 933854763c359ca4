"""Skeletons of simulated people whose movement is known, with the errors of a depth camera's."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from depth_pose.core.result import Skeleton
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL, matrix_to_quat, rotation_y
from depth_pose.core.skeleton import JOINT_NODES
from depth_pose.detect.floor import Floor
from depth_pose.io.mcap_write import SkeletonWriter
from depth_pose.motion.clip import Clip
from depth_pose.offline import FLOOR
from skeletons import make_skeleton

START_NS = 1_700_000_000_000_000_000
HEIGHT_M = 1.1
ERROR_M = 0.012
"""Standard deviation of each joint in each direction; errors last for some frames, as a filter's do."""


def camera_joints(
    clip: Clip, turn_deg: float = 0.0, distance_m: float = 4.0
) -> tuple[np.ndarray, np.ndarray]:
    """Joints (T, 19, 3) and their segments' rotations before a level camera."""
    turn = rotation_y(np.radians(turn_deg))
    middle = 0.5 * (clip.roots.min(axis=0) + clip.roots.max(axis=0)) * [1, 0, 1]
    joints = (clip.nodes()[:, JOINT_NODES] - middle) @ turn.T @ R_CAMERA_FACING_MODEL.T
    rotations = R_CAMERA_FACING_MODEL @ turn @ clip.rotations[:, JOINT_NODES]
    return joints + [0.0, HEIGHT_M, distance_m], matrix_to_quat(rotations)


def skeletons_of(clip: Clip, turn_deg: float = 0.0, seed: int = 0, **values) -> list[Skeleton]:
    """What a depth camera would answer."""
    joints, quats = camera_joints(clip, turn_deg)
    rng = np.random.default_rng(seed)
    noise = rng.normal(0.0, 1.0, joints.shape)
    for i in range(1, len(noise)):
        noise[i] = 0.8 * noise[i - 1] + 0.6 * noise[i]
    joints = joints + ERROR_M * noise
    return [
        make_skeleton(joints[i], quats_xyzw=quats[i], stamp_ns=START_NS + round(i * 1e9 / clip.fps), **values)
        for i in range(len(joints))
    ]


def write(path: Path, skeletons: list[Skeleton], knows_floor: bool = True) -> Path:
    """Write a recording of one person, with the floor as `depth-pose run` records it."""
    with SkeletonWriter(path) as writer:
        for skeleton in skeletons:
            writer.write_people([skeleton], skeleton.stamp_ns, skeleton.frame_id)
        if knows_floor:
            writer.write_metadata(FLOOR, Floor(np.array([0.0, -1.0, 0.0]), HEIGHT_M).to_metadata())
    return path
