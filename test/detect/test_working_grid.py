"""The grid that all later steps work on, against plain loops."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.core.camera import Camera
from depth_pose.core.config import SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.detect import _reduce_kernels as kernels
from depth_pose.detect.working_grid import reduce_frame


@pytest.mark.parametrize(("stride", "dtype"), [(2, np.float32), (3, np.float32), (5, np.float64)])
def test_reduce_depth_twin(stride, dtype):
    rng = np.random.default_rng(1)
    depth = rng.choice(
        np.array([0.0, 1.0, 1.02, 1.05, 3.0, 3.04, np.nan], dtype), (12 * stride, 15 * stride + 1)
    )
    reduced = kernels.reduce_depth(depth, stride, 0.08, 0.4, 8.0)
    assert reduced.shape == (12, 15) and reduced.dtype == np.float32
    for i in range(12):
        for j in range(15):
            block = depth[stride * i : stride * (i + 1), stride * j : stride * (j + 1)].ravel()
            block = np.sort(block[(block >= 0.4) & (block <= 8.0)])
            expected = 0.0
            if 2 * len(block) >= stride**2:
                surface = block[np.abs(block - block[len(block) // 2]) <= 0.08]
                expected = surface.mean()
            assert reduced[i, j] == pytest.approx(expected, rel=2e-6)


def test_clip_depth_twin():
    depth = np.array([[0.0, 0.4, 0.39], [8.0, 8.01, np.nan], [np.inf, -1.0, 2.5]], np.float32)
    expected = np.array([[0.0, 0.4, 0.0], [8.0, 0.0, 0.0], [0.0, 0.0, 2.5]], np.float32)
    np.testing.assert_array_equal(kernels.clip_depth(depth, np.float32(0.4), 8.0), expected)


@pytest.mark.parametrize(
    ("camera", "rows"),
    [
        (Camera(640, 480, 570.0, 570.0, 319.5, 239.5), 160),
        (Camera(884, 884, 250.0, 250.0, 441.5, 441.5), 294),  # 121 degrees
        (Camera(386, 386, 110.0, 110.0, 192.5, 192.5), 386),
    ],
)
def test_wide_views_are_reduced_less(camera: Camera, rows: int) -> None:
    depth, reduced = reduce_frame(
        DepthFrame(0, "", np.full((camera.height, camera.width), 2.0, np.float32), camera), SegmentConfig()
    )
    assert depth.shape == (reduced.height, reduced.width) and reduced.height == rows
    assert reduced.fx >= 79.0
