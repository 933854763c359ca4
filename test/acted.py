"""A person who lifts an arm, seen by a depth camera, and a small bank that knows such poses."""

from __future__ import annotations

from functools import cache

import numpy as np

from depth_pose.bank import Bank, build_bank
from depth_pose.bank.build import BuildConfig
from depth_pose.body.body import Body, PosedBody
from depth_pose.body.procedural import make_body
from depth_pose.body.rendered_depth import render_depth
from depth_pose.core.camera import Camera
from depth_pose.core.frame import DepthFrame
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL as _FACING
from depth_pose.core.rotations import rotvec_to_matrix
from depth_pose.core.skeleton import NODE_INDEX

CAMERA = Camera(176, 144, 200.0, 200.0, 87.5, 71.5)
STEP_NS = 40_000_000
_LEFT_ARM = ("left_shoulder", "left_elbow", "left_wrist")
_RIGHT_ARM = ("right_shoulder", "right_elbow", "right_wrist")


@cache
def the_body() -> Body:
    return make_body()


def rotations(left: float, right: float) -> np.ndarray:
    """Segment rotations, model frame, of a standing person with arms lifted aside by radians."""
    out = np.tile(np.eye(3), (21, 1, 1))
    out[[NODE_INDEX[n] for n in _LEFT_ARM]] = rotvec_to_matrix(np.array([0, 0, left]))
    out[[NODE_INDEX[n] for n in _RIGHT_ARM]] = rotvec_to_matrix(np.array([0, 0, -right]))
    return out


def posed(frame: int) -> PosedBody:
    """The person at a frame: the left arm goes up, the body sways."""
    sway = np.array([0.05 * np.sin(0.2 * frame), 0.0, 3.0 + 0.005 * frame])
    return the_body().pose(_FACING @ rotations(-0.5 + 0.04 * frame, 0.1), sway)


def frame_of(frame: int, start_ns: int = 0) -> DepthFrame:
    """What the camera gives then: the person before a wall."""
    depth = render_depth(posed(frame).vertices, the_body().faces, CAMERA)
    depth = np.where(np.isfinite(depth), depth, 4.6).astype(np.float32)
    return DepthFrame(start_ns + frame * STEP_NS, "camera", depth, CAMERA)


def empty_frame(frame: int) -> DepthFrame:
    """The wall alone."""
    return DepthFrame(
        frame * STEP_NS, "camera", np.full((CAMERA.height, CAMERA.width), 4.6, np.float32), CAMERA
    )


@cache
def the_bank() -> Bank:
    poses = [rotations(left, right) for left in np.arange(-0.6, 0.9, 0.2) for right in (-0.2, 0.2, 0.6)]
    return build_bank(the_body(), np.array(poses), BuildConfig(dimensions=16), {}, workers=0)
