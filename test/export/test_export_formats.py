"""C3D, OpenSim's files, JSON and tables of angles are read back."""

from __future__ import annotations

import json
import warnings

import numpy as np
import pandas
import pytest

from depth_pose.body.angle_definitions import JOINT_ANGLES
from depth_pose.body.angles import rotations_from_angles
from depth_pose.core.errors import ConfigError
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL, matrix_to_quat, quat_to_matrix, rotation_y
from depth_pose.core.skeleton import JOINT_NODES, JOINTS
from depth_pose.detect.floor import Floor
from depth_pose.export import export_skeletons
from depth_pose.export.bvh import bvh_text
from depth_pose.export.tracks import held, read_tracks
from depth_pose.io.mcap_write import SkeletonWriter
from depth_pose.offline import FLOOR
from postures import nodes_of, posture
from skeletons import make_skeleton

STEP_NS = 40_000_000
HEIGHT_M = 1.2
COUNT = 20
GIVEN = {"left_hip_flexion": 35, "right_knee_flexion": 60, "left_elbow_flexion": 70}
GIVEN |= {"right_hip_abduction": 12}
ABSENT = (8, 9)


def skeleton_of(i, turn_deg=30.0, **values):
    """Somebody whose left knee bends more in each frame, before a level camera."""
    angles = posture(left_knee_flexion=10.0 + 2 * i, **GIVEN)
    R = R_CAMERA_FACING_MODEL @ rotation_y(np.radians(turn_deg))
    return make_skeleton(
        nodes_of(angles)[JOINT_NODES] @ R.T + [0.02 * i, 0.3, 3.0],
        quats_xyzw=matrix_to_quat(R @ rotations_from_angles(angles)[JOINT_NODES]),
        stamp_ns=1_000_000_000 + i * STEP_NS,
        body_id="anna",
        **values,
    )


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """One person, who is missing in two frames; the floor is recorded."""
    path = tmp_path_factory.mktemp("formats") / "one.mcap"
    with SkeletonWriter(path) as writer:
        for i in range(COUNT):
            people = [] if i in ABSENT else [skeleton_of(i)]
            writer.write_people(people, 1_000_000_000 + i * STEP_NS, "optical")
        writer.write_metadata(FLOOR, Floor(np.array([0.0, -1.0, 0.0]), HEIGHT_M).to_metadata())
    return path


def expected_y_up(i):
    """Joints on the floor, x forward, y up, z to the right."""
    x, y, z = skeleton_of(i).positions.T
    return np.stack([z, HEIGHT_M - y, x], axis=1)


def test_c3d_is_read_by_another_library(recording, tmp_path):
    ezc3d = pytest.importorskip("ezc3d", reason="ezc3d has no wheel for this machine")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        export_skeletons(recording, tmp_path / "one.c3d", world="floor")
    file = ezc3d.c3d(str(tmp_path / "one.c3d"))
    point = file["parameters"]["POINT"]
    assert tuple(point["LABELS"]["value"]) == JOINTS
    assert point["UNITS"]["value"] == ["mm"] and point["RATE"]["value"][0] == pytest.approx(25.0)
    points = file["data"]["points"][:3].transpose(2, 1, 0)
    assert np.flatnonzero(np.isnan(points).any(axis=(1, 2))).tolist() == list(ABSENT)
    for i in (0, 5, COUNT - 1):
        np.testing.assert_allclose(points[i], 1e3 * expected_y_up(i), atol=0.01)


def read_table(path):
    """Header, and the table as pandas reads it."""
    lines = path.read_text().splitlines()
    end = lines.index("endheader")
    return lines[:end], pandas.read_csv(path, sep="\t", skiprows=end + 1)


def test_mot_has_opensims_coordinates(recording, tmp_path):
    export_skeletons(recording, tmp_path / "one.mot", world="floor")
    head, table = read_table(tmp_path / "one.mot")
    assert head == ["one", "version=1", f"nRows={COUNT}", f"nColumns={len(table.columns)}", "inDegrees=yes"]
    np.testing.assert_allclose(table["time"], np.arange(COUNT) * 0.04, atol=1e-6)
    assert np.flatnonzero(table["knee_angle_l"].isna()).tolist() == list(ABSENT)
    seen = table.drop(index=list(ABSENT))
    np.testing.assert_allclose(seen["knee_angle_l"], 10.0 + 2 * seen.index.to_numpy(), atol=1.0)
    known = {"hip_flexion_l": 35, "knee_angle_r": 60, "elbow_flex_l": 70, "hip_adduction_r": -12}
    for name, value in known.items():
        np.testing.assert_allclose(seen[name], value, atol=1.5, err_msg=name)
    for name in ("pelvis_tilt", "pelvis_list", "lumbar_extension", "hip_flexion_r"):
        np.testing.assert_allclose(seen[name], 0.0, atol=2.0, err_msg=name)
    np.testing.assert_allclose(seen["pelvis_ty"], HEIGHT_M - 0.3, atol=1e-5)
    # who faces the camera looks along -x; turned 30 degrees to the own left, seen from above
    np.testing.assert_allclose(np.abs(seen["pelvis_rotation"]), 150.0, atol=0.1)
    export_skeletons(recording, tmp_path / "filled.mot", world="floor", fill=True)
    assert not read_table(tmp_path / "filled.mot")[1].isna().any().any()


def test_mot_leaves_out_what_is_never_measured(tmp_path):
    path = tmp_path / "straight.mcap"
    with SkeletonWriter(path) as writer:
        for i in range(3):
            confidence = np.ones(19, np.float32)
            confidence[JOINTS.index("right_wrist")] = 0.1
            skeleton = skeleton_of(i, joint_confidence=confidence)
            writer.write_people([skeleton], skeleton.stamp_ns, "optical")
        writer.write_metadata(FLOOR, Floor(np.array([0.0, -1.0, 0.0]), HEIGHT_M).to_metadata())
    export_skeletons(path, tmp_path / "a.mot", world="floor")
    _, table = read_table(tmp_path / "a.mot")
    assert "elbow_flex_r" not in table and "elbow_flex_l" in table
    assert "arm_rot_r" not in table and "arm_rot_l" in table
    with pytest.raises(ConfigError, match="--world floor"):
        export_skeletons(path, tmp_path / "a.mot")


def test_sto_has_the_segments_rotations(recording, tmp_path):
    export_skeletons(recording, tmp_path / "one.sto", world="floor")
    head, table = read_table(tmp_path / "one.sto")
    assert "DataType=Quaternion" in head and "DataRate=25.000000" in head
    assert len(table) == COUNT - len(ABSENT)
    w, x, y, z = (float(v) for v in table["femur_l_imu"][3].split(","))
    to_world = np.array([[0.0, 0, 1], [0, -1, 0], [1, 0, 0]])
    expected = to_world @ quat_to_matrix(skeleton_of(3).quats_xyzw[JOINTS.index("left_hip")])
    np.testing.assert_allclose(quat_to_matrix(np.array([x, y, z, w])), expected, atol=1e-6)


def test_json_is_plain_and_whole(recording, tmp_path):
    export_skeletons(recording, tmp_path / "one.json")

    def no_constants(name):
        raise AssertionError(name)

    data = json.loads((tmp_path / "one.json").read_text(), parse_constant=no_constants)
    assert tuple(data["joints"]) == JOINTS and tuple(data["angles"]) == JOINT_ANGLES
    assert len(data["frames"]) == COUNT
    assert [i for i, frame in enumerate(data["frames"]) if not frame["people"]] == list(ABSENT)
    (person,) = data["frames"][4]["people"]
    assert person["body_id"] == "anna"
    np.testing.assert_array_equal(person["positions"], skeleton_of(4).positions)
    angles = dict(zip(data["angles"], person["angles_deg"], strict=True))
    assert angles["left_knee_flexion"] == pytest.approx(18.0, abs=1.0)
    assert angles["trunk_flexion"] is None  # where up is, is not known


def test_angles_are_columns(recording, tmp_path):
    export_skeletons(recording, tmp_path / "a.csv", world="floor", angles=True)
    table = pandas.read_csv(tmp_path / "a.csv")
    assert len(table) == COUNT - len(ABSENT)
    assert list(table.columns[4:8]) == ["trunk_flexion", "trunk_flexion_sd", "trunk_side", "trunk_side_sd"]
    np.testing.assert_allclose(table["left_knee_flexion"], 10.0 + 2 * table["frame"], atol=1.0)
    assert (table["left_knee_flexion_sd"] < 10).all()
    assert table["right_shoulder_rotation"].isna().all()
    export_skeletons(recording, tmp_path / "a.npz", world="floor")
    data = np.load(tmp_path / "a.npz")
    column = data["angle_names"].tolist().index("left_knee_flexion")
    seen = data["present"][:, 0]
    np.testing.assert_allclose(data["angles_deg"][seen, 0, column], table["left_knee_flexion"], atol=1e-3)
    assert np.isinf(data["angle_deviations_deg"][~seen]).all()
    with pytest.raises(ConfigError, match="--angles is for"):
        export_skeletons(recording, tmp_path / "a.json", angles=True)


def test_bvh_is_silent_where_two_axes_meet(recording):
    """A limb turned by 90 degrees about x: the three angles are not unique, and any of them will do."""
    (track,) = read_tracks(recording).people
    track.quats_xyzw[:, 0] = [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        text = bvh_text(held(track), 0.04)
    assert "nan" not in text
