"""A room of two cameras and two people who walk, as `depth-pose run --rig` writes their skeletons."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from depth_pose.core.camera import Camera
from depth_pose.core.skeleton import JOINT_NODES, rest_nodes
from depth_pose.io.mcap_write import DepthWriter, SkeletonWriter
from depth_pose.rooms.rig import ROOM_FRAME, T_WORLD_ROOM, RigCamera, look_at
from depth_pose.rooms.rigfile import save_rig
from skeletons import make_skeleton

SECONDS = 1.0
START_NS = 10**18
STEP_NS = 40_000_000
OFFSET_S = 0.5
"""Clock of the second camera minus that of the first, seconds."""

T_ROOM_WORLD = T_WORLD_ROOM.T
REST = rest_nodes()[JOINT_NODES] @ T_ROOM_WORLD[:3, :3].T * 1.75
"""A standing adult (19, 3) in the room's frame, metres, who looks along x."""

CAMERAS = (
    RigCamera("camera0", Camera(160, 120, 140.0, 140.0, 79.5, 59.5), look_at((0, 1.5, 0), (0, 1.0, 3.0))),
    RigCamera("camera1", Camera(128, 96, 110.0, 110.0, 63.5, 47.5), look_at((3.0, 2.0, 3.0), (0, 0.9, 3.0))),
)
"""The first at the room's origin, looking along x; the second to its left (y = 3), looking to the right."""


def people_at(seconds: float) -> np.ndarray:
    """Joints (2, 19, 3) in the room, metres: two people who walk to the left at 1.2 m/s."""
    return np.stack([REST + [x, 1.2 * seconds - 0.6, 0.0] for x in (2.6, 3.6)])


def write_room(path: Path) -> Path:
    """Write the skeletons of the room, 25 a second in the first camera's clock."""
    with SkeletonWriter(path) as writer:
        for stamp in range(START_NS, START_NS + round(SECONDS * 1e9) + 1, STEP_NS):
            joints = people_at((stamp - START_NS) * 1e-9)
            people = [
                make_skeleton(at, stamp_ns=stamp, frame_id=ROOM_FRAME, body_id=f"person_{i + 1}")
                for i, at in enumerate(joints)
            ]
            writer.write_people(people, stamp, ROOM_FRAME)
    return path


def write_rig(path: Path) -> Path:
    """Write the rig."""
    save_rig(path, CAMERAS, ["/camera/depth/image_raw"] * 2, clock_offsets=[0.0, OFFSET_S])
    return path


def write_depth(path: Path, camera: int, period_ns: int = 62_000_000) -> Path:
    """Write depth images of the bare floor; their stamps are not those of the skeletons."""
    pinhole, T = CAMERAS[camera].camera, CAMERAS[camera].T_room_camera
    v, u = np.indices((pinhole.height, pinhole.width))
    rays = np.stack([(u - pinhole.cx) / pinhole.fx, (v - pinhole.cy) / pinhole.fy, np.ones(u.shape)], axis=-1)
    down = -(rays @ T[2, :3])
    with np.errstate(divide="ignore"):
        depth = np.where(down > 0.2, T[2, 3] / down, 0.0).astype(np.float32)
    first = START_NS + camera * round(OFFSET_S * 1e9)
    with DepthWriter(path, pinhole, f"camera{camera}_optical") as writer:
        for stamp in range(first, first + round(SECONDS * 1e9), period_ns):
            writer.write(stamp, depth)
    return path
