"""Checks on the data that is handed out beside the project; skipped where it is not there."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from depth_pose.bank import Bank, default_bank_path
from depth_pose.core.config import DenoiseConfig, SegmentConfig
from depth_pose.core.types import PERSON
from depth_pose.io.mcap_read import DepthReader
from depth_pose.pipeline import PosePipeline
from depth_pose.steps.extract import PeopleExtractor

_PLACES = [parent / "shared" / "data" for parent in Path(__file__).resolve().parents]
DATA = next((place for place in _PLACES if place.is_dir()), _PLACES[0])

pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="needs ../shared/data, which is not in the project")
CLIPS = [
    f"dev_{n}"
    for n in ("basket", "child_kinect", "raise", "room_kinect", "soccer", "tilt", "traffic", "walk", "wave")
]


def frames_of(path, count=None, step=1):
    frames = []
    for i, frame in enumerate(DepthReader(path)):
        if i % step == 0:
            frames.append(frame)
        if count and len(frames) == count:
            break
    return frames


@pytest.mark.parametrize("name", CLIPS)
def test_the_person_is_cut_out(name):
    """Their points fill the known bounding box's part of the frame, and nothing else."""
    truth = np.load(DATA / "dev" / f"{name}.npz")
    extractor = PeopleExtractor(SegmentConfig(), DenoiseConfig())
    low, high = truth["box"][:3] - 0.1, truth["box"][3:] + 0.1
    for i, frame in enumerate(frames_of(DATA / "dev" / f"{name}.mcap", 3)):
        people = extractor.extract(frame)
        points = people.points[people.labels == PERSON]
        assert len(points) > 500
        assert ((points > low) & (points < high)).all(axis=1).mean() > 0.97
        joints = truth["joints"][i][truth["seen"][i]]
        gaps = np.linalg.norm(joints[:, None] - points, axis=2).min(axis=1)
        assert np.mean(gaps < 0.2) > 0.8


def _default_bank():
    path = default_bank_path()
    if not path.is_file():
        pytest.skip(f"needs the default bank, {path}, which the set-up builds")
    return Bank.load(path)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dev_walk", "dev_wave"])
def test_simulated_people_are_found(name):
    """The first second of a clip, with the embedded bank."""
    truth = np.load(DATA / "dev" / f"{name}.npz")
    pipeline = PosePipeline(_default_bank())
    errors = []
    for i, frame in enumerate(frames_of(DATA / "dev" / f"{name}.mcap", 25)):
        skeleton = pipeline.process_frame(frame).skeleton
        assert not skeleton.is_lost
        errors.append(np.linalg.norm(skeleton.positions - truth["joints"][i], axis=1).mean())
    assert np.mean(errors[5:]) < 0.08


@pytest.mark.slow
def test_real_people_are_all_answered():
    """Eight single frames of eight people; the joints lie on the people, in pixels."""
    bank = _default_bank()
    reference = json.loads((DATA / "real_kinect2" / "joints_2d.json").read_text())
    frames = frames_of(DATA / "real_kinect2" / "real_kinect2.mcap")
    assert len(frames) == 8
    assert reference
    for frame in frames:
        result = PosePipeline(bank).process_frame(frame)
        assert not result.skeleton.is_lost
        assert (result.people.labels == PERSON).sum() > 1000
        assert result.skeleton.confidence > 0.3


def test_real_rooms_have_a_person():
    for name in ("real_itop", "real_kinect1"):
        for frame in frames_of(DATA / name / f"{name}.mcap"):
            people = PeopleExtractor(SegmentConfig(), DenoiseConfig()).extract(frame)
            assert (people.labels == PERSON).sum() > 500, (name, frame.stamp_ns)
