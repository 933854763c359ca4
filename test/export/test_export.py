"""Exports are read back: by readers that others wrote where there are such, by plain ones else."""

from __future__ import annotations

import csv
from dataclasses import replace
from functools import lru_cache

import bvhio
import numpy as np
import pytest

from depth_pose.body.build import BUILD_NAMES, BuildSpace
from depth_pose.cli.app import app
from depth_pose.core.camera import Camera
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.result import Skeleton
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL, matrix_to_quat, quat_to_matrix, rotation_y, slerp
from depth_pose.core.skeleton import BONES, JOINT_INDEX, JOINT_NODES, JOINTS, JointState, Source
from depth_pose.export import export_skeletons
from depth_pose.export.floor import floor_of_feet
from depth_pose.export.tracks import even, even_step_s, fill_gaps, read_tracks
from depth_pose.io.mcap_write import DepthWriter, SkeletonWriter
from depth_pose.motion.bvh import parse_bvh
from synthetic import START_NS, default_body, posed, varied

STEP_NS = 50_000_000
TURN_TO_Y_UP = np.diag([1.0, -1.0, -1.0])
CAMERA_HEIGHT = 0.9


def build_of(**parts):
    out = np.zeros(len(BUILD_NAMES), np.float32)
    for name, value in parts.items():
        out[BUILD_NAMES.index(name)] = value
    return out


BUILD = build_of(thigh=0.12, upper_arm=-0.1, shoulder_width=0.08)
SCALE = 0.95


@lru_cache
def person():
    return BuildSpace(default_body()).body(BUILD)


@lru_cache
def pose_of(i, step=0.15, turn=20.0):
    """Segment rotations (21, 3, 3) in the camera frame, and nodes (21, 3), of somebody who moves slowly."""
    calm = 1.0 + np.sin(step * i)
    rotations = varied(3, 12.0 * calm)
    shown = posed(rotations, aside=0.02 * i, turn=turn, scale=SCALE, body=person())
    return R_CAMERA_FACING_MODEL @ rotation_y(np.radians(turn)) @ rotations, shown.nodes


def skeleton_of(i, body_id="body_1", stamp_ns=None):
    rotations, nodes = pose_of(i)
    return Skeleton(
        stamp_ns=START_NS + i * STEP_NS if stamp_ns is None else stamp_ns,
        frame_id="depth_optical",
        body_id=body_id,
        source=Source.REFINED,
        confidence=float(np.float32(0.9)),
        residual=float(np.float32(0.011)),
        scale=float(np.float32(SCALE)),
        positions=nodes[JOINT_NODES],
        quats_xyzw=matrix_to_quat(rotations[JOINT_NODES]),
        joint_confidence=np.linspace(0.5, 1.0, 19, dtype=np.float32),
        joint_states=np.array([i % 3] * 19, np.uint8),
        build=BUILD,
    )


def write(path, frames):
    """Write frames, each a list of skeletons."""
    with SkeletonWriter(path) as writer:
        for i, people in enumerate(frames):
            stamp = people[0].stamp_ns if people else START_NS + i * STEP_NS
            writer.write_people(people, stamp, "depth_optical")
    return path


@pytest.fixture
def one(tmp_path):
    return write(tmp_path / "one.mcap", [[skeleton_of(i)] for i in range(30)])


@pytest.fixture
def gappy(tmp_path):
    """Two people: one is missing in frames 8 to 11, the other is there from frame 5 on."""
    frames = []
    for i in range(20):
        people = [] if 8 <= i < 12 else [skeleton_of(i, "anna")]
        frames.append(people + ([skeleton_of(i, "b/2")] if i >= 5 else []))
    return write(tmp_path / "two.mcap", frames)


def bvh_heads(path, frames):
    """Positions (T, 21, 3) by name, as a reader of others has them."""
    root = bvhio.readAsHierarchy(str(path))
    names = [joint.Name for joint, _, _ in root.layout()]
    out = []
    for frame in range(frames):
        root.loadPose(frame)
        out.append([list(joint.PositionWorld) for joint, _, _ in root.layout()])
    return names, np.array(out)


# BVH


def test_bvh_has_the_joints_where_they_were(one, tmp_path):
    result = export_skeletons(one, tmp_path / "one.bvh")
    names, heads = bvh_heads(tmp_path / "one.bvh", 30)
    (file,) = result.files
    assert (file.frames, file.rate_hz) == (30, pytest.approx(20.0))
    assert bvhio.readAsBvh(str(tmp_path / "one.bvh")).FrameTime == pytest.approx(0.05)
    for i in range(30):
        expected = skeleton_of(i).positions @ TURN_TO_Y_UP
        found = heads[i][[names.index(joint) for joint in JOINTS]]
        np.testing.assert_allclose(found, expected, atol=2e-5)


def test_bvh_bones_are_those_of_the_persons_build(one, tmp_path):
    export_skeletons(one, tmp_path / "one.bvh", unit="cm")
    names, heads = bvh_heads(tmp_path / "one.bvh", 3)
    body = person()
    for a, b in BONES:
        if JOINTS[b].endswith("shoulder"):
            continue  # hangs from the clavicle
        ends = heads[1][[names.index(JOINTS[a]), names.index(JOINTS[b])]]
        rest = body.nodes[JOINT_NODES[[a, b]]]
        length = 100 * SCALE * np.linalg.norm(rest[1] - rest[0])
        assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(length, abs=2e-3), JOINTS[b]


def test_bvh_goes_through_our_own_reader(one, tmp_path):
    """Rotations too: the file's are those of the segments."""
    export_skeletons(one, tmp_path / "one.bvh")
    motion = parse_bvh(tmp_path / "one.bvh")
    thigh = motion.joints.index("left_hip")
    for i in (0, 13, 29):
        expected = TURN_TO_Y_UP @ quat_to_matrix(skeleton_of(i).quats_xyzw[JOINT_INDEX["left_hip"]])
        np.testing.assert_allclose(motion.rotations[i, thigh], expected, atol=1e-4)


def test_bvh_of_two_people_are_two_files_that_begin_when_they_come(gappy, tmp_path):
    result = export_skeletons(gappy, tmp_path / "two.bvh")
    assert [file.path.name for file in result.files] == ["two_anna.bvh", "two_b_2.bvh"]
    assert [file.frames for file in result.files] == [20, 15]
    assert [track.gaps() for file in result.files for track in file.tracks] == [[(8, 12)], []]
    assert (result.files[1].tracks[0].stamps_ns[0] - result.files[1].start_ns) == 5 * STEP_NS


def test_gaps_are_held_or_bridged(gappy, tmp_path):
    export_skeletons(gappy, tmp_path / "held.bvh", people=["anna"])
    names, heads = bvh_heads(tmp_path / "held.bvh", 20)
    np.testing.assert_allclose(heads[8:12], np.broadcast_to(heads[7], (4, *heads[7].shape)), atol=1e-6)
    export_skeletons(gappy, tmp_path / "filled.bvh", people=["anna"], fill=True)
    names, heads = bvh_heads(tmp_path / "filled.bvh", 20)
    pelvis = heads[:, names.index("pelvis")]
    share = np.arange(1, 5)[:, None] / 5
    np.testing.assert_allclose(pelvis[8:12], pelvis[7] + share * (pelvis[12] - pelvis[7]), atol=1e-5)


# TRC, read as its definition says


def read_trc(path):
    lines = path.read_text().split("\n")
    assert lines[0].split("\t")[:3] == ["PathFileType", "4", "(X/Y/Z)"]
    facts = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=True))
    markers = lines[3].split("\t")[2::3]
    rows = np.array([[float(v) for v in line.split("\t")] for line in lines[6:] if line])
    return facts, markers, rows[:, 0], rows[:, 1], rows[:, 2:].reshape(len(rows), -1, 3)


def test_trc_is_read_back(one, tmp_path):
    export_skeletons(one, tmp_path / "one.trc")
    facts, markers, numbers, times, points = read_trc(tmp_path / "one.trc")
    assert (facts["NumFrames"], facts["NumMarkers"], facts["Units"]) == ("30", "19", "mm")
    assert float(facts["DataRate"]) == pytest.approx(20.0)
    assert tuple(markers) == JOINTS
    np.testing.assert_array_equal(numbers, np.arange(1, 31))
    np.testing.assert_allclose(times, np.arange(30) * 0.05, atol=1e-6)
    for i in (0, 29):
        np.testing.assert_allclose(points[i], 1e3 * skeleton_of(i).positions @ TURN_TO_Y_UP, atol=1e-5)


def test_trc_says_nan_in_gaps(gappy, tmp_path):
    export_skeletons(gappy, tmp_path / "two.trc", people=["anna"], unit="m")
    _, _, _, _, points = read_trc(tmp_path / "two.trc")
    missing = np.isnan(points).all(axis=(1, 2))
    np.testing.assert_array_equal(np.flatnonzero(missing), [8, 9, 10, 11])
    assert np.isfinite(points[~missing]).all()


# CSV and NPZ


def test_csv_is_read_back_to_the_last_bit(gappy, tmp_path):
    export_skeletons(gappy, tmp_path / "two.csv")
    with (tmp_path / "two.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == (16 + 15) * 19
    assert [int(r["frame"]) for r in rows] == sorted(int(r["frame"]) for r in rows)
    by_key = {(int(r["frame"]), r["body_id"], r["joint"]): r for r in rows}
    for i, who in ((7, "anna"), (12, "anna"), (9, "b/2")):
        expected = skeleton_of(i, who)
        for j, name in enumerate(JOINTS):
            row = by_key[i, who, name]
            assert [float(row[c]) for c in "xyz"] == expected.positions[j].tolist()
            assert [float(row[c]) for c in ("qx", "qy", "qz", "qw")] == expected.quats_xyzw[j].tolist()
            assert np.float32(row["joint_confidence"]) == expected.joint_confidence[j]
            assert row["joint_state"] == JointState(i % 3).name
            assert int(row["stamp_ns"]) == expected.stamp_ns
            assert float(row["time_s"]) == pytest.approx(i * 0.05)
    assert (8, "anna", "pelvis") not in by_key


def test_npz_is_read_back_to_the_last_bit(gappy, tmp_path):
    export_skeletons(gappy, tmp_path / "two.npz")
    data = np.load(tmp_path / "two.npz")
    assert data["body_ids"].tolist() == ["anna", "b/2"]
    assert tuple(data["joints"]) == JOINTS
    assert data["positions"].shape == (20, 2, 19, 3)
    assert str(data["frame_id"]) == "depth_optical"
    np.testing.assert_array_equal(np.flatnonzero(~data["present"][:, 0]), [8, 9, 10, 11])
    np.testing.assert_array_equal(np.flatnonzero(~data["present"][:, 1]), range(5))
    for i in (7, 12):
        expected = skeleton_of(i)
        for name in ("positions", "quats_xyzw", "joint_confidence", "joint_states", "build"):
            np.testing.assert_array_equal(data[name][i, 0], getattr(expected, name))
    assert np.isnan(data["positions"][9, 0]).all()
    assert (data["joint_states"][9, 0] == JointState.LOST).all()


def test_filled_frames_say_that_they_are(gappy, tmp_path):
    export_skeletons(gappy, tmp_path / "two.npz", fill=True)
    data = np.load(tmp_path / "two.npz")
    assert data["present"][:, 0].all()
    assert (data["source"][8:12, 0] == Source.LOST).all()
    assert (data["joint_confidence"][8:12, 0] == 0).all()
    assert np.isfinite(data["positions"][:, 0]).all()
    assert not data["present"][:5, 1].any(), "nobody is made up before they came"


# Time


def test_missing_and_uneven_frames_become_an_even_rate(tmp_path):
    """A frame that the sensor left out is a gap; jitter is not, and moves nothing but time."""
    jitter = np.random.default_rng(0).integers(-3_000_000, 3_000_000, 20)
    jitter[[0, -1]] = 0
    frames = [[skeleton_of(i, stamp_ns=START_NS + i * STEP_NS + int(jitter[i]))] for i in range(20) if i != 9]
    tracks = read_tracks(write(tmp_path / "jitter.mcap", frames))
    step = even_step_s(tracks.stamps_ns)
    assert step == pytest.approx(0.05)
    track = even(tracks.people[0], step)
    assert len(track) == 20
    assert track.gaps() == [(9, 10)]
    for i in (5, 15):
        at = np.interp(START_NS + i * STEP_NS, *pelvis_x(tracks.people[0]))
        assert track.positions[i, 0, 0] == pytest.approx(at, abs=5e-4)  # a millisecond counts as none


def pelvis_x(track):
    return track.stamps_ns.astype(float), track.positions[:, 0, 0]


def test_slerp_halves_the_angle():
    a, b = np.array([0.0, 0, 0, 1]), np.array([0, np.sin(0.4), 0, np.cos(0.4)])
    middle = slerp(a, -b, np.array(0.5))
    np.testing.assert_allclose(middle, [0, np.sin(0.2), 0, np.cos(0.2)], atol=1e-12)


def test_bridged_segments_turn_evenly(gappy):
    filled = fill_gaps(read_tracks(gappy).people[0])
    angles = [
        np.degrees(2 * np.arccos(min(1.0, abs(filled.quats_xyzw[i, 6] @ filled.quats_xyzw[i + 1, 6]))))
        for i in range(7, 12)
    ]
    assert np.ptp(angles) < 1e-3
    assert min(angles) > 0.05


# The floor


def standing(path, count=20):
    """Somebody who walks over the floor in small steps, upright."""
    frames = []
    for i in range(count):
        shown = posed(varied(1, 2.0), aside=0.05 * i - 0.5, distance=3.0 + 0.03 * i, height=CAMERA_HEIGHT)
        frames.append([replace(skeleton_of(i), positions=shown.nodes[JOINT_NODES], scale=1.0)])
    return write(path, frames)


def tilted_room(path, pitch_deg, wall=True):
    """Depth images (3, 144, 176) of a floor and a wall, from a camera that looks down by ``pitch_deg``."""
    camera = Camera(176, 144, 190.0, 190.0, 87.5, 71.5)
    u, v = np.meshgrid(np.arange(176), np.arange(144))
    rays = np.stack([(u - 87.5) / 190.0, (v - 71.5) / 190.0, np.ones_like(u, float)], axis=-1)
    pitch = np.radians(pitch_deg)
    down = np.array([0.0, np.cos(pitch), np.sin(pitch)])
    ahead = np.array([0.0, -np.sin(pitch), np.cos(pitch)])
    with np.errstate(divide="ignore"):
        floor = np.where(rays @ down > 0, CAMERA_HEIGHT / (rays @ down), np.inf)
        back = np.where(rays @ ahead > 0, 5.0 / (rays @ ahead), np.inf) if wall else np.inf
    rng = np.random.default_rng(4)
    with DepthWriter(path, camera, "depth_optical") as writer:
        for i in range(3):
            depth = np.minimum(floor, back) * (1 + 0.004 * rng.normal(size=floor.shape))
            writer.write(START_NS + i * STEP_NS, np.where(depth < 8, depth, 0).astype(np.float32))
    return path


def test_feet_that_no_sensor_saw_are_no_floor(tmp_path):
    (track,) = read_tracks(standing(tmp_path / "walk.mcap")).people
    far = replace(track, positions=track.positions * 1e30)
    with pytest.raises(InputError, match="farther than 100 m"):
        floor_of_feet([far])


def test_feet_tell_the_floor(tmp_path):
    floor = floor_of_feet(read_tracks(standing(tmp_path / "walk.mcap")).people)
    assert floor.height == pytest.approx(CAMERA_HEIGHT, abs=0.06)
    assert np.degrees(np.arccos(-floor.up[1])) < 4.0


def test_depth_tells_the_floor_exactly(tmp_path):
    walk, room = standing(tmp_path / "walk.mcap"), tilted_room(tmp_path / "room.mcap", 3.0)
    result = export_skeletons(walk, tmp_path / "walk.npz", world="floor", recording=room)
    assert result.floor.source == "depth images"
    assert result.floor.height == pytest.approx(CAMERA_HEIGHT, abs=0.01)
    down = np.array([0.0, np.cos(np.radians(3.0)), np.sin(np.radians(3.0))])
    assert np.degrees(np.arccos(-result.floor.up @ down)) < 0.3
    data = np.load(tmp_path / "walk.npz")
    assert str(data["frame_id"]) == "floor"
    back = (data["positions"][:, 0] - data["T_world_camera"][:3, 3]) @ data["T_world_camera"][:3, :3]
    np.testing.assert_allclose(back, [f.positions[0] for f in read_tracks_frames(walk)], atol=1e-12)


def read_tracks_frames(path):
    track = read_tracks(path).people[0]
    return [replace(track, positions=track.positions[i : i + 1]) for i in range(len(track))]


def test_the_floor_world_has_z_up_x_forward_y_left(tmp_path):
    """The camera is level here: a step to the image's right is -y, away from the sensor is +x."""
    walk = standing(tmp_path / "walk.mcap")
    room = tilted_room(tmp_path / "room.mcap", 0.0)
    export_skeletons(walk, tmp_path / "walk.npz", world="floor", recording=room)
    pelvis = np.load(tmp_path / "walk.npz")["positions"][:, 0, 0]
    camera = read_tracks(walk).people[0].positions[:, 0]
    np.testing.assert_allclose(pelvis[:, 0], camera[:, 2], atol=0.03)
    np.testing.assert_allclose(pelvis[:, 1], -camera[:, 0], atol=0.03)
    np.testing.assert_allclose(pelvis[:, 2], CAMERA_HEIGHT - camera[:, 1], atol=0.03)
    export_skeletons(walk, tmp_path / "walk.bvh", world="floor", recording=room)
    names, heads = bvh_heads(tmp_path / "walk.bvh", 20)
    bvh = heads[:, names.index("pelvis")]
    np.testing.assert_allclose(np.stack([bvh[:, 0], -bvh[:, 2], bvh[:, 1]], 1), pelvis, atol=1e-5)


def test_a_room_without_floor_in_view_leaves_it_to_the_feet(tmp_path):
    walk, room = standing(tmp_path / "walk.mcap"), tilted_room(tmp_path / "room.mcap", -40.0)
    result = export_skeletons(walk, tmp_path / "walk.npz", world="floor", recording=room)
    assert result.floor.source == "feet"


# What goes wrong


def test_wrong_wishes_are_refused(one, tmp_path):
    with pytest.raises(ConfigError, match=r"\.bvh, \.trc, \.c3d, \.mot, \.sto, \.csv, \.json, \.npz"):
        export_skeletons(one, tmp_path / "one.fbx")
    with pytest.raises(ConfigError, match="camera or floor"):
        export_skeletons(one, tmp_path / "one.bvh", world="moon")
    with pytest.raises(ConfigError, match="metres"):
        export_skeletons(one, tmp_path / "one.csv", unit="mm")
    with pytest.raises(InputError, match="body_1"):
        export_skeletons(one, tmp_path / "one.bvh", people=["somebody"])
    nobody = write(tmp_path / "nobody.mcap", [[], []])
    with pytest.raises(InputError, match="nobody in 2 frames"):
        export_skeletons(nobody, tmp_path / "nobody.csv")
    assert [p.name for p in tmp_path.glob("one.*")] == ["one.mcap"]


def test_a_file_that_cannot_be_written_is_said(one, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        export_skeletons(one, tmp_path / "file" / "one.csv")


def test_the_command_tells_of_gaps(gappy, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    app(["export", str(gappy), "-o", str(tmp_path / "two.bvh")], standalone_mode=False)
    said = capsys.readouterr().out
    assert "anna: 16 frames, 0.95 s from second 0.00, frame 1, on" in said
    assert "held 1 gap: 0.35 to 0.60 s" in said
    assert "b/2: 15 frames, 0.70 s from second 0.25, frame 6, on" in said
