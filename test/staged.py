"""A body in known poses before a camera, and the person as the camera would see them."""

from __future__ import annotations

from functools import cache

import numpy as np

from depth_pose.body.body import Body
from depth_pose.body.pose import BodyPose
from depth_pose.body.procedural import make_body
from depth_pose.body.rendered_depth import render_depth
from depth_pose.core.camera import Camera
from depth_pose.core.labels import PERSON
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL as FACING
from depth_pose.core.rotations import rotvec_to_matrix
from depth_pose.core.skeleton import NODE_INDEX, NODE_PARENTS, NODES
from depth_pose.track.person_view import PersonView, see_people
from depth_pose.track.tracked_person import TrackedPerson

CAMERA = Camera(176, 144, 200.0, 200.0, 87.5, 71.5)


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
    depth = render_depth(vertices, (body or the_body()).faces, CAMERA)
    return np.where(np.isfinite(depth), depth, 0.0).astype(np.float32)


def person_of(vertices: np.ndarray) -> PersonView:
    depth = depth_of(vertices)
    found = TrackedPerson(PERSON, "body_1", 1.0)
    labels = (depth > 0).astype(np.uint8)
    return see_people(0, "camera", CAMERA, depth, labels, [found]).persons[0]
