"""A person in a room as a sensor with a distorting lens sees them, at any angle from its axis."""

from __future__ import annotations

import numpy as np

import synthetic as syn
from calibrations import undistort
from depth_pose.core.camera import Camera, Lens
from depth_pose.core.frame import DepthFrame
from depth_pose.core.skeleton import JOINT_NODES
from depth_pose.io.rectification import rectify_depth

FINE = 2
"""Pixels of the drawing for one of the sensor's, each way, so that the nearest is close."""


def scene(degrees: float, distance: float, turn: float, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Depth (h, w) of a person ``degrees`` to the right of the axis, and the true joints (19, 3)."""
    angle = np.radians(degrees)
    aside, ahead = distance * np.sin(angle), distance * np.cos(angle)
    posed = syn.posed(syn.arms_down(), distance=ahead, aside=aside, turn=turn - degrees)
    walls = np.minimum(syn.room(wall=5.5, camera=camera), syn.draw_plane([1, 0, 0], 4.5, camera))
    walls = np.minimum(walls, syn.draw_plane([-1, 0, 0], 4.5, camera))
    return np.minimum(syn.draw(syn.mesh(posed), camera=camera), walls), posed.nodes[JOINT_NODES]


def lens_frame(
    degrees: float, distance: float, turn: float, lens: Lens, view_deg: float, stamp_ns: int
) -> tuple[DepthFrame, np.ndarray]:
    """The rectified frame of a sensor whose view is a cone of ``view_deg``."""
    camera = lens.camera
    v, u = np.mgrid[: camera.height, : camera.width]
    a, b = undistort((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, lens.d, lens.model)
    tangent = np.tan(np.radians(view_deg / 2))
    in_view = np.hypot(a, b) < tangent
    reach = float(np.nanmax(np.where(in_view, np.maximum(abs(a), abs(b)), 0)))
    side, focal = int(2 * reach * camera.fx * FINE) + 3, camera.fx * FINE
    fine = Camera(side, side, focal, focal, side / 2, side / 2)
    drawn, joints = scene(degrees, distance, turn, fine)
    rows, columns = (np.rint(focal * np.where(in_view, x, 0) + side / 2).astype(int) for x in (b, a))
    seen = np.where(in_view, drawn[rows, columns], 0.0).astype(np.float32)
    ideal = rectify_depth(np.where(np.isfinite(seen), seen, np.float32(0)), lens)
    return DepthFrame(stamp_ns, "optical", ideal.depth, ideal.camera, ideal.filled), joints
