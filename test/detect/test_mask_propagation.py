"""Who is carried over to the next frame without a search, and when the frame is searched."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from crowd import CAMERA, person, seen
from depth_pose.core.camera import Camera
from depth_pose.core.config import SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.core.labels import HIDDEN, PERSON
from depth_pose.detect._carry_kernels import Before, CarryLimits, carry_labels, count_inside, take_new
from depth_pose.detect.candidates import Candidates
from depth_pose.detect.finder import TorsoDetection
from depth_pose.detect.learned_segmenter import LearnedSegmenter
from depth_pose.detect.mask_propagation import MaskPropagation
from depth_pose.detect.segmentation import Detection
from depth_pose.detect.tuning import DetectTuning

STEP_NS = 33_000_000


class Watched:
    """Tells how often a segmenter searched the whole image; with "low" no rarer where nobody moves."""

    def __init__(self, every: int = 2, speed: Literal["low", "normal"] = "low") -> None:
        config = SegmentConfig(speed=speed)
        self.segmenter = LearnedSegmenter(config, tuning=DetectTuning(find_every=every))
        self.searches, self._find = 0, self.segmenter.candidates.find
        self.segmenter.candidates.find = self._count
        self.stamp_ns = 10**18

    def _count(self, frame: DepthFrame) -> Candidates:
        self.searches += 1
        return self._find(frame)

    def see(self, frame: DepthFrame, step_ns: int = STEP_NS):
        self.stamp_ns += step_ns
        return self.segmenter.segment(replace(frame, stamp_ns=self.stamp_ns))


def shown(frame: int) -> DepthFrame:
    return seen(frame, [person(frame, -0.5, 3.2)])


def is_person(labels: np.ndarray) -> np.ndarray:
    return (labels != 0) & (labels != HIDDEN)


@pytest.mark.parametrize(("every", "searches"), [(1, 6), (2, 3), (3, 2)])
def test_the_image_is_searched_as_often_as_asked_for(every: int, searches: int) -> None:
    watched = Watched(every)
    for _ in range(6):
        watched.see(shown(0))
    assert watched.searches == searches


def test_where_nobody_moves_the_image_is_searched_less_often() -> None:
    watched = Watched(speed="normal")
    for _ in range(12):
        watched.see(shown(0))
    assert watched.searches < 6


def test_who_moves_is_carried_over_whole() -> None:
    """Arms, hands and feet go along, and nothing of the room does."""
    carrying, searching = Watched(), Watched(1)
    for k in range(24):
        frame = shown(k)
        carried, found = carrying.see(frame), searching.see(frame)
        both = is_person(carried.labels) & is_person(found.labels)
        either = is_person(carried.labels) | is_person(found.labels)
        assert both.sum() > 0.97 * either.sum()
        (here,), (there,) = carried.detections, found.detections
        np.testing.assert_allclose(here.place, there.place, atol=0.1)
        assert here.label == there.label == PERSON
    assert carrying.searches == 12


def test_who_comes_in_is_searched_for() -> None:
    watched = Watched(every=100)
    for _ in range(3):
        watched.see(shown(0))
    crowd = seen(0, [person(0, -0.5, 3.2), person(0, 0.9, 2.8)])
    assert len(watched.see(crowd).detections) == 2
    assert watched.searches == 2


def test_who_leaves_is_searched_for() -> None:
    watched = Watched(every=100)
    watched.see(shown(0))
    assert not watched.see(seen(0, [])).detections
    assert watched.searches == 2


@pytest.mark.parametrize("step_ns", [51_000_000, 0, -STEP_NS])
def test_nobody_is_carried_over_a_gap_or_back_in_time(step_ns: int) -> None:
    watched = Watched()
    watched.see(shown(0))
    watched.see(shown(0), step_ns)
    assert watched.searches == 2


def test_another_camera_and_a_reset_are_searched() -> None:
    watched = Watched(every=100)
    watched.see(shown(0))
    watched.see(replace(shown(0), camera=CAMERA._replace(fx=1.01 * CAMERA.fx)))
    watched.segmenter.reset()
    watched.see(shown(0))
    assert watched.searches == 3


def test_nobody_is_searched_for_in_every_frame() -> None:
    watched = Watched()
    for _ in range(3):
        watched.see(seen(0, []))
    assert watched.searches == 3


def test_what_is_new_goes_on_from_somebody_or_stays_nobody_s() -> None:
    depth = np.full((20, 30), np.float32(4.0))
    depth[5:15, 5:10] = 2.0  # somebody
    depth[5:8, 10:20] = 2.03  # an arm that was not there
    depth[10, 10] = 3.0  # flies beside them
    depth[16:19, 20:25] = 1.0  # a thing that was not there
    labels = np.where(depth == 2.0, np.uint8(PERSON), np.uint8(0))
    is_new = (depth != 2.0) & (depth != 4.0)
    assert count_inside(is_new) == 8 + 3
    take_new(depth, is_new, 0.08, labels)
    assert (labels[5:8, 10:20] == PERSON).all()
    assert labels[10, 10] == PERSON
    assert not labels[16:19, 20:25].any()
    assert (labels == PERSON).sum() == 50 + 30 + 1


def test_the_warm_up_carries_people_over(monkeypatch: pytest.MonkeyPatch) -> None:
    segmenter = LearnedSegmenter(SegmentConfig())
    carried, carry = [], MaskPropagation.carry

    def watch(people: MaskPropagation, frame: DepthFrame, *, is_calm: bool) -> Candidates | None:
        carried.append(carry(people, frame, is_calm=is_calm))
        return carried[-1]

    monkeypatch.setattr(MaskPropagation, "carry", watch)
    segmenter.warm_up()
    assert [c is not None for c in carried] == [False, True]


@pytest.mark.parametrize("probability", [0.3, 0.9])
def test_a_weak_detection_takes_nothing_from_a_confirmed_person(probability: float) -> None:
    depth = np.full((12, 20), np.float32(2.0))
    shown = np.zeros(depth.shape, np.uint8)
    shown[2:10, 4:16] = 1
    known = TorsoDetection(1, 0.95, np.array([0.0, 0.0, 2.0]))
    before = Candidates(depth, shown, Camera(20, 12, 20.0, 20.0, 9.5, 5.5), (known,), 0)
    people = MaskPropagation(SegmentConfig())
    people.keep(before, [Detection(1, known.torso, 0.95)], 10**18, shown)
    now = depth.copy()
    now[:, 13:] = 2.3  # the person is not there any more
    labels = shown.copy()
    labels[7:, :] = 2  # a bed, with a part of the person
    labels[2, 4:16] = 0  # lost by the search
    found = replace(
        before, depth=now, labels=labels, people=(known, TorsoDetection(2, probability, known.torso + 0.3))
    )
    kept, is_returned = people.give_back(found, 10**18 + STEP_NS)
    was_theirs = (shown == 1) & (now == 2.0)
    expected = was_theirs & ((labels == 0) | ((labels == 2) & (probability < 0.5)))
    np.testing.assert_array_equal(is_returned, expected)
    np.testing.assert_array_equal(kept.labels, np.where(expected, 1, labels))
    assert is_returned.any()
    for later_ns in (0, 60_000_000):  # not over a gap
        assert people.give_back(found, 10**18 + later_ns) == (found, None)


def test_labels_twin() -> None:
    """Every pixel takes the label of the nearest point of the previous frame, or is new."""
    rng = np.random.default_rng(8)
    camera, limits = Camera(24, 18, 20.0, 20.0, 11.5, 8.5), CarryLimits(0.25, 0.08, 5)
    v, u = np.mgrid[: camera.height, : camera.width]
    body = (np.abs(u - 11) < 5) & (np.abs(v - 9) < 6)
    before = Before(
        np.where(body, 2.0, 3.0) + rng.normal(0.0, 0.1, body.shape), np.where(body, 1 + (u > 11), 0)
    )
    depth = np.where(np.roll(body, 4, axis=1), 2.0, 3.0) + rng.normal(0.0, 0.1, body.shape)
    before.depth[rng.random(body.shape) < 0.1] = 0.0
    depth[rng.random(body.shape) < 0.1] = 0.0
    labels, is_new = np.empty(body.shape, np.uint8), np.empty(body.shape, np.bool_)
    before = Before(before.depth.astype(np.float32), before.labels.astype(np.uint8))
    carry_labels(before, depth.astype(np.float32), camera, limits, labels, is_new)
    for i, j in np.ndindex(body.shape):
        z = depth[i, j]
        aside = z / camera.fx * np.hypot(v - i, u - j)
        far = np.hypot(aside, before.depth - z)
        seen = (before.depth > 0) & (np.maximum(np.abs(v - i), np.abs(u - j)) <= limits.pixels)
        far = np.where(seen, far, np.inf)
        is_known = z > 0 and far.min() < limits.moved
        assert is_new[i, j] == (z > 0 and not is_known)
        assert labels[i, j] == (before.labels.ravel()[far.argmin()] if is_known else 0)
    assert is_new.any()
    assert set(np.unique(labels)) == {0, 1, 2}
