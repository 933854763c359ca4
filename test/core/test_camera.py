"""Projection and back-projection are each other's inverse, in plain Python and in kernels."""

from types import SimpleNamespace

import numpy as np
import pytest
from numba import njit

from depth_pose.core._camera_kernels import project
from depth_pose.core.camera import Camera, Lens
from depth_pose.core.errors import InputError

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


def test_a_field_of_view_reaches_from_border_to_border():
    camera = Camera.from_fov(57.0, width=640, height=480, vertical=43.0)
    ray = [np.tan(np.radians(28.5)), np.tan(np.radians(21.5)), 1.0]
    np.testing.assert_allclose(camera.project(ray), [639.5, 479.5])
    square = Camera.from_fov(57.0, width=640, height=480)
    assert square.fx == square.fy
    for degrees in (0.0, 180.0, float("nan")):
        with pytest.raises(InputError, match="field of view is"):
            Camera.from_fov(degrees, width=640, height=480)


K = [[525.0, 0.0, 319.5], [0.0, 520.0, 239.5], [0.0, 0.0, 1.0]]
PLAIN = Camera(640, 480, 525.0, 520.0, 319.5, 239.5)


def test_calibrations_of_opencv_keep_their_distortion():
    assert (
        Camera.from_opencv(K, None, (640, 480))
        == Camera.from_opencv(K, np.zeros((1, 5)), (640, 480))
        == PLAIN
    )
    lens = Camera.from_opencv(K, np.array([[0.1, -0.2, 0.001, 0.002]]), (640, 480))
    x, y, r2 = 0.3, -0.2, 0.13
    growth = 1 + 0.1 * r2 - 0.2 * r2**2
    a = x * growth + 2 * 0.001 * x * y + 0.002 * (r2 + 2 * x * x)
    b = y * growth + 0.001 * (r2 + 2 * y * y) + 2 * 0.002 * x * y
    np.testing.assert_allclose(lens.project([2 * x, 2 * y, 2.0]), [525 * a + 319.5, 520 * b + 239.5])
    fisheye = Camera.from_opencv(K, [0.1, 0.0, 0.0, 0.0], (640, 480), fisheye=True)
    theta = np.arctan(0.5)
    np.testing.assert_allclose(
        fisheye.project([0.5, 0.0, 1.0])[0], 525 * theta * (1 + 0.1 * theta**2) + 319.5
    )
    for d, size, says in (
        ([0.1, 0.2], (640, 480), "2 numbers"),
        (None, (640,), "width, height"),
        (None, (6, 4), "focal"),
    ):
        with pytest.raises(InputError, match=says):
            Camera.from_opencv(K, d, size)


@pytest.mark.parametrize("style", ["ROS 2", "ROS 1", "mapping", "file"])
def test_camera_infos_are_read_in_any_form(style):
    k, d = np.ravel(K).tolist(), [0.1, -0.2, 0.0, 0.0, 0.05]
    fields = {"width": 640, "height": 480, "distortion_model": "plumb_bob"}
    if style == "ROS 1":
        info = SimpleNamespace(**fields, K=k, D=d, P=[0.0] * 12, binning_x=0, binning_y=0)
    elif style == "file":
        info = {
            "image_width": 640, "image_height": 480, "distortion_model": "plumb_bob",
            "camera_matrix": {"rows": 3, "cols": 3, "data": k},
            "distortion_coefficients": {"rows": 1, "cols": 5, "data": d},
        }  # fmt: skip
    else:
        info = {**fields, "k": k, "d": d}
        info = SimpleNamespace(**info) if style == "ROS 2" else info
    lens = Camera.from_camera_info(info)
    assert isinstance(lens, Lens) and lens.camera == PLAIN and lens.d == tuple(d)


def test_binned_parts_of_an_image_have_their_camera():
    info = {"width": 640, "height": 480, "k": np.ravel(K).tolist(), "binning_x": 2, "binning_y": 2}
    half = Camera.from_camera_info(info)
    assert half == Camera(320, 240, 262.5, 260.0, 159.75, 119.75)
    info |= {
        "binning_x": 0,
        "binning_y": 0,
        "roi": {"x_offset": 10, "y_offset": 20, "width": 300, "height": 200},
    }
    assert Camera.from_camera_info(info) == Camera(300, 200, 525.0, 520.0, 309.5, 219.5)
    assert Camera.from_camera_info(info, size=(640, 480)) == PLAIN
    for name in ("width", "k"):
        with pytest.raises(InputError, match=f"has no {name}"):
            Camera.from_camera_info({key: value for key, value in info.items() if key != name})
