"""A body in known poses before a camera, and the clouds that the camera would give."""

from __future__ import annotations

from functools import cache

import numpy as np

from depth_pose.body.body import Body
from depth_pose.body.procedural import make_body
from depth_pose.core._raster_kernels import rasterize
from depth_pose.core.camera import Camera
from depth_pose.core.rotations import rotvec_to_matrix
from depth_pose.core.skeleton import NODE_INDEX, NODE_PARENTS, NODES
from depth_pose.core.types import PersonCloud
from depth_pose.fit.articulated import BodyPose

CAMERA = Camera(176, 144, 200.0, 200.0, 87.5, 71.5)
FACING = np.diag([1.0, -1.0, -1.0])
"""Model frame to camera frame of a person who stands before the camera and looks at it."""


@cache
def the_body() -> Body:
    return make_body()


def pose_of(turns: dict[str, tuple[float, float, float]], root=(0.0, 0.0, 3.0), scale=1.0) -> BodyPose:
    """Turn named segments, with all below them, by rotation vectors (radians, camera axes)."""
    rotations = np.empty((21, 3, 3))
    for n in range(len(NODES)):
        turn = np.eye(3)
        up = n
        while up >= 0:
            if NODES[up] in turns:
                turn = rotvec_to_matrix(np.array(turns[NODES[up]])) @ turn
            up = NODE_PARENTS[up]
        rotations[n] = turn @ FACING
    assert NODE_INDEX["pelvis"] == 0
    return BodyPose(rotations, np.array(root, float), scale)


def depth_of(vertices: np.ndarray, body: Body | None = None) -> np.ndarray:
    """Depth image (H, W) float32, metres, 0 where nothing is."""
    zbuffer = np.empty((CAMERA.height, CAMERA.width))
    faces = (body or the_body()).faces
    rasterize(vertices, faces, CAMERA, zbuffer)
    return np.where(np.isfinite(zbuffer), zbuffer, 0.0).astype(np.float32)


def cloud_of(vertices: np.ndarray, stamp_ns: int = 0) -> PersonCloud:
    depth = depth_of(vertices)
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    z = np.where(depth > 0, depth, np.nan)
    points = np.stack([(u - CAMERA.cx) / CAMERA.fx * z, (v - CAMERA.cy) / CAMERA.fy * z, z], axis=-1)
    return PersonCloud(stamp_ns, "camera", points.astype(np.float32), (depth > 0).astype(np.uint8))
