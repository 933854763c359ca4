"""Motion and sets of poses: mirroring, thinning, choosing for coverage.

Poses are compared as the joint positions of a 1.75 m body with the pelvis at the origin and the
heading removed. The distance of two poses is the root mean square over the 19 joints of their
distance in metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.farthest_points import farthest_rows, keep_apart
from depth_pose.core.rotations import rotation_y
from depth_pose.core.skeleton import (
    ADULT_STATURE_M,
    JOINT_NODES,
    MIRROR_JOINTS,
    forward_kinematics,
    mirror_rotations,
    rest_nodes,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Clip:
    """A motion of the reference body.

    Attributes
    ----------
    name : str
    fps : float
        Frames a second.
    rotations : (T, 21, 3, 3) float64
        Segment rotations, rest pose to model frame.
    roots : (T, 3) float64
        Pelvis in the model frame, metres for a 1.75 m body, floor at y = 0.
    """

    name: str
    fps: float
    rotations: Array
    roots: Array

    def __len__(self) -> int:
        return len(self.rotations)

    def nodes(self) -> Array:
        """Positions of the nodes of the reference body, (T, 21, 3), metres."""
        return forward_kinematics(self.rotations, self.roots, rest_nodes() * ADULT_STATURE_M)

    def mirrored(self) -> Clip:
        """Return the motion with left and right exchanged."""
        flip = np.array([-1.0, 1.0, 1.0])
        return Clip(self.name + " (mirrored)", self.fps, mirror_rotations(self.rotations), self.roots * flip)


@dataclass(frozen=True)
class PoseSet:
    """Poses that face +z.

    Attributes
    ----------
    rotations : (N, 21, 3, 3) float64
        Segment rotations, rest pose to model frame.
    families : tuple of str
        Name of the motion that each pose comes from, for reports.
    """

    rotations: Array
    families: tuple[str, ...]

    def __post_init__(self) -> None:
        if len(self.rotations) != len(self.families):
            raise ValueError(f"{len(self.rotations)} poses but {len(self.families)} families")

    def __len__(self) -> int:
        return len(self.rotations)

    def take(self, rows: NDArray[np.int64]) -> PoseSet:
        """Return the poses of some rows, in that order."""
        return PoseSet(self.rotations[rows], tuple(self.families[i] for i in rows))

    def mirrored(self) -> PoseSet:
        """Return the mirror images."""
        return PoseSet(mirror_rotations(self.rotations), self.families)


def join_poses(*sets: PoseSet) -> PoseSet:
    """Concatenate sets."""
    families = tuple(family for poses in sets for family in poses.families)
    return PoseSet(np.concatenate([poses.rotations for poses in sets]), families)


def heading(rotations: Array) -> Array:
    """Direction in which the pelvis faces, radians about +y from +z, (..., 21, 3, 3) to (...).

    Measured on the line of the hips, which forward bending leaves alone.
    """
    left = rotations[..., 0, :, 0]
    return np.arctan2(-left[..., 2], left[..., 0])


def without_heading(rotations: Array) -> Array:
    """Turn poses to face +z, (..., 21, 3, 3) to (..., 21, 3, 3)."""
    return rotation_y(-heading(rotations))[..., None, :, :] @ rotations


def joint_positions(rotations: Array) -> Array:
    """Joints of the reference body for comparing poses.

    Parameters
    ----------
    rotations : (N, 21, 3, 3)

    Returns
    -------
    (N, 19, 3) float64
        Metres, 1.75 m body, pelvis at the origin, facing +z.
    """
    nodes = forward_kinematics(without_heading(rotations), np.zeros(3), rest_nodes() * ADULT_STATURE_M)
    return nodes[:, JOINT_NODES]


def mirror_joints(joints: Array) -> Array:
    """Mirror (..., 19, 3) joint positions in the person's mid-plane."""
    return np.asarray(joints[..., MIRROR_JOINTS, :] * np.array([-1.0, 1.0, 1.0]))


def _principal_rows(joints: Array) -> tuple[NDArray[np.float32], Array, Array]:
    """Rotate joints into rows whose first columns vary most, so that sums of squares can stop early.

    The rotation keeps distances; the rows are scaled so that they are RMS joint distances.
    """
    flat = joints.reshape(len(joints), -1) / np.sqrt(joints.shape[1])
    mean = flat.mean(axis=0)
    _, axes = np.linalg.eigh((flat - mean).T @ (flat - mean))
    axes = axes[:, ::-1]
    return np.ascontiguousarray((flat - mean) @ axes, dtype=np.float32), mean, axes


def remove_near_duplicates(poses: PoseSet, distance_m: float) -> PoseSet:
    """Drop every pose that is close to one kept before.

    Parameters
    ----------
    poses : PoseSet
    distance_m : float
        RMS joint distance below which two poses count as one.

    Returns
    -------
    PoseSet
        In the same order; no two of them are nearer than ``distance_m``.
    """
    if len(poses) == 0:
        return poses
    rows, _, _ = _principal_rows(joint_positions(poses.rotations))
    return poses.take(np.flatnonzero(keep_apart(rows, np.float32(distance_m**2))))


def choose_for_coverage(
    poses: PoseSet, count: int, weights: Array | None = None, mirrored: bool = False
) -> NDArray[np.int64]:
    """Choose poses that lie far apart (`depth_pose.core.farthest_points.farthest_rows`).

    With weights, the next pose is the one of greatest weight times distance.

    Parameters
    ----------
    poses : PoseSet
    count : int
        How many rows to choose, at most as many as there are.
    weights : (N,), optional
        Positive; common poses get larger ones, so that they are covered more densely.
    mirrored : bool
        Whether each chosen pose stands for its mirror image too.

    Returns
    -------
    (count,) int64
        Rows, in the order of choice. The first is the pose nearest to the mean.
    """
    joints = joint_positions(poses.rotations)
    rows, mean, axes = _principal_rows(joints)
    images = None
    if mirrored:
        flat = mirror_joints(joints).reshape(len(joints), -1) / np.sqrt(joints.shape[1])
        images = np.ascontiguousarray((flat - mean) @ axes, dtype=np.float32)
    w = np.ones(len(poses)) if weights is None else weights
    start = int(np.argmin(np.sum(rows**2, axis=1)))
    return farthest_rows(rows, count, start, images, (w**2).astype(np.float32))
