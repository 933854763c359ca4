"""Data of one frame for the viewer, small enough to keep a whole recording in memory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.frame import DepthFrame
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import BONES, JOINTS

MOST_POINTS = 20_000
"""Maximum number of a frame's points kept and sent to the browser; 240 kB."""

_REACH_M = {"foot": 0.07, "ankle": 0.11, "knee": 0.15, "elbow": 0.11, "wrist": 0.12, "head": 0.2}
"""Reach by kind of joint, metres; `_TRUNK_REACH_M` for the others."""
_TRUNK_REACH_M = 0.22
"""Distance from the bone that ends at a joint within which points belong to the person, including clothes;
smaller at the feet, near the floor."""

_REACHES = np.array(
    [_REACH_M.get(JOINTS[b].rpartition("_")[2], _TRUNK_REACH_M) for _, b in BONES], np.float32
)
"""That distance for each of `BONES`, metres."""


@dataclass(frozen=True)
class ViewerFrame:
    """One frame.

    Attributes
    ----------
    stamp_ns : int
    depth_mm : (h, w) uint16
        Every few pixels of the image, millimetres; 0 where nothing returned.
    camera : Camera
        Of that grid.
    skeletons : tuple of Skeleton or None
        All people; None if the frame was not answered.
    """

    stamp_ns: int
    depth_mm: NDArray[np.uint16]
    camera: Camera
    skeletons: tuple[Skeleton, ...] | None

    def points(self) -> NDArray[np.float32]:
        """Points (N, 3) in the camera frame, metres."""
        rows, columns = np.nonzero(self.depth_mm)
        z = self.depth_mm[rows, columns].astype(np.float32) * np.float32(1e-3)
        x = (columns - self.camera.cx) / self.camera.fx * z
        y = (rows - self.camera.cy) / self.camera.fy * z
        return np.stack([x, y, z], axis=1).astype(np.float32)


def keep(frame: DepthFrame, skeletons: tuple[Skeleton, ...] | None, most: int = MOST_POINTS) -> ViewerFrame:
    """Reduce a frame to the data that the viewer shows."""
    height, width = frame.depth.shape
    step = max(1, int(np.ceil(np.sqrt(height * width / most))))
    depth = frame.depth[::step, ::step]
    mm = np.where(np.isfinite(depth) & (depth > 0) & (depth < 65), depth * 1e3, 0)
    return ViewerFrame(frame.stamp_ns, np.rint(mm).astype(np.uint16), frame.camera.strided(step), skeletons)


def owners(points: NDArray[np.float32], skeletons: tuple[Skeleton, ...]) -> NDArray[np.int64]:
    """Return for each point the index of the person with the nearest bone in reach, -1 for none, (N,)."""
    owner = np.full(len(points), -1)
    nearest = np.full(len(points), np.inf, np.float32)
    for number, skeleton in enumerate(skeletons):
        reaches = _REACHES * max(skeleton.scale, 0.3)
        most = reaches.max()
        joints = skeleton.positions.astype(np.float32)
        inside = ((points > joints.min(axis=0) - most) & (points < joints.max(axis=0) + most)).all(axis=1)
        index = np.flatnonzero(inside)
        share = _to_bones(points[index], joints, reaches)
        mine = (share < 1) & (share < nearest[index])
        owner[index[mine]], nearest[index[mine]] = number, share[mine]
    return owner


def _to_bones(
    points: NDArray[np.float32], joints: NDArray[np.float32], reaches: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Distance of points from a bone, as a share of that bone's reach."""
    start, end = np.array(BONES).T
    bones = joints[end] - joints[start]
    squares = np.maximum((bones**2).sum(axis=1), 1e-9)
    best = np.full(len(points), np.inf, np.float32)
    for a, bone, square, reach in zip(joints[start], bones, squares, reaches, strict=True):
        along = np.clip((points - a) @ bone / square, 0, 1)
        away = (points - a - along[:, None] * bone) / reach
        best = np.minimum(best, np.einsum("ij,ij->i", away, away))
    return np.sqrt(best)
