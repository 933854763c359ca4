"""Simulated recordings of the embedded body."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from depth_pose.core.errors import ConfigError
from depth_pose.core.skeleton import ADULT_STATURE_M, JOINT_INDEX, JOINTS, rest_nodes
from depth_pose.evaluate.truth import load_truth
from depth_pose.io.mcap_read import DepthReader
from depth_pose.motion.clip import Clip
from depth_pose.sim.config import Person, Placement, Room
from depth_pose.sim.motion import load_motion, resample_clip
from depth_pose.sim.noise import NO_NOISE
from depth_pose.sim.sensor import SENSORS
from depth_pose.sim.simulate import Stage, root_scale, simulate


@pytest.fixture(scope="module")
def body():
    return Person().body()


def _standing(frames: int) -> Clip:
    rotations = np.tile(np.eye(3), (frames, 21, 1, 1))
    roots = np.tile(rest_nodes()[0] * ADULT_STATURE_M, (frames, 1))
    return Clip("standing", 25.0, rotations, roots)


def test_recording_and_truth_agree(tmp_path: Path, body) -> None:
    stage = Stage(placement=Placement(distance=3.0, azimuth=30.0, pitch=5.0))
    truth = simulate(tmp_path / "a.mcap", body, _standing(3), stage, seed=1)
    read = load_truth(tmp_path / "a.npz")
    np.testing.assert_array_equal(read.joints.astype(np.float32), truth.joints)
    assert read.names == JOINTS
    reader = DepthReader(tmp_path / "a.mcap")
    frames = list(reader)
    assert [f.stamp_ns for f in frames] == read.stamps_ns.tolist()
    assert np.diff(read.stamps_ns).tolist() == [40_000_000] * 2
    camera = frames[0].camera
    np.testing.assert_allclose(truth.K, [[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    # the sensor sees skin a little before the chest's centre
    chest = truth.joints[0, JOINT_INDEX["chest"]]
    u, v = (round(camera.fx * chest[i] / chest[2] + c) for i, c in ((0, camera.cx), (1, camera.cy)))
    assert 0.02 < chest[2] - frames[0].depth[v, u] < 0.25


def test_person_stands_on_the_floor_at_its_own_size(tmp_path: Path, body) -> None:
    placement = Placement(distance=4.0, height=0.9)
    truth = simulate(tmp_path / "a.mcap", body, _standing(1), Stage(placement=placement))
    # level camera: the floor is 0.9 m below it
    assert truth.box[4] == pytest.approx(0.9, abs=0.015)
    assert truth.box[4] - truth.box[1] == pytest.approx(1.68, abs=0.02)
    assert root_scale(body) == pytest.approx(body.nodes[0, 1] / (0.564 * 1.75))
    pelvis = truth.joints[0, JOINT_INDEX["pelvis"]]
    np.testing.assert_allclose(pelvis[[0, 2]], [0, 4.0], atol=1e-6)
    assert truth.joints[0, JOINT_INDEX["left_wrist"], 0] > 0.2


def test_camera_motion_moves_truth_rigidly(tmp_path: Path, body) -> None:
    """Another camera sees the same distances between joints."""
    clip = _standing(1)
    first = simulate(tmp_path / "a.mcap", body, clip, Stage(room=Room(floor=False, wall=0.0))).joints[0]
    stage = Stage(placement=Placement(distance=2.8, height=1.7, azimuth=-70.0, pitch=20.0, roll=10.0))
    second = simulate(tmp_path / "b.mcap", body, clip, stage).joints[0]
    for joints in (first, second):
        assert joints.shape == (19, 3)
    np.testing.assert_allclose(
        np.linalg.norm(first[:, None] - first, axis=-1),
        np.linalg.norm(second[:, None] - second, axis=-1),
        atol=1e-5,
    )


def test_what_is_seen(tmp_path: Path, body) -> None:
    front = simulate(tmp_path / "a.mcap", body, _standing(1))
    assert front.seen.all()
    side = simulate(tmp_path / "b.mcap", body, _standing(1), Stage(placement=Placement(azimuth=90.0)))
    assert side.seen[0, JOINT_INDEX["left_wrist"]]
    assert not side.seen[0, JOINT_INDEX["right_wrist"]]
    close = simulate(tmp_path / "c.mcap", body, _standing(1), Stage(placement=Placement(distance=1.0)))
    assert not close.seen[0, JOINT_INDEX["left_foot"]]


def test_same_seed_same_file(tmp_path: Path, body) -> None:
    clip = load_motion("wave", 25.0, 0.12, seed=3)
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        simulate(tmp_path / f"{name}.mcap", body, clip, seed=seed)
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()
    assert (tmp_path / "a.mcap").read_bytes() != (tmp_path / "c.mcap").read_bytes()


def test_structured_light_leaves_a_shadow_beside_the_person(tmp_path: Path, body) -> None:
    stage = Stage(replace(SENSORS["structured"], noise=NO_NOISE), Placement(distance=3.0))
    simulate(tmp_path / "a.mcap", body, _standing(1), stage)
    depth = next(iter(DepthReader(tmp_path / "a.mcap"))).depth
    assert depth.shape == (480, 640)
    above_floor = depth[100:350]
    columns = np.flatnonzero(((above_floor > 2.5) & (above_floor < 3.3)).any(axis=0))
    middle = (columns[0] + columns[-1]) // 2
    assert (above_floor[:, middle:] == 0).mean() > 0.02
    # the projector sits left of the camera: nothing is hidden from it on that side
    assert (above_floor[:, : columns[0]] > 0).all()


def test_bad_requests_are_refused(tmp_path: Path, body) -> None:
    with pytest.raises(ConfigError, match=r"must end in \.mcap"):
        simulate(tmp_path / "a.bag", body, _standing(1))
    with pytest.raises(ConfigError, match="no motion 'fly'"):
        load_motion("fly", 25.0, 1.0)
    with pytest.raises(ConfigError, match=r"Placement.distance"):
        Placement(distance=0.1)


def test_resampling_keeps_the_motion() -> None:
    clip = load_motion("walk", 30.0, 1.0, seed=1)
    same = resample_clip(clip, 30.0, 1.0)
    assert len(same) == 30
    np.testing.assert_allclose(same.rotations, clip.rotations, atol=1e-9)
    slow = resample_clip(clip, 15.0, 10.0)
    assert len(slow) == 15
    np.testing.assert_allclose(slow.roots, clip.roots[::2], atol=1e-12)
    fast = resample_clip(clip, 60.0, 1.0)
    assert len(fast) == 60
    middle = fast.rotations[1]
    np.testing.assert_allclose(np.linalg.det(middle), 1.0, atol=1e-9)
    turn_before = np.einsum("nij,nkj->nik", middle, clip.rotations[0])
    turn_after = np.einsum("nij,nkj->nik", clip.rotations[1], middle)
    np.testing.assert_allclose(turn_before, turn_after, atol=1e-9)


def test_captured_motion(tmp_path: Path) -> None:
    with pytest.raises(Exception, match=r"none\.bvh"):
        load_motion(str(tmp_path / "none.bvh"), 25.0, 1.0)
