"""The whole method on a simulated person in a room."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import synthetic as syn
from depth_pose.core.config import MAX_STAMP_GAP_NS, PipelineConfig
from depth_pose.core.skeleton import JOINT_NODES, Source
from depth_pose.core.types import PERSON
from depth_pose.motion.procedural.generator import make_clip
from depth_pose.pipeline import PosePipeline

FRAMES = 10


@pytest.fixture(scope="module")
def clip():
    """Frames of somebody walking before a wall, with noise and true joints."""
    motion = make_clip("walk", 25.0, FRAMES / 25.0, 3)
    frames, joints = [], []
    for i in range(FRAMES):
        root = syn.FACING @ (motion.roots[i] - [0.0, 0.9, 0.0]) + [0.0, 0.0, 3.3]
        posed = syn.default_body().pose(syn.FACING @ motion.rotations[i], root)
        depth = np.minimum(syn.draw(syn.mesh(posed)), syn.room())
        frames.append(syn.to_frame(depth, syn.START_NS + i * syn.STEP_NS, noise=0.008, seed=i))
        joints.append(posed.nodes[JOINT_NODES])
    return frames, np.array(joints)


@pytest.fixture(scope="module")
def results(bank, clip):
    pipeline = PosePipeline(bank)
    return [pipeline.process_frame(frame) for frame in clip[0]]


def empty_room(stamp_ns):
    return syn.to_frame(syn.room(), stamp_ns)


def test_the_joints_are_found(clip, results):
    found = np.array([r.skeleton.positions for r in results])
    errors = np.linalg.norm(found - clip[1], axis=-1)
    assert errors.mean() < 0.04
    assert np.mean(errors < 0.1) > 0.95


def test_every_stage_speaks_of_the_same_frame(clip, results, bank):
    for frame, r in zip(clip[0], results, strict=True):
        assert {r.cloud.stamp_ns, r.match.stamp_ns, r.refined.stamp_ns, r.skeleton.stamp_ns} == {
            frame.stamp_ns
        }
        assert {r.cloud.frame_id, r.match.frame_id, r.refined.frame_id, r.skeleton.frame_id} == {"optical"}
        assert r.match.bank_id == bank.bank_id
        assert r.refined.source == Source.REFINED
        assert (r.cloud.labels == PERSON).sum() > 1000
        assert r.skeleton.confidence > 0.7
        assert 0.9 < r.skeleton.scale < 1.1
    assert len({r.skeleton.body_id for r in results}) == 1
    assert results[0].skeleton.body_id


def test_twice_the_same(bank, clip, results):
    """A new pipeline, a reset one, and a warmed-up one all repeat it bit for bit."""
    pipeline = PosePipeline(bank)
    pipeline.warm_up()
    for _ in range(2):
        for frame, before in zip(clip[0][:5], results, strict=False):
            again = pipeline.process_frame(frame).skeleton
            np.testing.assert_array_equal(again.positions, before.skeleton.positions)
            np.testing.assert_array_equal(again.joint_confidence, before.skeleton.joint_confidence)
            assert again.scale == before.skeleton.scale
        pipeline.reset()


def test_stamps_that_jump_back_start_afresh(bank, clip, results):
    """The same recording once more, as a loop plays it, gives the same answers again."""
    pipeline = PosePipeline(bank)
    for _ in range(2):
        for frame, before in zip(clip[0][:4], results, strict=False):
            again = pipeline.process_frame(frame).skeleton
            np.testing.assert_array_equal(again.positions, before.skeleton.positions)


def test_a_long_gap_starts_afresh(bank, clip):
    frames = clip[0]
    fresh = PosePipeline(bank).process_frame(frames[5]).skeleton
    pipeline = PosePipeline(bank)
    late = frames[5].stamp_ns - MAX_STAMP_GAP_NS - 1
    pipeline.process_frame(syn.DepthFrame(late, "optical", frames[0].depth, frames[0].camera))
    after = pipeline.process_frame(frames[5]).skeleton
    np.testing.assert_array_equal(after.positions, fresh.positions)


def test_somebody_leaves_and_comes_back(bank, clip):
    frames = clip[0]
    pipeline = PosePipeline(bank)
    ids = [pipeline.process_frame(f).skeleton.body_id for f in frames[:2]]
    for i in (2, 3):
        gone = pipeline.process_frame(empty_room(frames[i].stamp_ns))
        assert gone.skeleton.is_lost
        assert gone.match.candidates == ()
        assert not (gone.cloud.labels == PERSON).any()
        assert (gone.skeleton.stamp_ns, len(gone.skeleton.positions)) == (frames[i].stamp_ns, 0)
    back = pipeline.process_frame(frames[4]).skeleton
    assert not back.is_lost
    assert syn.joint_error(back.positions, clip[1][4]) < 0.09  # from a single frame
    assert {back.body_id} == set(ids)  # so soon at the same place it is the same person
    late = replace(frames[5], stamp_ns=frames[5].stamp_ns + 3_000_000_000)
    assert pipeline.process_frame(late).skeleton.body_id not in ids


def test_frames_without_anything_do_no_harm(bank):
    pipeline = PosePipeline(bank)
    for i, value in enumerate((0.0, np.nan, np.inf, -1.0, 1e30)):
        depth = np.full((144, 176), value, np.float32)
        frame = syn.DepthFrame(i * syn.STEP_NS, "optical", depth, syn.CAMERA)
        assert pipeline.process_frame(frame).skeleton.is_lost


def test_settings_reach_their_steps(bank, clip):
    config = PipelineConfig.from_mapping(
        {"segment": {"far": 2.0}, "match": {"scale": 0.8, "keep": 2}, "smooth": {"enabled": False}}
    )
    assert PosePipeline(bank, config).process_frame(clip[0][0]).skeleton.is_lost
    near = PipelineConfig.from_mapping({"match": {"scale": 0.8, "keep": 2}})
    match = PosePipeline(bank, near).process_frame(clip[0][0]).match
    assert match.scale == 0.8
    assert len(match.candidates) <= 2
