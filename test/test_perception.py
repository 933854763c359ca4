"""From depth frames to the person's clean, organised points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import synthetic as syn
from depth_pose.core.config import DenoiseConfig, SegmentConfig
from depth_pose.core.labels import HIDDEN, PERSON
from depth_pose.denoise.tuning import DenoiseTuning
from depth_pose.perception import Perception
from depth_pose.track.person_view import MIN_POINTS


@pytest.fixture
def perception():
    return Perception(SegmentConfig(), DenoiseConfig())


@pytest.fixture(scope="module")
def person():
    return syn.draw(syn.mesh(syn.posed(syn.arms_down())))


def test_points_lie_on_their_pixels_rays_and_near_the_surface(perception, person):
    frame = syn.to_frame(np.minimum(person, syn.room()), noise=0.005)
    people = perception.perceive(frame)
    assert (people.stamp_ns, people.frame_id) == (frame.stamp_ns, frame.frame_id)
    assert people.points.shape == (144, 176, 3)
    assert people.points.dtype == np.float32
    mine = people.labels == PERSON
    np.testing.assert_array_equal(np.isfinite(people.points).all(axis=-1), mine)
    rows, cols = np.nonzero(mine)
    x, y, z = people.points[mine].T
    np.testing.assert_allclose(syn.CAMERA.fx * x / z + syn.CAMERA.cx, cols, atol=1e-3)
    np.testing.assert_allclose(syn.CAMERA.fy * y / z + syn.CAMERA.cy, rows, atol=1e-3)
    off = np.abs(z - person[mine])
    assert np.median(off[np.isfinite(off)]) < 0.005
    assert mine.sum() > 0.93 * np.isfinite(person).sum()


def test_who_it_is_and_the_working_grid_s_camera(perception, person):
    """A large image is reduced to half; the people's camera is the reduced one, and fits the points."""
    c = syn.CAMERA
    camera = syn.Camera(2 * c.width, 2 * c.height, 2 * c.fx, 2 * c.fy, 2 * c.cx + 0.5, 2 * c.cy + 0.5)
    depth = np.repeat(np.repeat(np.minimum(person, syn.room()), 2, axis=0), 2, axis=1)
    for frame in (syn.to_frame(np.minimum(person, syn.room())), syn.to_frame(depth, camera=camera)):
        people = perception.perceive(frame)
        assert people.camera == pytest.approx(c)
        (found,) = people.persons
        assert (found.body_id, found.found.label, found.camera) == ("body_1", PERSON, people.camera)
        assert (found.stamp_ns, found.frame_id) == (frame.stamp_ns, frame.frame_id)
        rows, columns = np.nonzero(people.labels == PERSON)
        pixels = people.camera.project(people.points[rows, columns])
        np.testing.assert_allclose(pixels, np.stack([columns, rows], axis=1), atol=1e-3)


def test_dropped_points_are_unknown_not_free(perception, person):
    """An outlier that denoising drops is neither the person nor known to be empty."""
    tuning = DenoiseTuning(outlier_distance=0.01)  # farther apart than neighbours can be
    perception = Perception(SegmentConfig(), DenoiseConfig(), denoise_tuning=tuning)
    people = perception.perceive(syn.to_frame(np.minimum(person, syn.room())))
    inner = np.isfinite(person)
    inner[110:] = False
    assert people.persons == ()
    assert not (people.labels == PERSON).any()
    assert (people.labels[inner] == HIDDEN).mean() > 0.9


def test_the_floor_is_found_and_kept(perception, person):
    """From the first frame on, also while it is out of view; a reset forgets it."""
    frame = syn.to_frame(np.minimum(person, syn.room(floor=0.95)))
    np.testing.assert_allclose(perception.perceive(frame).floor, [0.0, -1.0, 0.0, 0.95], atol=0.01)
    alone = replace(syn.to_frame(person), stamp_ns=frame.stamp_ns + 30_000_000)
    people = perception.perceive(alone)
    np.testing.assert_allclose(people.floor, [0.0, -1.0, 0.0, 0.95], atol=0.01)
    for shown in people.persons:
        np.testing.assert_array_equal(shown.target(100).floor, people.floor)
    perception.reset()
    assert not perception.perceive(alone).floor.any()


def test_nobody(perception):
    people = perception.perceive(syn.to_frame(syn.room()))
    assert people.persons == ()
    assert not people.labels.any()
    assert np.isnan(people.points).all()


def child_and_adult(adult):
    """A room with a child in it, and with an adult beside."""
    child = syn.draw(syn.mesh(syn.posed(syn.arms_down(), distance=2.8, aside=-0.95, scale=0.75)))
    alone = np.minimum(child, syn.room())
    return alone, np.minimum(adult, alone)


def test_people_are_named_anew_where_stamps_jump(person):
    """A child is followed while an adult comes in, and over a second's silence; not after a jump."""
    alone, both = child_and_adult(person)
    steps = ((syn.STEP_NS, True), (10**9, True), (-syn.STEP_NS, False), (3 * 10**9, False))
    for step_ns, same in steps:
        perception = Perception(SegmentConfig(), DenoiseConfig())
        (first,) = perception.perceive(syn.to_frame(alone)).persons
        later = perception.perceive(syn.to_frame(both, syn.START_NS + step_ns)).persons
        names = {p.body_id: np.median(p.points[:, 0]) for p in later}
        assert len(names) == 2
        assert (first.body_id in names) == same
        assert min(names.values()) < -0.5 < max(names.values())
        if same:
            assert names[first.body_id] < -0.5


def test_planes_forget_the_person_where_stamps_jump(person):
    """The paper's way cuts one person out: the child who is followed, or the adult who is larger."""
    alone, both = child_and_adult(person)
    for step_ns, same in ((syn.STEP_NS, True), (-syn.STEP_NS, False), (10**9, False)):
        perception = Perception(SegmentConfig(method="planes"), DenoiseConfig())
        perception.perceive(syn.to_frame(alone))
        people = perception.perceive(syn.to_frame(both, syn.START_NS + step_ns))
        x = np.nanmedian(people.points[..., 0])
        assert bool(x < -0.5) == same


def test_who_is_outside_the_zone_gets_no_points_of_their_own(person):
    frame = syn.to_frame(np.minimum(person, syn.room()))
    (found,) = Perception(SegmentConfig(zone="1:9"), DenoiseConfig()).perceive(frame).persons
    perception = Perception(SegmentConfig(zone=":1"), DenoiseConfig())
    assert found.body_id == "body_1"
    assert perception.perceive(frame).persons == ()
    assert perception.rejected_counts == {
        "outside the zone": 1,
        "beyond the most": 0,
        "too near or too far": 0,
        "not sure enough": 0,
        "too few points": 0,
    }


def test_who_is_too_far_is_counted(person):
    frame = syn.to_frame(np.minimum(person, syn.room()))
    perception = Perception(SegmentConfig(far=1.5), DenoiseConfig())
    assert perception.perceive(frame).persons == ()
    assert perception.perceive(replace(frame, stamp_ns=frame.stamp_ns + syn.STEP_NS)).persons == ()
    assert perception.rejected_counts["too near or too far"] == 2


def test_warm_up_and_reset_change_nothing(person):
    frame = syn.to_frame(np.minimum(person, syn.room()))
    plain = Perception(SegmentConfig(), DenoiseConfig())
    warmed = Perception(SegmentConfig(), DenoiseConfig())
    warmed.warm_up()
    a, b = plain.perceive(frame), warmed.perceive(frame)
    np.testing.assert_array_equal(a.points, b.points)
    warmed.reset()
    np.testing.assert_array_equal(warmed.perceive(frame).labels, a.labels)


def test_who_shows_too_little_takes_nobody_s_place(person):
    """Of most one, the nearest: an arm at the image's edge is not answered, who stands behind it is."""
    frame = syn.to_frame(np.minimum(person, syn.room()))
    perception = Perception(SegmentConfig(most_people=1), DenoiseConfig())
    seen = perception.segmenter.segment(frame)
    (detection,) = seen.detections
    labels = seen.labels.copy()
    rows, columns = np.nonzero(labels == detection.label)
    labels[rows[: MIN_POINTS // 2], columns[: MIN_POINTS // 2]] = 9
    arm = replace(detection, label=9, place=0.5 * detection.place)
    perception.segmenter.segment = lambda _: replace(seen, labels=labels, detections=(detection, arm))
    people = perception.perceive(frame)
    assert [p.found.label for p in people.persons] == [detection.label]
    assert perception.rejected_counts["too few points"] == 1
    assert perception.rejected_counts["beyond the most"] == 0
