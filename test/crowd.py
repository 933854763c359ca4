"""People who come, go, stand beside each other and behind things, seen by a small depth camera."""

from __future__ import annotations

from functools import cache

import numpy as np

from depth_pose.body.body import Body, PosedBody
from depth_pose.body.procedural import make_body
from depth_pose.body.rendered_depth import render_depth
from depth_pose.core.camera import Camera
from depth_pose.core.frame import DepthFrame
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL as _FACING
from depth_pose.core.rotations import rotvec_to_matrix
from depth_pose.core.skeleton import NODE_INDEX

CAMERA = Camera(176, 144, 170.0, 170.0, 87.5, 71.5)
STEP_NS = 40_000_000
WALL_M = 4.8
_ARM = ("shoulder", "elbow", "wrist")


@cache
def the_body() -> Body:
    return make_body()


def person(frame: int, x: float, z: float, phase: float = 0.0) -> PosedBody:
    """Somebody at a place who waves both arms, facing the camera."""
    rotations = np.tile(_FACING, (21, 1, 1))
    lift = 0.4 + 0.4 * np.sin(0.25 * frame + phase)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        nodes = [NODE_INDEX[f"{side}_{n}"] for n in _ARM]
        rotations[nodes] = _FACING @ rotvec_to_matrix(np.array([0.0, 0.0, sign * lift]))
    return the_body().pose(rotations, np.array([x, 0.0, z]))


def seen(frame: int, people: list[PosedBody], board: tuple[int, int, int, int, float] | None = None):
    """What the camera sees: people before a wall, and a board (left, right, top, bottom, metres)."""
    depth = np.full((CAMERA.height, CAMERA.width), WALL_M)
    for p in people:
        depth = np.minimum(depth, render_depth(p.vertices, the_body().faces, CAMERA))
    if board is not None:
        left, right, top, bottom, z = board
        depth[top:bottom, left:right] = np.minimum(depth[top:bottom, left:right], z)
    return DepthFrame(frame * STEP_NS, "camera", depth.round(3).astype(np.float32), CAMERA)
