"""People who walk in a box-shaped room, as ideal cameras with noisy joints see them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from depth_pose.core.camera import Camera
from depth_pose.core.skeleton import ADULT_STATURE_M, JOINT_NODES, JOINTS, MIRROR_JOINTS, rest_nodes
from depth_pose.rooms.background import EmptyRoom
from depth_pose.rooms.calibration_input import CameraRecord
from skeletons import make_skeleton

CAMERA = Camera(160, 120, 130.0, 130.0, 79.5, 59.5)
ROOM = np.array([[-1.0, -3.0, 0.0], [6.0, 2.6, 2.8]])
"""Low and high corner, room frame (z up), metres."""
NEAR_M = np.array(
    [
        {"wrist": 0.09, "elbow": 0.07, "knee": 0.01, "ankle": 0.01, "foot": 0.01}.get(
            name.rpartition("_")[2], 0.035
        )
        for name in JOINTS
    ]
)
"""How much too near the joints of a fitted body lie, metres: as measured, trunks more than legs."""
START_NS = 1_700_000_000_000_000_000


def place_camera(
    x: float, y: float, height: float, toward: Sequence[float], roll_deg: float = 0.0
) -> np.ndarray:
    """``T_room_camera`` of a camera that looks toward a point of the room."""
    forward = np.asarray(toward, float) - [x, y, height]
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    c, s = np.cos(np.radians(roll_deg)), np.sin(np.radians(roll_deg))
    T = np.eye(4)
    T[:3, :3] = np.stack([c * right + s * down, c * down - s * right, forward], axis=1)
    T[:3, 3] = x, y, height
    return T


@dataclass
class Stroller:
    """Somebody who walks smoothly past points of the floor, one every 1.5 s, arms swinging."""

    points: np.ndarray

    @classmethod
    def strolling(cls, seed: int, seconds: float, low=(1.0, -1.8), high=(4.5, 1.8)) -> Stroller:
        rng = np.random.default_rng(seed)
        return cls(rng.uniform(low, high, (int(seconds / 1.5) + 3, 2)))

    def joints(self, time: float) -> np.ndarray:
        """Joints (19, 3) in the room."""
        way = CubicSpline(1.5 * np.arange(len(self.points)), self.points)
        ahead = way(time, 1)
        ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-6)
        left = np.array([-ahead[1], ahead[0]])
        body = rest_nodes()[JOINT_NODES] * ADULT_STATURE_M
        body[[6, 7], 2] += 0.2 * np.sin(5 * time)  # the left arm
        body[[9, 10], 2] -= 0.2 * np.sin(5 * time)
        flat = way(time) + body[:, [0]] * left + body[:, [2]] * ahead
        return np.column_stack([flat, body[:, 1]])


def record_camera(
    name: str,
    T_room_camera: np.ndarray,
    walkers: Sequence[Stroller],
    seconds: float,
    *,
    fps: float = 10.0,
    offset: float = 0.0,
    near: float = 1.0,
    noise: float = 0.02,
    background: bool = True,
    mirrored: bool = False,
    seed: int = 0,
) -> CameraRecord:
    """Record a camera whose joints lie too near along their rays, by ``near`` times `NEAR_M`."""
    rng = np.random.default_rng(seed)
    record = CameraRecord(name, CAMERA, f"{name}_optical", f"/{name}/depth")
    T_camera_room = np.linalg.inv(T_room_camera)
    for time in np.arange(rng.uniform(0, 1 / fps), seconds, 1 / fps):
        stamp_ns = START_NS + round((time + offset) * 1e9)
        skeletons = []
        for i, walker in enumerate(walkers):
            joints = walker.joints(time) @ T_camera_room[:3, :3].T + T_camera_room[:3, 3]
            joints = joints * (1.0 - near * NEAR_M[:, None] / np.linalg.norm(joints, axis=1, keepdims=True))
            joints += rng.normal(0.0, noise, joints.shape)
            column, row = CAMERA.project(joints).mean(axis=0)
            if not (0 < column < CAMERA.width and 0 < row < CAMERA.height and joints[0, 2] > 0.5):
                continue
            if mirrored:
                joints = (joints * [-1.0, 1.0, 1.0])[MIRROR_JOINTS]
            skeletons.append(make_skeleton(joints, stamp_ns=stamp_ns, body_id=f"{name}_{i}"))
        record.add(stamp_ns, skeletons)
    if background:
        depth = empty_box(T_room_camera)
        record.background = still_room(depth[:, ::-1].copy() if mirrored else depth)
    return record


def still_room(depth: np.ndarray) -> EmptyRoom:
    """Make the empty room of a sensor without noise."""
    return EmptyRoom(depth, np.zeros_like(depth), CAMERA)


def empty_box(T_room_camera: np.ndarray, low=ROOM[0], high=ROOM[1]) -> np.ndarray:
    """Depth image (H, W) of an empty box, seen from inside."""
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], axis=-1)
    rays = rays @ T_room_camera[:3, :3].T
    start = T_room_camera[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.where(rays > 0, (high - start) / rays, (low - start) / rays).min(axis=-1)
    return far.astype(np.float32)
