"""A sample frame for warm-up: a person on a floor in front of a wall."""

from __future__ import annotations

import numpy as np

from depth_pose.body.procedural import make_body
from depth_pose.body.rendered_depth import render_depth
from depth_pose.core.camera import Camera
from depth_pose.core.frame import DepthFrame
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL, rotation_z
from depth_pose.core.skeleton import NODE_INDEX

_CAMERA = Camera(width=176, height=144, fx=170.0, fy=170.0, cx=87.5, cy=71.5)
"""Camera of the sample frame, pixels; set by hand."""
_PERSON_M, _WALL_M, _FLOOR_M = 3.2, 4.8, 1.15
"""Depths of the person's pelvis and the wall, and height of the camera above the floor (m); set by hand."""


def sample_frame() -> DepthFrame:
    """Render the template body with arms half raised; the people finder detects it."""
    body = make_body()
    rotations = np.tile(R_CAMERA_FACING_MODEL, (len(NODE_INDEX), 1, 1))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for node in ("shoulder", "elbow", "wrist"):
            rotations[NODE_INDEX[f"{side}_{node}"]] = R_CAMERA_FACING_MODEL @ rotation_z(np.array(0.6 * sign))
    posed = body.pose(rotations, np.array([0.0, 0.0, _PERSON_M]))
    depth = render_depth(posed.vertices, body.faces, _CAMERA)
    below = np.maximum(np.arange(_CAMERA.height) - _CAMERA.cy, 1e-3) / _CAMERA.fy
    room = np.minimum(_WALL_M, _FLOOR_M / below).astype(np.float32)
    return DepthFrame(0, "", np.minimum(depth, room[:, None]), _CAMERA)
