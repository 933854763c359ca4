"""From depth frames to the person's clean, organised points."""

from __future__ import annotations

import numpy as np
import pytest

import synthetic as syn
from depth_pose.core.config import DenoiseConfig, SegmentConfig
from depth_pose.core.types import PERSON, UNKNOWN, PersonCloud
from depth_pose.io.decode import camera_from_points
from depth_pose.people.person import MIN_POINTS, thin, view_person
from depth_pose.steps.extract import PersonExtractor


@pytest.fixture
def extractor():
    return PersonExtractor(SegmentConfig(), DenoiseConfig())


@pytest.fixture(scope="module")
def person():
    return syn.draw(syn.mesh(syn.posed(syn.arms_down())))


def test_points_lie_on_their_pixels_rays_and_near_the_surface(extractor, person):
    frame = syn.to_frame(np.minimum(person, syn.room()), noise=0.005)
    cloud = extractor.extract(frame)
    assert (cloud.stamp_ns, cloud.frame_id) == (frame.stamp_ns, frame.frame_id)
    assert cloud.points.shape == (144, 176, 3)
    assert cloud.points.dtype == np.float32
    mine = cloud.labels == PERSON
    np.testing.assert_array_equal(np.isfinite(cloud.points).all(axis=-1), mine)
    rows, cols = np.nonzero(mine)
    x, y, z = cloud.points[mine].T
    np.testing.assert_allclose(syn.CAMERA.fx * x / z + syn.CAMERA.cx, cols, atol=1e-3)
    np.testing.assert_allclose(syn.CAMERA.fy * y / z + syn.CAMERA.cy, rows, atol=1e-3)
    off = np.abs(z - person[mine])
    assert np.median(off[np.isfinite(off)]) < 0.005
    assert mine.sum() > 0.93 * np.isfinite(person).sum()


def test_the_camera_is_found_from_the_points(extractor, person):
    cloud = extractor.extract(syn.to_frame(np.minimum(person, syn.room())))
    found = camera_from_points(cloud.points)
    assert (found.width, found.height) == (176, 144)
    for name in ("fx", "fy", "cx", "cy"):
        assert getattr(found, name) == pytest.approx(getattr(syn.CAMERA, name), abs=0.01)


def test_dropped_points_are_unknown_not_free(extractor, person):
    """An outlier that denoising drops is neither the person nor known to be empty."""
    config = DenoiseConfig(outlier_distance=0.01)  # farther apart than neighbours can be
    cloud = PersonExtractor(SegmentConfig(), config).extract(syn.to_frame(np.minimum(person, syn.room())))
    inner = np.isfinite(person)
    inner[110:] = False
    assert not (cloud.labels == PERSON).any()
    assert (cloud.labels[inner] == UNKNOWN).mean() > 0.9


def test_nobody(extractor):
    cloud = extractor.extract(syn.to_frame(syn.room()))
    assert not (cloud.labels == PERSON).any()
    assert np.isnan(cloud.points).all()


def test_the_person_is_forgotten_where_stamps_jump(person):
    """A child is followed while an adult comes in; not after a jump of the stamps."""
    child = syn.draw(syn.mesh(syn.posed(syn.arms_down(), distance=2.8, aside=-0.95, scale=0.75)))
    alone = np.minimum(child, syn.room())
    both = np.minimum(np.minimum(person, child), syn.room())
    for step_ns, same in ((syn.STEP_NS, True), (-syn.STEP_NS, False), (10**9, False)):
        extractor = PersonExtractor(SegmentConfig(), DenoiseConfig())
        extractor.extract(syn.to_frame(alone))
        cloud = extractor.extract(syn.to_frame(both, syn.START_NS + step_ns))
        x = np.nanmedian(cloud.points[..., 0])
        assert bool(x < -0.5) == same


def test_warm_up_and_reset_change_nothing(person):
    frame = syn.to_frame(np.minimum(person, syn.room()))
    plain = PersonExtractor(SegmentConfig(), DenoiseConfig())
    warmed = PersonExtractor(SegmentConfig(), DenoiseConfig())
    warmed.warm_up()
    a, b = plain.extract(frame), warmed.extract(frame)
    np.testing.assert_array_equal(a.points, b.points)
    warmed.reset()
    np.testing.assert_array_equal(warmed.extract(frame).labels, a.labels)


# --- the view of a cloud that the later stages work on


def test_view_of_a_person(person):
    cloud = syn.to_cloud(person)
    view = view_person(cloud)
    mine = cloud.labels == PERSON
    np.testing.assert_array_equal(view.points, cloud.points[mine].astype(np.float64))
    assert view.camera.fx == pytest.approx(syn.CAMERA.fx, abs=0.01)
    for window in (view.full, view.coarse):
        rows, cols = np.nonzero(window.labels == PERSON)
        z = window.depth[rows, cols]
        c = window.camera
        x, y = (cols - c.cx) / c.fx * z, (rows - c.cy) / c.fy * z
        at = np.rint([syn.CAMERA.fy * y / z + syn.CAMERA.cy, syn.CAMERA.fx * x / z + syn.CAMERA.cx]).astype(
            int
        )
        np.testing.assert_array_equal(person[at[0], at[1]].astype(np.float32), z)
    assert (view.full.labels == PERSON).sum() == mine.sum()
    assert (view.coarse.labels == PERSON).sum() == pytest.approx(mine.sum() / 4, rel=0.1)


def test_view_of_nobody():
    nan = np.full((40, 50, 3), np.nan, np.float32)
    assert view_person(PersonCloud(0, "", nan, np.zeros((40, 50), np.uint8))) is None


def test_view_of_too_few_points_or_of_one_row(person):
    cloud = syn.to_cloud(person)
    rows, cols = np.nonzero(cloud.labels == PERSON)
    few = np.zeros_like(cloud.labels)
    few[rows[: MIN_POINTS - 1], cols[: MIN_POINTS - 1]] = PERSON
    points = np.where((few == PERSON)[..., None], cloud.points, np.nan)
    assert view_person(PersonCloud(0, "", points, few)) is None
    depth = np.full(person.shape, np.inf)
    depth[70, 10:150] = 2.0
    assert view_person(syn.to_cloud(depth)) is None


def test_thin():
    points = np.arange(30.0).reshape(10, 3)
    np.testing.assert_array_equal(thin(points, 10), points)
    np.testing.assert_array_equal(thin(points, 5), points[::2])
    assert len(thin(points, 3)) == 3
