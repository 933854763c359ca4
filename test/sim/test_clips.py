from pathlib import Path

import numpy as np
import pytest

from depth_pose.core.skeleton import BONES, JOINT_INDEX, JOINTS
from depth_pose.io.mcap_read import read_frames
from depth_pose.sim.clips import RoomClip, sample_clip, sample_still_clip, write_clip
from depth_pose.sim.performers import Act, Performer

FPS = 10.0


@pytest.fixture(scope="module")
def clip() -> RoomClip:
    return sample_clip(np.random.default_rng(3), frames=20, fps=FPS, people=2, width=160)


@pytest.fixture(scope="module")
def performer() -> Performer:
    return Performer(np.random.default_rng(5), FPS)


def test_a_clip_is_written_and_read_back(clip: RoomClip, tmp_path: Path) -> None:
    write_clip(tmp_path / "a.mcap", clip)
    frames = list(read_frames(tmp_path / "a.mcap"))
    truth = np.load(tmp_path / "a.npz")
    np.testing.assert_array_equal([f.stamp_ns for f in frames], truth["stamps_ns"])
    np.testing.assert_allclose([f.depth for f in frames], clip.depth, atol=6e-4)
    assert tuple(truth["names"]) == JOINTS
    people = clip.joints.shape[1]
    assert truth["joints"].shape == (20, people, 19, 3) and truth["seen"].shape == (20, people, 19)
    assert truth["visible"].shape == (20, people) and 1 <= people <= 2
    assert truth["K"][0, 0] == frames[0].camera.fx


def test_the_same_state_gives_the_same_clip(clip: RoomClip) -> None:
    again = sample_clip(np.random.default_rng(3), frames=20, fps=FPS, people=2, width=160)
    np.testing.assert_array_equal(clip.depth, again.depth)
    np.testing.assert_array_equal(clip.joints, again.joints)


def test_people_keep_their_bones_and_move_smoothly(clip: RoomClip) -> None:
    one, other = np.array(BONES).T
    lengths = np.linalg.norm(clip.joints[:, :, one] - clip.joints[:, :, other], axis=-1)
    trunk = [i for i, pair in enumerate(BONES) if JOINT_INDEX["left_knee"] in pair]
    np.testing.assert_allclose(lengths[:, :, trunk], lengths[:1, :, trunk].repeat(20, axis=0), atol=2e-3)
    pelvis = np.linalg.norm(np.diff(clip.joints[:, :, 0], axis=0), axis=-1) * FPS
    assert pelvis.max() < 3.5


def test_who_walks_arrives_without_sliding(performer: Performer) -> None:
    track = performer.perform([Act("walk", 20.0, (0.0, 2.5)), Act("stand", 1e9)], (0.0, 0.0), 0.5, 160)
    assert np.hypot(track.spots[-1, 0], track.spots[-1, 1] - 2.5) < 0.6
    ankles = []
    for t in range(20, 40):
        figure = performer.figure(track.rotations[t])
        c, s = np.cos(track.heading[t]), np.sin(track.heading[t])
        turned = figure.joints @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T
        ankles.append(
            (turned + [track.spots[t, 0], 0, track.spots[t, 1]])[
                [JOINT_INDEX["left_ankle"], JOINT_INDEX["right_ankle"]]
            ]
        )
    moved = np.linalg.norm(np.diff(np.array(ankles)[..., [0, 2]], axis=0), axis=-1).min(axis=1)
    assert np.median(moved) < 0.01  # the foot that carries the weight stays


def test_who_sits_down_comes_to_rest_behind_their_feet(performer: Performer) -> None:
    track = performer.perform([Act("stand", 1.0), Act("sit", 1e9)], (0.0, 0.0), 0.0, 40)
    assert not track.seated[:20].any() and track.seated[-1]
    np.testing.assert_allclose(track.spots[-1], track.spots[-5], atol=1e-6)
    standing, sitting = (performer.figure(track.rotations[t]) for t in (0, -1))
    assert sitting.joints[0, 1] < 0.8 * standing.joints[0, 1]
    assert 0.2 < sitting.seat_height < 0.7
    assert sitting.vertices.shape == standing.vertices.shape  # one body, one outfit


def test_a_still_home_has_one_truth_and_new_noise():
    """Nobody moves, so that only the sensor's noise differs between frames."""
    clip = sample_still_clip(np.random.default_rng(3), 3, 10.0, 1, "tof")
    assert clip.depth.shape[0] == len(clip.stamps_ns) == 3
    assert (clip.joints == clip.joints[0]).all() and len(clip.joints[0]) == 1
    first, second = clip.depth[:2]
    both = (first > 0) & (second > 0)
    assert (first != second)[both].any()
    assert np.median(np.abs(first - second)[both]) < 0.02
