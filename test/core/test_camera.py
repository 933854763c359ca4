"""Projection and back-projection are each other's inverse, in plain Python and in kernels."""

import numpy as np
from numba import njit

from depth_pose.core._camera_kernels import project
from depth_pose.core.camera import Camera

CAMERA = Camera(64, 48, 60.0, 61.0, 31.5, 23.5)


def test_pixels_come_back():
    depth = np.random.default_rng(0).uniform(0.5, 5.0, (48, 64)).astype(np.float32)
    v, u = np.mgrid[:48, :64]
    np.testing.assert_allclose(CAMERA.project(CAMERA.back_project(depth)), np.stack([u, v], -1), atol=1e-4)


def test_no_return_is_no_point():
    assert np.isnan(CAMERA.back_project(np.zeros((48, 64), np.float32))).all()


def test_parts_of_an_image_see_the_same_points():
    point = np.array([0.3, -0.2, 2.5])
    u, v = CAMERA.project(point)
    np.testing.assert_allclose(CAMERA.cropped(5, 7, 20, 20).project(point), [u - 5, v - 7])
    small = CAMERA.strided(3)
    np.testing.assert_allclose(small.project(point), [u / 3, v / 3])
    assert (small.width, small.height) == (22, 16)


def test_kernels_read_it_as_one_argument():
    @njit
    def column(camera, x, y, z):
        return project(camera, x, y, z)[0]

    assert column(CAMERA, 0.3, -0.2, 2.5) == CAMERA.project(np.array([0.3, -0.2, 2.5]))[0]
