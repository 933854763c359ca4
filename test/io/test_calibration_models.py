"""Calibrations as drivers send them: each gives the points of the scene, or one clear error."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from calibrations import AZURE, bad_cases, good_cases, make_info, plane_depth, undistort
from depth_pose.core.camera import Camera, Lens
from depth_pose.core.distortion import OPENCV, largest_radius
from depth_pose.core.errors import InputError
from depth_pose.io import schemas
from depth_pose.io.calibration import lens_of_image
from depth_pose.io.mcap_read import make_frame
from depth_pose.io.messages import read_message, write_image
from depth_pose.io.rectification import rectify_depth


def frame_of(case):
    image = read_message(write_image(1, "cam", case.depth), schemas.IMAGE)
    return make_frame(image, schemas.IMAGE, case.info)


def verdict(case) -> str:
    """``right`` where every point lies on the plane, and the frame holds the rays of all pixels."""
    frame = frame_of(case)
    camera = frame.camera
    v, u = np.nonzero(frame.depth > 0)
    a, b = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    expected, z = plane_depth(a, b), frame.depth[v, u]
    pixel = max(1.0 / camera.fx, 1.0 / camera.fy) * (1.0 + np.maximum(abs(a), abs(b)))
    is_right = np.abs(z - expected) < 1.0 * pixel * z * z / 2.0 + 1e-3
    is_near_edge = expected == 0
    seen = case.rays[case.depth > 0]
    seen = seen[(np.abs(seen) < 1.74).all(axis=1)]
    margin = 2.5 / min(camera.fx, camera.fy)
    low, high = np.array([a.min(), b.min()]), np.array([a.max(), b.max()])
    holds = (seen.min(axis=0) > low - margin).all() and (seen.max(axis=0) < high + margin).all()
    if not (is_right | is_near_edge).all():
        return f"wrong: off by {np.abs(z - expected)[~is_near_edge].max():.3f} m"
    return "right" if holds and len(z) > 0.8 * len(seen) else "wrong: a part of the view is missing"


def test_every_calibration_gives_the_scene() -> None:
    verdicts = {case.name: verdict(case) for case in good_cases()}
    counts = Counter(v.partition(":")[0] for v in verdicts.values())
    wrong = {name: v for name, v in verdicts.items() if v != "right"}
    assert not wrong, f"{counts}: {dict(list(wrong.items())[:20])}"
    assert counts["right"] > 800


def test_contradictions_are_refused_with_the_field() -> None:
    said = {}
    for case in bad_cases():
        with pytest.raises(InputError) as error:
            frame_of(case)
        said[case.name] = str(error.value)
    fields = ("distortion_model", "d has", "d has", "d has", "d has", "d is", "k[0]", "k is zero")
    sizes = ("says 200 x 144", "binning is 4000000000", "region of interest 50 x 40", "too large")
    for (name, line), part in zip(said.items(), fields + sizes, strict=True):
        assert part in line, (name, line)


def test_a_wide_lens_keeps_its_pixels() -> None:
    """Wide field of view of an Azure Kinect, binned: 120 degrees in a circle of 512 x 512 pixels."""
    lens = Lens(Camera(512, 512, 252.0, 252.0, 255.5, 255.5), OPENCV, AZURE)
    v, u = np.mgrid[:512, :512]
    a, b = undistort((u - 255.5) / 252.0, (v - 255.5) / 252.0, AZURE, OPENCV)
    in_view = np.hypot(a, b) < np.tan(np.radians(60.0))
    ideal = rectify_depth(np.where(in_view, np.float32(2.0), np.float32(0.0)), lens)
    camera = ideal.camera
    row = ideal.depth[round(camera.cy)]
    angles = np.degrees(np.arctan((np.flatnonzero(row) - camera.cx) / camera.fx))
    assert angles[-1] - angles[0] > 117.5
    assert camera.width * camera.height <= 1 << 20
    # and of the sensor's pixels in view nearly all are used
    numbers = rectify_depth(
        np.where(in_view, np.arange(1, 512 * 512 + 1).reshape(512, 512), 0).astype(np.float32), lens
    )
    assert len(np.unique(numbers.depth)) > 0.97 * in_view.sum()


def test_a_polynomial_that_turns_back_shows_nothing_twice() -> None:
    """Beyond the radius where the model turns, rays would fall into the image once more."""
    d = (-0.3, 0.0, 0.0, 0.0)
    radius = largest_radius(d, OPENCV, 3.0)
    assert abs(radius - (1 / 0.9) ** 0.5) < 0.01
    lens = Lens(Camera(160, 120, 120.0, 120.0, 79.5, 59.5), OPENCV, d)
    ideal = rectify_depth(np.ones((120, 160), np.float32), lens)
    v, u = np.nonzero(ideal.depth)
    camera = ideal.camera
    assert np.hypot((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy).max() < radius + 0.01


def test_a_slight_distortion_keeps_the_camera() -> None:
    camera = Camera(176, 144, 225.0, 225.0, 87.5, 71.5)
    ideal = rectify_depth(np.full((144, 176), 2.0, np.float32), Lens(camera, OPENCV, (1e-6, 0.0, 0.0, 0.0)))
    assert ideal.camera == camera and ideal.filled == 1.0 and (ideal.depth == 2.0).all()


def test_a_rectified_topic_has_the_camera_of_p_in_its_region() -> None:
    k, p = (200.0, 0, 80, 0, 200, 60, 0, 0, 1), (150.0, 0, 70, 0, 0, 150, 50, 0, 0, 0, 1, 0)
    info = make_info(
        width=160, height=120, distortion_model="plumb_bob", d=(-0.2, 0.0, 0.0, 0.0), k=k, p=p,
        binning_x=2, binning_y=2, roi=(20, 10, 100, 80),
    )  # fmt: skip
    lens = lens_of_image(info, 40, 50, rectified=True)
    assert lens == Lens(Camera(50, 40, 75.0, 75.0, 25.0, 20.0))
