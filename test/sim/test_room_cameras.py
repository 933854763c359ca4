"""Several cameras in a simulated room: their recordings, rig and truth agree."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from command import Done, caller
from depth_pose.core.errors import ConfigError
from depth_pose.core.skeleton import JOINT_INDEX, JOINTS
from depth_pose.evaluate.truth import load_known_people
from depth_pose.io.mcap_read import read_frames
from depth_pose.rooms.rigfile import load_rig
from depth_pose.sim.performers import Act, Performer
from depth_pose.sim.room_recordings import RoomShow, record_show, recordings_of, sample_show
from depth_pose.sim.simulate import START_NS

TRUNK = [JOINT_INDEX[n] for n in ("pelvis", "chest", "neck", "left_shoulder", "right_shoulder")]
SECONDS = 1.0


def sample() -> RoomShow:
    return sample_show(np.random.default_rng(3), cameras=2, seconds=SECONDS, people=2, width=96)


@pytest.fixture(scope="module")
def show() -> RoomShow:
    return sample()


@pytest.fixture(scope="module")
def recorded(show: RoomShow, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("room") / "pair.mcap"
    record_show(path, show)
    return path


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Done]:
    return caller(monkeypatch, capsys)


def test_cameras_are_unlike_and_look_from_other_sides(show: RoomShow) -> None:
    first, second = show.cameras
    assert first.sensor.family != second.sensor.family
    assert first.view.camera != second.view.camera
    assert 1.0 <= second.view.position[1] <= 2.6
    assert np.linalg.norm(first.view.position - second.view.position) > 1.0
    assert (first.first, first.clock_offset, first.clock_drift) == (0.0, 0.0, 0.0)
    assert 0 < abs(second.clock_offset) <= 0.02 and 0 < abs(second.clock_drift) <= 20e-6


def test_truth_has_the_forms_that_it_says(recorded: Path, show: RoomShow) -> None:
    truth = np.load(recorded.with_suffix(".npz"))
    T, P, M = 15, len(show.cast), 2
    assert P >= 1 and tuple(truth["names"]) == JOINTS
    assert truth["joints"].shape == (T, P, 19, 3) and truth["joints"].dtype == np.float32
    assert truth["seen"].shape == (T, P, 19) and truth["seen_by"].shape == (M, T, P, 19)
    assert truth["visible"].shape == (T, P) and truth["visible_by"].shape == (M, T, P)
    np.testing.assert_array_equal(truth["seen"], truth["seen_by"].any(axis=0))
    np.testing.assert_array_equal(truth["visible"], truth["visible_by"].max(axis=0))
    np.testing.assert_array_equal(truth["clock_offsets_s"], [c.clock_offset for c in show.cameras])
    np.testing.assert_array_equal(truth["clock_drifts"], [c.clock_drift for c in show.cameras])
    assert load_known_people(recorded.with_suffix(".npz")).joints.shape == (T, P, 19, 3)
    assert 0.0 < truth["joints"][..., 2].max() < 2.2  # z is up


def test_stamps_are_by_the_cameras_own_clocks(recorded: Path, show: RoomShow) -> None:
    truth = np.load(recorded.with_suffix(".npz"))
    for file, camera in zip(recordings_of(recorded, 2), show.cameras, strict=True):
        frames = list(read_frames(file))
        true = camera.first + np.arange(round(SECONDS * camera.fps)) / camera.fps
        wanted = true + camera.clock_offset + camera.clock_drift * true
        np.testing.assert_allclose([(f.stamp_ns - START_NS) / 1e9 for f in frames], wanted, atol=2e-9)
        assert len({f.frame_id for f in frames}) == 1
    assert frames[0].frame_id == "camera1_depth_optical_frame"
    np.testing.assert_array_equal(
        truth["stamps_ns"], [f.stamp_ns for f in read_frames(recordings_of(recorded, 2)[0])]
    )


def test_depth_of_both_cameras_lies_on_the_truth(recorded: Path, show: RoomShow) -> None:
    truth = np.load(recorded.with_suffix(".npz"))
    rig = load_rig(recorded.with_suffix(".yaml"))
    assert rig.up == "z" and [c.name for c in rig.cameras] == ["camera0", "camera1"]
    times = (truth["stamps_ns"] - START_NS) / 1e9
    for i, file in enumerate(recordings_of(recorded, 2)):
        frames = list(read_frames(file))
        assert frames[0].camera == rig.cameras[i].camera
        T_world_camera = np.linalg.inv(truth["T_camera_world"][i])
        true = show.cameras[i].times(SECONDS)
        gaps, floor = [], []
        for t in range(0, len(times), 5):
            frame = frames[int(np.abs(true - times[t]).argmin())]
            points = frame.camera.back_project(frame.depth)
            points = points[np.isfinite(points).all(axis=-1)]
            world = points @ T_world_camera[:3, :3].T + T_world_camera[:3, 3]
            floor.append(world[np.abs(world[:, 2]) < 0.15, 2])
            seen = truth["seen_by"][i, t][:, TRUNK]
            joints = truth["joints"][t][:, TRUNK][seen]
            gaps.append(np.linalg.norm(joints[:, None] - world[None], axis=-1).min(axis=1, initial=9.0))
        assert len(np.concatenate(gaps)) > 5
        assert np.concatenate(gaps).max() < 0.25
        assert abs(np.median(np.concatenate(floor))) < 0.03


def test_the_same_seed_gives_the_same_bytes(recorded: Path, tmp_path: Path) -> None:
    again = tmp_path / "pair.mcap"
    record_show(again, sample())
    files = sorted(recorded.parent.iterdir())
    assert [f.name for f in files] == ["pair.npz", "pair.yaml", "pair_0.mcap", "pair_1.mcap"]
    for file in files:
        assert (tmp_path / file.name).read_bytes() == file.read_bytes(), file.name


def test_motion_between_frames_is_between_them() -> None:
    track = Performer(np.random.default_rng(5), 10.0).perform(
        [Act("walk", 9.0, (0.0, 3.0))], (0.0, 0.0), 0.0, 20
    )
    same = track.at(np.arange(20.0))
    np.testing.assert_allclose(same.rotations, track.rotations, atol=1e-12)
    np.testing.assert_array_equal(same.spots, track.spots)
    between = track.at(np.array([4.5, 19.0, 99.0]))
    np.testing.assert_allclose(between.spots[0], track.spots[4:6].mean(axis=0))
    ahead = np.swapaxes(track.rotations[4], 1, 2) @ between.rotations[0]
    np.testing.assert_allclose(between.rotations[0] @ ahead, track.rotations[5], atol=1e-9)
    np.testing.assert_array_equal(between.spots[1:], track.spots[[-1, -1]])


def test_a_room_has_at_most_four_cameras() -> None:
    with pytest.raises(ConfigError, match="5 cameras cannot be simulated; a room has 1 to 4"):
        sample_show(np.random.default_rng(0), cameras=5)


def test_people_are_not_needed() -> None:
    show = sample_show(np.random.default_rng(1), cameras=4, seconds=0.1, people=0, width=64)
    sides = {tuple(np.round(c.view.position, 6)) for c in show.cameras}
    assert len(sides) == 4 and not show.cast and show.frames > 4


def test_the_command_records_three_cameras(tmp_path: Path, call: Callable[..., Done]) -> None:
    options = ("--room", "--people", "1", "--cameras", "3", "--seconds", "0.1", "--width", "64")
    done = call("simulate", "-o", tmp_path / "r.mcap", *options, "--clock-offset", "0.5")
    assert done.returncode == 0, done.stderr
    assert "r_2.mcap" in done.stdout and "ppm" in done.stdout
    assert (tmp_path / "r.yaml").exists()
    offsets = np.load(tmp_path / "r.npz")["clock_offsets_s"]
    assert offsets[0] == 0.0 and 0.02 < np.abs(offsets).max() <= 0.5
    assert not (tmp_path / "r.mcap").exists()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--cameras", "2"), "--cameras needs --room"),
        (("--room", "--clock-offset", "0.1"), "--clock-offset needs --cameras 2 or more"),
        (("--room", "--cameras", "9"), "--cameras"),
    ],
)
def test_wrong_options_are_refused(
    options: tuple[str, ...], says: str, tmp_path: Path, call: Callable[..., Done]
) -> None:
    done = call("simulate", "-o", tmp_path / "r.mcap", *options)
    assert done.returncode == 2 and says in done.stderr
    assert not any(tmp_path.iterdir())
