"""Decoding of images, calibrations and clouds, on made-up fields with known answers."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.core.camera import Camera, Lens
from depth_pose.core.distortion import OPENCV, distort, distortion_of
from depth_pose.core.errors import InputError
from depth_pose.core.image_size import MAX_PIXELS
from depth_pose.io.calibration import camera_from_info
from depth_pose.io.clouds import R_BODY_OPTICAL, camera_from_points, decode_points, frame_from_cloud
from depth_pose.io.decode import decode_depth, is_order_wrong
from depth_pose.io.rectification import rectify_depth

K = (225.0, 0.0, 87.5, 0.0, 225.0, 71.5, 0.0, 0.0, 1.0)


def _wall(camera: Camera, z: float = 2.0) -> np.ndarray:
    """A tilted wall, (H, W, 3)."""
    v, u = np.mgrid[: camera.height, : camera.width].astype(float)
    a, b = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    depth = z / (1 - 0.3 * a)
    return np.stack([a * depth, b * depth, depth], axis=-1).astype(np.float32)


CAMERA = camera_from_info(K, [], 176, 144)


@pytest.mark.parametrize("encoding", ["16UC1", "mono16"])
@pytest.mark.parametrize("big", [False, True])
def test_millimetres_become_metres(encoding: str, big: bool) -> None:
    mm = np.array([[0, 1, 1234], [65535, 500, 4000]], ">u2" if big else "<u2")
    depth = decode_depth(mm.tobytes(), 2, 3, 6, encoding, big)
    assert depth.dtype == np.float32
    np.testing.assert_array_equal(depth, (mm.astype(np.float64) / 1000).astype(np.float32))


@pytest.mark.parametrize("big", [False, True])
def test_metres_with_padded_rows(big: bool) -> None:
    rows = np.zeros((2, 5), ">f4" if big else "<f4")
    rows[:, :3] = [[1.5, np.nan, np.inf], [-1.0, 2.25, 0.0]]
    rows[:, 3:] = 99.0
    depth = decode_depth(memoryview(rows.tobytes()), 2, 3, 20, "32FC1", int(big))
    np.testing.assert_array_equal(depth, np.array([[1.5, 0, 0], [0, 2.25, 0]], np.float32))


def _noisy_wall(millimetres: bool) -> np.ndarray:
    metres = _wall(CAMERA)[..., 2] + np.random.default_rng(0).normal(0, 0.004, (144, 176))
    metres[30:50, 60:100] = 0.0
    return np.round(1000 * metres).astype(np.uint16) if millimetres else metres.astype(np.float32)


@pytest.mark.parametrize("encoding", ["16UC1", "32FC1"])
@pytest.mark.parametrize("is_big", [False, True])
@pytest.mark.parametrize("says_big", [False, True])
def test_a_wrong_byte_order_is_seen(encoding: str, is_big: bool, says_big: bool) -> None:
    image = _noisy_wall(encoding == "16UC1")
    order = ">" if is_big else "<"
    data = image.astype(image.dtype.newbyteorder(order)).tobytes()
    size = (144, 176, 176 * image.itemsize, encoding)
    assert is_order_wrong(data, *size, says_big) is (is_big != says_big)


def test_images_without_depth_or_of_noise_say_nothing_about_the_order() -> None:
    noise = np.random.default_rng(1).integers(0, 65536, (144, 176)).astype(np.uint16)
    flat, empty = np.full((144, 176), 2000, np.uint16), np.zeros((144, 176), np.uint16)
    for image in (noise, flat, empty, noise.view("<u2") % 7):
        assert not is_order_wrong(image.tobytes(), 144, 176, 352, "16UC1", False)
        assert not is_order_wrong(image.tobytes(), 144, 176, 352, "16UC1", True) or image is not noise
    assert not is_order_wrong(bytes(10), 144, 176, 352, "16UC1")
    assert not is_order_wrong(np.full((4, 4), np.nan, "<f4").tobytes(), 4, 4, 16, "32FC1")


@pytest.mark.parametrize(
    ("height", "width", "step", "size", "encoding", "says"),
    [
        (2, 3, 6, 12, "rgb8", "encoding is 'rgb8'"),
        (0, 3, 6, 0, "16UC1", "height is 0"),
        (2, 0, 0, 0, "16UC1", "width is 0"),
        (2, 3, 5, 10, "16UC1", "step is 5"),
        (2, 3, 6, 11, "16UC1", "data has 11 bytes"),
        (2, 3, 6, 13, "16UC1", "data has 13 bytes"),
        (1, 100_000, 200_000, 0, "16UC1", "too large"),
        (8000, 8000, 16_000, 0, "16UC1", "too large"),
    ],
)
def test_bad_image_is_refused(
    height: int, width: int, step: int, size: int, encoding: str, says: str
) -> None:
    with pytest.raises(InputError, match=says):
        decode_depth(bytes(size), height, width, step, encoding)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"k": [0.0] * 9}, "not calibrated"),
        ({"k": K[:6]}, "k has 6"),
        ({"k": (np.nan, *K[1:])}, "finite"),
        ({"k": (225.0, 3.0, *K[2:])}, "skew"),
        ({"k": (225.0, 0.0, 9000.0, *K[3:])}, "principal point"),
        ({"width": 0}, "empty"),
        ({"d": [0.1, 0.0]}, "d has 2"),
        ({"d": [0.1, 0.0, np.inf, 0.0, 0.0]}, "d is"),
        ({"d": [0.1, 0.0, 0.0, 0.0], "distortion_model": "mystery"}, "mystery"),
    ],
)
def test_bad_calibration_is_refused(change: dict, says: str) -> None:
    fields = {"k": K, "d": [0.0] * 5, "width": 176, "height": 144} | change
    with pytest.raises(InputError, match=says):
        camera_from_info(**fields)


def test_calibration_gives_the_camera() -> None:
    assert camera_from_info(K, [0.0] * 5, 176, 144) == Camera(176, 144, 225.0, 225.0, 87.5, 71.5)


def test_no_distortion_changes_nothing() -> None:
    depth = np.ones((144, 176), np.float32)
    assert rectify_depth(depth, Lens(CAMERA)).depth is depth
    with pytest.raises(InputError, match="176 x 100"):
        rectify_depth(depth[:100], Lens(CAMERA))


@pytest.mark.parametrize(
    ("model", "d"),
    [
        ("plumb_bob", (-0.25, 0.08, 0.002, -0.001, -0.01)),
        ("rational_polynomial", (0.3, 0.05, 0.001, -0.001, 0.01, 0.5, 0.1, 0.02)),
        ("equidistant", (-0.02, 0.01, 0.0, 0.0)),
    ],
)
def test_rectified_wall_is_flat(model: str, d: tuple[float, ...]) -> None:
    """Each distorted pixel is given the wall's depth on its ideal ray, found by iteration."""
    lens = Lens(CAMERA, *distortion_of(d, model))
    v, u = np.mgrid[:144, :176].astype(float)
    a_seen, b_seen = (u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy
    a, b = a_seen.copy(), b_seen.copy()
    for _ in range(60):
        a_now, b_now = distort(a, b, lens.d, lens.model)
        a, b = a + a_seen - a_now, b + b_seen - b_now
    seen = (2.0 / (1 - 0.3 * a)).astype(np.float32)
    found = rectify_depth(seen, lens)
    inside = found.depth > 0
    assert found.filled == pytest.approx(inside.mean()) and inside.sum() > 0.9 * CAMERA.width * CAMERA.height
    assert (
        np.abs(found.depth - _wall(found.camera)[..., 2])[inside].max() < 0.004
    )  # half a pixel along the slope
    assert np.abs(seen - _wall(CAMERA)[..., 2]).max() > 0.012


def test_plumb_bob_formula() -> None:
    a, b = distort(np.array(0.3), np.array(-0.2), (0.1, 0.2, 0.01, 0.02, 0.3), OPENCV)
    r2 = 0.13
    radial = 1 + 0.1 * r2 + 0.2 * r2**2 + 0.3 * r2**3
    assert a == pytest.approx(0.3 * radial + 2 * 0.01 * 0.3 * -0.2 + 0.02 * (r2 + 2 * 0.09))
    assert b == pytest.approx(-0.2 * radial + 0.01 * (r2 + 2 * 0.04) + 2 * 0.02 * 0.3 * -0.2)


def test_points_with_other_fields_between() -> None:
    kind = np.dtype(
        {
            "names": ["x", "i", "y", "z"],
            "formats": [">f4", "u1", ">f4", ">f8"],
            "offsets": [0, 4, 8, 12],
            "itemsize": 24,
        }
    )
    cloud = np.zeros((2, 2), kind)
    cloud["x"], cloud["y"], cloud["z"] = [[1, 2], [3, 4]], [[5, 6], [7, 8]], [[9, 10], [11, np.nan]]
    fields = {"x": (0, 7), "y": (8, 7), "z": (12, 8), "i": (4, 2)}
    points = decode_points(cloud.tobytes(), 2, 2, 24, 48, fields, True)
    np.testing.assert_array_equal(points[..., 2], [[9, 10], [11, np.nan]])
    np.testing.assert_array_equal(points[1, 0], [3, 7, 11])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"fields": {"x": (0, 7), "y": (4, 7)}}, "no field 'z'"),
        ({"fields": {"x": (0, 7), "y": (4, 7), "z": (8, 2)}}, "datatype 2"),
        ({"fields": {"x": (0, 7), "y": (4, 7), "z": (10, 7)}}, "does not fit"),
        ({"row_step": 20}, "row_step is 20"),
        ({"height": 3}, "data has 48"),
        ({"width": 0}, "empty"),
    ],
)
def test_bad_cloud_is_refused(change: dict, says: str) -> None:
    fields = {"x": (0, 7), "y": (4, 7), "z": (8, 7)}
    layout = {"height": 2, "width": 2, "point_step": 12, "row_step": 24, "fields": fields} | change
    with pytest.raises(InputError, match=says):
        decode_points(bytes(48), **layout)


@pytest.mark.parametrize("camera", [CAMERA, Camera(64, 48, 60.0, 75.0, 10.25, 40.5)])
def test_camera_is_found_again(camera: Camera) -> None:
    points = _wall(camera)
    points[np.random.default_rng(0).random(points.shape[:2]) < 0.7] = np.nan
    found = camera_from_points(points)
    assert (found.width, found.height) == (camera.width, camera.height)
    for name in ("fx", "fy", "cx", "cy"):
        assert getattr(found, name) == pytest.approx(getattr(camera, name), abs=1e-4)


def test_no_camera_where_there_is_none() -> None:
    points = _wall(CAMERA)
    with pytest.raises(InputError, match="not those of a pinhole"):
        camera_from_points(points[:, ::-1])
    with pytest.raises(InputError, match="not those of a pinhole"):
        camera_from_points(np.random.default_rng(0).normal(3, 0.3, (40, 40, 3)))
    with pytest.raises(InputError, match="too few"):
        camera_from_points(np.full((40, 40, 3), np.nan))
    with pytest.raises(InputError, match="shape"):
        camera_from_points(np.zeros((40, 3)))


def test_organised_cloud_keeps_its_pixels() -> None:
    points = _wall(CAMERA)
    points[10:20, 10:20] = np.nan
    frame = frame_from_cloud(points, 5, "optical")
    assert (frame.stamp_ns, frame.frame_id) == (5, "optical")
    np.testing.assert_array_equal(frame.depth, np.nan_to_num(points[..., 2]))
    assert frame.camera.fx == pytest.approx(225, abs=1e-3)


def test_unorganised_cloud_gets_a_camera_of_its_density() -> None:
    rng = np.random.default_rng(1)
    points = _wall(CAMERA).reshape(-1, 3)
    hidden = (
        points[rng.random(len(points)) < 0.2] * 1.5
    )  # a second surface behind the first must not show through
    frame = frame_from_cloud(rng.permutation(np.concatenate([points, hidden])), 0, "optical")
    camera = frame.camera
    assert 100 < camera.width < 260
    inside = np.zeros(frame.depth.shape, bool)
    inside[4:-4, 4:-4] = True
    assert (frame.depth[inside] > 0).mean() > 0.98
    u = (np.arange(camera.width) - camera.cx) / camera.fx
    expected = np.broadcast_to(2.0 / (1 - 0.3 * u), frame.depth.shape)
    seen = inside & (frame.depth > 0)
    assert np.percentile(np.abs(frame.depth - expected)[seen], 98) < 0.01


def test_cloud_from_spinning_sensor_is_projected() -> None:
    """Organised, but by angles: rows and columns are no pinhole's."""
    azimuth, elevation = np.meshgrid(
        np.linspace(-np.pi, np.pi, 360, endpoint=False), np.linspace(-0.3, 0.3, 32)
    )
    points = 4 * np.stack(
        [np.cos(elevation) * np.sin(azimuth), np.sin(elevation), np.cos(elevation) * np.cos(azimuth)], axis=-1
    )
    frame = frame_from_cloud(points.astype(np.float32), 0, "lidar")
    assert (frame.depth > 0).sum() > 1000
    assert np.median(frame.depth[frame.depth > 0]) < 4


@pytest.mark.parametrize("organised", [True, False])
@pytest.mark.parametrize("pitch_deg", [-35.0, 0.0, 35.0])
def test_a_cloud_in_a_body_frame_is_turned(organised: bool, pitch_deg: float) -> None:
    """Turned back it is the cloud of the optical frame, whichever way the sensor looks."""
    pitch = np.radians(pitch_deg)
    looks = np.array([0.0, np.sin(pitch), np.cos(pitch)])
    v, u = np.mgrid[:144, :176].astype(float)
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones_like(u)], axis=-1)
    points = (rays * (3.0 / (rays @ looks))[..., None]).astype(np.float32)
    optical = points if organised else points.reshape(-1, 3)
    body = optical @ R_BODY_OPTICAL.T.astype(np.float32)
    frame, expected = frame_from_cloud(body, 0, "camera_link"), frame_from_cloud(optical, 0, "optical")
    assert (frame.frame_id, expected.frame_id) == ("camera_link_optical", "optical")
    np.testing.assert_allclose(frame.camera, expected.camera, atol=1e-3)
    np.testing.assert_allclose(frame.depth, expected.depth, atol=1e-5)


def test_nothing_in_front_is_refused() -> None:
    with pytest.raises(InputError, match="optical"):
        frame_from_cloud(np.array([[0.0, 0, -1], [1, 1, np.nan]]), 0, "x")
    one = frame_from_cloud(np.array([[0.1, 0.1, 2.0]]), 0, "x")
    assert (one.depth > 0).sum() == 1


@pytest.mark.parametrize(
    ("k", "size", "says"),
    [
        ((5e-324, 0, 320, 0, 500, 240, 0, 0, 1), (640, 480), "focal lengths"),
        ((500, 0, 320, 0, 1e300, 240, 0, 0, 1), (640, 480), "focal lengths"),
        ((20, 0, 320, 0, 20, 240, 0, 0, 1), (640, 480), "between 32 and 32000"),
        ((33000, 0, 320, 0, 33000, 240, 0, 0, 1), (640, 480), "between 32 and 32000"),
        ((50, 0, 320, 0, 500, 240, 0, 0, 1), (640, 480), "focal lengths"),
        ((8192, 0, 4096, 0, 8192, 1, 0, 0, 1), (8192, 2), "factor of 16"),
        ((8192, 0, 4096, 0, 8192, 1, 0, 0, 1), (100_000, 2), "too large"),
    ],
)
def test_extreme_cameras_are_refused(k: tuple[float, ...], size: tuple[int, int], says: str) -> None:
    with pytest.raises(InputError, match=says):
        camera_from_info(k, (), *size)


def test_cameras_at_the_bounds_are_taken() -> None:
    for focal in (32.0, 32000.0):
        assert camera_from_info((focal, 0, 320, 0, focal, 240, 0, 0, 1), (), 640, 480).fx == focal


def test_rectifying_the_largest_image_takes_little_memory() -> None:
    import tracemalloc

    camera = Camera(4096, 4096, 3000.0, 3000.0, 2048.0, 2048.0)
    depth = np.ones((4096, 4096), np.float32)
    tracemalloc.start()
    found = rectify_depth(depth, Lens(camera, OPENCV, (0.1, 0.01, 0.0, 0.0, 0.0)))
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    camera = found.camera
    assert found.depth[round(camera.cy), round(camera.cx)] == 1.0
    assert most < 15 * depth.size  # bytes; the image and what is kept are 14 a pixel


def test_rectifications_that_are_kept_are_bounded() -> None:
    import tracemalloc

    depth = np.ones((512, 1024), np.float32)
    cameras = [Camera(1024, 512, 900.0 + i, 900.0, 512.0, 256.0) for i in range(48)]
    tracemalloc.start()
    for camera in cameras:
        rectify_depth(depth, Lens(camera, OPENCV, (0.1, 0.0, 0.0, 0.0)))
    kept = tracemalloc.get_traced_memory()[0]
    tracemalloc.reset_peak()
    for camera in cameras[-9:]:
        rectify_depth(depth, Lens(camera, OPENCV, (0.1, 0.0, 0.0, 0.0)))
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert kept < 10 * MAX_PIXELS  # bytes; 9 a pixel
    assert most - kept < 9 * depth.size  # none of the last was made again
