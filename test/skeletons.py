"""Skeletons of the tests' own: as told, or of random numbers that messages keep as they are."""

from __future__ import annotations

from typing import Any

import numpy as np

from depth_pose.core.result import BUILD_SIZE, Skeleton
from depth_pose.core.skeleton import Source, Tracking


def make_skeleton(positions: np.ndarray, **values: Any) -> Skeleton:
    """Joints (19, 3) that are all seen and sure, of unturned segments, unless told otherwise."""
    usual = {
        "stamp_ns": 1,
        "frame_id": "optical",
        "body_id": "b",
        "source": Source.REFINED,
        "confidence": 0.9,
        "residual": 0.01,
        "scale": 1.0,
        "quats_xyzw": np.tile([0.0, 0, 0, 1], (19, 1)),
        "joint_confidence": np.ones(19, np.float32),
        "joint_states": np.zeros(19, np.uint8),
    }
    return Skeleton(positions=positions, **usual | values)


def random_skeleton(rng: np.random.Generator, **values: Any) -> Skeleton:
    """Make one of random numbers; the other values are such as float32 has."""
    spread = rng.normal(0.0, 0.02, (19, 3, 3))
    usual = {
        "source": Source.RECOVERED,
        "confidence": float(np.float32(0.7)),
        "residual": float(np.float32(0.012)),
        "scale": float(np.float32(1.05)),
        "positions": rng.normal(size=(19, 3)),
        "quats_xyzw": rng.normal(size=(19, 4)),
        "joint_confidence": rng.random(19).astype(np.float32),
        "joint_states": rng.integers(0, 4, 19).astype(np.uint8),
        "build": rng.normal(0.0, 0.05, BUILD_SIZE).astype(np.float32),
        "velocities": rng.normal(size=(19, 3)).astype(np.float32).astype(np.float64),
        "covariances": (spread @ spread.transpose(0, 2, 1)).astype(np.float32).astype(np.float64),
        "tracking": Tracking.TRACKED,
    }
    return make_skeleton(**usual | values)
