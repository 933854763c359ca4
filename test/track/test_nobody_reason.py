"""The table of inputs in which nobody is found, and the cause that is named for each."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from depth_pose.core.config import PipelineConfig, SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.detect.sample_frame import sample_frame
from depth_pose.io.clouds import R_BODY_OPTICAL
from depth_pose.pipeline import PosePipeline
from depth_pose.track.nobody import NobodyWatch
from depth_pose.tracker import Tracker

FRAME = replace(sample_frame(), depth=np.round(sample_frame().depth, 3))
RNG = np.random.default_rng(6)

Change = Callable[[np.ndarray], np.ndarray]


def swapped(depth: np.ndarray) -> np.ndarray:
    """Millimetres with their two bytes exchanged."""
    return np.rint(1000 * depth).astype(np.uint16).byteswap() / 1000.0


def lossy(kept: float) -> Change:
    return lambda depth: depth * (RNG.random(depth.shape) < kept)


IMAGES: dict[str, tuple[Change, SegmentConfig, str]] = {
    "nothing": (lambda depth: 0 * depth, SegmentConfig(), "less than 1 % of the pixels"),
    "not a number": (lambda depth: depth * np.nan, SegmentConfig(), "less than 1 % of the pixels"),
    "few pixels": (lossy(0.005), SegmentConfig(), "less than 1 % of the pixels"),
    "scattered pixels": (lossy(0.1), SegmentConfig(working_height=48), "scattered"),
    "millimetres": (lambda depth: 1000 * depth, SegmentConfig(), "another unit"),
    "kilometres": (lambda depth: 0.001 * depth, SegmentConfig(), "another unit"),
    "bytes swapped": (swapped, SegmentConfig(), "byte-swapped"),
    "all beyond far": (lambda depth: depth, SegmentConfig(far=1.5), "beyond segment.far, 1.5 m"),
    "all nearer than near": (lambda depth: 0.1 * depth, SegmentConfig(near=0.6), "segment.near, 0.6 m"),
    "centimetres": (lambda depth: 0.18 * depth, SegmentConfig(), "may be centimetres"),
    "inverse depth": (lambda depth: 1.0 / depth, SegmentConfig(), "inverse depth or disparity"),
    "a room": (lambda depth: np.full_like(depth, 3.0), SegmentConfig(), ""),
    "noise": (lambda depth: RNG.uniform(0.5, 7.0, depth.shape), SegmentConfig(), ""),
}


def image(change: Change) -> DepthFrame:
    return replace(FRAME, depth=change(FRAME.depth).astype(np.float32))


@pytest.mark.parametrize("name", IMAGES)
def test_causes_in_the_image(name: str) -> None:
    change, config, words = IMAGES[name]
    watch = NobodyWatch(config)
    for k in range(16):
        watch.look(image(change), is_found=False, is_answered=False, rejected={})
        assert not watch.doubt or k >= 7, "a few frames are no reason"
    assert words in watch.doubt and bool(watch.doubt) == bool(words)
    watch.look(FRAME, is_found=True, is_answered=True, rejected={})
    assert watch.doubt == ""


PEOPLE = [
    (True, "", "no pose fits them"),
    (False, "outside the zone", "outside segment.zone, 1:2"),
    (False, "too near or too far", "0.4 to 8 m"),
    (False, "not sure enough", ""),
    (False, "", ""),
]


@pytest.mark.parametrize(("is_found", "reason", "words"), PEOPLE)
def test_causes_in_the_people(is_found: bool, reason: str, words: str) -> None:
    watch, counts = NobodyWatch(SegmentConfig(zone="1:2")), Counter[str]()

    def look(is_answered: bool) -> None:
        counts[reason] += 1
        watch.look(FRAME, is_found=is_found, is_answered=is_answered, rejected=counts)

    for _ in range(16):
        look(is_answered=False)
    assert words in watch.doubt and bool(watch.doubt) == bool(words)
    look(is_answered=True)
    for _ in range(16):
        look(is_answered=False)
    assert watch.doubt == "", "who was answered before may have left the zone"


def test_every_cause_is_in_a_table() -> None:
    tested = [words for _, _, words in (*IMAGES.values(), *PEOPLE) if words]
    for cause, words in NobodyWatch(SegmentConfig(zone="1:2", near=0.4, far=8.0)).words.items():
        is_tested = any(each in words for each in tested) or cause in ("near", "far", "axes")
        assert is_tested, f"{cause} is in no table"


def test_only_people_are_known() -> None:
    """By the recovery node, which has no depth: found, and never answered."""
    watch = NobodyWatch()
    for _ in range(8):
        assert watch.doubt == ""
        watch.look(None, is_found=True, is_answered=False, rejected={})
    assert "no pose fits them" in watch.doubt


R_MAP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""A camera that looks along y of a room whose z is up."""


@pytest.mark.parametrize(
    ("name", "R", "place", "words"),
    [
        ("optical", np.eye(3), (0, 0, 0), ""),
        ("body", R_BODY_OPTICAL, (0, 0, 0), "the cloud is in a body frame (x forward): it is turned"),
        ("map", R_MAP, (0.0, 0.0, 1.2), "most points of the cloud lie beside or behind the camera"),
    ],
)
def test_clouds_of_other_axes(bank, name, R, place, words) -> None:
    """The library's warning; a cloud of a body frame is turned and its person found."""
    tracker = Tracker(bank)
    points = FRAME.camera.back_project(FRAME.depth).reshape(-1, 3)
    cloud = (points[np.isfinite(points).all(axis=1)] @ R.T + place).astype(np.float32)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        found = [tracker(cloud, time=0.04 * k) for k in range(12)]
    assert any(found) == (name != "map")
    assert any(words in str(w.message) for w in said) if words else not said


@pytest.mark.parametrize(
    ("config", "words"),
    [
        ({"segment": {"zone": "0.5:1.0"}}, "outside segment.zone"),
        ({"segment": {"far": 2.5}}, "segment.far"),
        ({}, ""),
    ],
)
def test_the_pipeline_says_why(bank, config: dict[str, dict[str, float]], words: str) -> None:
    pipeline = PosePipeline(bank, PipelineConfig.from_mapping(config))
    for k in range(12):
        result = pipeline.process_frame(replace(FRAME, stamp_ns=40_000_000 * k))
    assert len(result.skeletons) == (0 if words else 1)
    said = " ".join(pipeline.warnings)
    assert words in said and bool(said) == bool(words)
    pipeline.reset()
    assert pipeline.warnings == ()
