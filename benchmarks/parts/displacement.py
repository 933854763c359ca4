"""How far a calibrated camera is off against the true one: `benchmarks/rooms.py`."""

from __future__ import annotations

import numpy as np

from depth_pose.rooms.calibration_result import Calibration

HEIGHTS_M = (0.0, 0.9, 1.8)
"""Heights of the points whose displacement is measured, metres."""


def displacement(found: Calibration, truth: dict[str, np.ndarray], camera: int) -> tuple[float, float, float]:
    """Return how far a camera is off against the first: points (mm), its place (mm), its turn (degrees)."""
    T_camera_world = truth["T_camera_world"].astype(np.float64)
    true = T_camera_world[0] @ np.linalg.inv(T_camera_world[camera])
    T = np.linalg.inv(found.T_room_camera[0]) @ found.T_room_camera[camera]
    off = T @ np.linalg.inv(true)
    spots = truth["joints"][::15, :, 0].reshape(-1, 3)
    spots = spots[np.isfinite(spots).all(axis=1)]
    points = np.concatenate([np.column_stack([spots[:, :2], np.full((len(spots), 1), h)]) for h in HEIGHTS_M])
    points = points @ T_camera_world[0, :3, :3].T + T_camera_world[0, :3, 3]
    moved = np.linalg.norm(points @ off[:3, :3].T + off[:3, 3] - points, axis=1).mean()
    turned = np.degrees(np.arccos(np.clip((np.trace(off[:3, :3]) - 1.0) / 2.0, -1.0, 1.0)))
    return 1e3 * moved, 1e3 * float(np.linalg.norm((T - true)[:3, 3])), float(turned)
