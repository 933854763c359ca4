"""Recorded motion on our skeleton: conventions, refusals, and real files where there are some."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from depth_pose.body.joint_names import find_joints, split_name
from depth_pose.core.errors import InputError
from depth_pose.core.rotations import rotvec_to_matrix
from depth_pose.core.skeleton import ADULT_STATURE_M, NODE_INDEX, forward_kinematics, rest_nodes
from depth_pose.motion.asf_amc import parse_asf_amc, read_asf_amc
from depth_pose.motion.bvh import parse_bvh, read_bvh
from depth_pose.motion.clip import Clip, joint_positions
from depth_pose.motion.motion_files import family_of, load_motion_dir
from depth_pose.motion.procedural.generator import make_clip
from depth_pose.motion.retarget import retarget
from motion_writers import BANDAI, BIOVISION, MIXAMO, write_asf_amc, write_bvh

MOCAP = next(
    (p / "shared/data/mocap" for p in Path(__file__).resolve().parents if (p / "shared/data/mocap").is_dir()),
    None,
)
Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
FACING_X = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])


@pytest.fixture(scope="module")
def clip() -> Clip:
    return make_clip("signals", 15.0, 3.0, seed=2)


@pytest.mark.parametrize(
    ("names", "style", "order", "unit", "axes", "unit_name"),
    [
        (MIXAMO, "mixamorig:{Side}{part}", "ZXY", 0.01, None, "centimetres"),
        (BANDAI, "{part}_{S}", "XYZ", 0.01, FACING_X, "centimetres"),
        (BIOVISION, "{Side}{part}", "YXZ", 0.0254, None, "inches"),
        (BANDAI, "{s}_{part}", "ZYX", 1.0, Z_UP, "metres"),
    ],
)
def test_every_convention_gives_the_motion_back(
    tmp_path, clip, names, style, order, unit, axes, unit_name
) -> None:
    path = write_bvh(tmp_path / "a.bvh", clip, names, style, order, unit, axes)
    moved = retarget(parse_bvh(path))
    assert moved.unit == unit_name
    assert moved.clip.fps == pytest.approx(clip.fps, rel=1e-4)
    error = np.linalg.norm(
        moved.clip.nodes() - moved.clip.roots[:, None] - clip.nodes() + clip.roots[:, None], axis=-1
    )
    assert error.max() < 0.003
    assert moved.violation_deg.max() < 12.0


def test_path_and_height_follow_the_recording(tmp_path) -> None:
    clip = make_clip("jump", 30.0, 4.0, seed=1)
    read = read_bvh(write_bvh(tmp_path / "jump.bvh", clip, unit=0.0254))
    moved = clip.roots - clip.roots[0]
    assert np.abs((read.roots - read.roots[0])[:, [0, 2]] - moved[:, [0, 2]]).max() < 0.05
    assert np.corrcoef(read.roots[:, 1], clip.roots[:, 1])[0, 1] > 0.97


def test_bone_lengths_stay_the_bodys_own(tmp_path, clip) -> None:
    read = read_bvh(write_bvh(tmp_path / "a.bvh", clip))
    at, rest = read.nodes(), rest_nodes() * ADULT_STATURE_M
    for a, b in (("left_hip", "left_knee"), ("right_elbow", "right_wrist"), ("chest", "neck")):
        i, j = NODE_INDEX[a], NODE_INDEX[b]
        np.testing.assert_allclose(
            np.linalg.norm(at[:, j] - at[:, i], axis=1), np.linalg.norm(rest[j] - rest[i])
        )


def test_a_taller_person_gives_the_same_pose(tmp_path, clip) -> None:
    """The size of the recorded person does not matter, only directions do."""
    big = read_bvh(write_bvh(tmp_path / "big.bvh", clip, unit=0.0085))
    own = read_bvh(write_bvh(tmp_path / "own.bvh", clip, unit=0.01))
    np.testing.assert_allclose(big.rotations, own.rotations, atol=1e-5)
    np.testing.assert_allclose(big.roots[:, 1], own.roots[:, 1], atol=0.002)


def test_acclaim_files_give_the_motion_back(tmp_path, clip) -> None:
    asf, amc = write_asf_amc(tmp_path, clip)
    source = parse_asf_amc(asf, amc)
    wrist = source.positions()[:, source.joints.index("lwrist")] * 0.0254
    np.testing.assert_allclose(wrist, clip.nodes()[:, NODE_INDEX["left_wrist"]], atol=1e-4)
    read = read_asf_amc(asf, amc)
    error = np.linalg.norm(read.nodes() - read.roots[:, None] - clip.nodes() + clip.roots[:, None], axis=-1)
    assert error.max() < 0.003


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [("dof rx ry rz", "dof rx ry", "is not of this skeleton"), ("length", "lenght x\n     length", "")],
)
def test_acclaim_files_that_do_not_fit(tmp_path, clip, old, new, said) -> None:
    asf, amc = write_asf_amc(tmp_path, clip)
    asf.write_text(asf.read_text().replace(old, new, 1))
    if said:
        with pytest.raises(InputError, match=said):
            parse_asf_amc(asf, amc)
    else:
        parse_asf_amc(asf, amc)  # an unknown keyword is no reason to refuse


def test_hips_in_one_place_are_no_person(tmp_path, clip) -> None:
    path = write_bvh(tmp_path / "a.bvh", clip, MIXAMO, "mixamorig:{Side}{part}", "ZXY", 0.01, None)
    source = parse_bvh(path)
    joint, offsets = find_joints(source), source.offsets.copy()
    offsets[joint["left_hip"]] = offsets[joint["right_hip"]]
    with pytest.raises(InputError, match="not a standing person"):
        retarget(replace(source, offsets=offsets))


def test_cut_off_motion_is_refused(tmp_path, clip) -> None:
    asf, amc = write_asf_amc(tmp_path, clip)
    amc.write_text("\n".join(amc.read_text().splitlines()[:-3]))
    with pytest.raises(InputError, match="cut off or damaged"):
        parse_asf_amc(asf, amc)


@pytest.mark.parametrize(
    ("name", "side", "bare"),
    [
        ("LeftForeArm", "left", "forearm"),
        ("mixamorig:RightUpLeg", "right", "upleg"),
        ("Hand_L", "left", "hand"),
        ("r_foot", "right", "foot"),
        ("lradius", "left", "radius"),
        ("lowerback", "", "lowerback"),
        ("LHipJoint", "", "lhipjoint"),
        ("RightToeBase", "right", "toebase"),
        ("root", "", "root"),
    ],
)
def test_names_split_into_side_and_part(name, side, bare) -> None:
    assert split_name(name) == (side, bare)


def test_a_folder_is_accounted_for_file_by_file(tmp_path, clip) -> None:
    write_bvh(tmp_path / "wave_1.bvh", clip)
    write_bvh(tmp_path / "wave_2.bvh", clip.mirrored())
    (tmp_path / "broken.bvh").write_text("HIERARCHY\nROOT x\n{\n")
    (tmp_path / "notes.txt").write_text("not motion")
    (tmp_path / "acclaim").mkdir()
    write_asf_amc(tmp_path / "acclaim", clip)
    seen = []
    loaded = load_motion_dir(tmp_path, progress=seen.append)
    assert [r.path.name for r in loaded.reports] == ["07_01.amc", "broken.bvh", "wave_1.bvh", "wave_2.bvh"]
    assert [r.refused for r in loaded.reports] == [False, True, False, False]
    assert "broken.bvh: refused: " in loaded.summary() and "MOTION" in loaded.reports[1].note
    assert seen[-1] == 1.0
    everything, thinned = loaded.poses(mirrored=True), loaded.poses(distance_m=0.02, mirrored=True)
    assert len(everything) == 2 * sum(r.frames for r in loaded.reports)
    # The second clip mirrors the first, the third repeats it at another rate: thinning finds that.
    assert len(thinned) <= len(everything) / 3
    assert set(everything.families) == {"07", "wave"}
    assert family_of("walking_12") == "walking" and family_of("12") == "12"


def test_calibration_pose_before_the_motion_is_left_out(tmp_path, clip) -> None:
    t_pose = np.tile(np.eye(3), (1, 21, 1, 1))
    start = clip.roots[:1]
    with_t = Clip(
        "t", clip.fps, np.concatenate([t_pose, clip.rotations]), np.concatenate([start, clip.roots])
    )
    write_bvh(tmp_path / "t.bvh", with_t)
    loaded = load_motion_dir(tmp_path)
    assert len(loaded.clips[0]) == len(clip)
    assert "calibration" in loaded.reports[0].note


def test_nothing_usable_is_an_error(tmp_path) -> None:
    with pytest.raises(InputError, match="no such file"):
        load_motion_dir(tmp_path / "none")
    with pytest.raises(InputError, match="holds no motion"):
        load_motion_dir(tmp_path)
    (tmp_path / "a.bvh").write_text("hello")
    with pytest.raises(InputError, match=r"none of its 1 files"):
        load_motion_dir(tmp_path)


@pytest.mark.skipif(MOCAP is None, reason="needs ../shared/data/mocap, which is not in the project")
def test_recorded_people_keep_hands_and_feet_where_they_are() -> None:
    assert MOCAP is not None
    rest = rest_nodes() * ADULT_STATURE_M
    for name in ("walking_1", "basketball_signal_2", "soccer_1", "jumping_1"):
        source = parse_bvh(MOCAP / f"{name}.bvh")
        joint, place = find_joints(source), source.positions()
        clip = retarget(source).clip
        ours = forward_kinematics(clip.rotations, np.zeros(3), rest)
        for side in ("left", "right"):
            for chain in (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle")):
                for a, b in pairwise(chain):
                    theirs = place[:, joint[f"{side}_{b}"]] - place[:, joint[f"{side}_{a}"]]
                    mine = ours[:, NODE_INDEX[f"{side}_{b}"]] - ours[:, NODE_INDEX[f"{side}_{a}"]]
                    mine /= np.linalg.norm(mine, axis=1, keepdims=True)
                    theirs /= np.linalg.norm(theirs, axis=1, keepdims=True)
                    # The file's world is the model's: y up, rest pose facing z.
                    assert np.degrees(np.arccos(np.clip((mine * theirs).sum(1), -1, 1))).max() < 0.1
        trunk = (
            place[:, joint["left_shoulder"]]
            + place[:, joint["right_shoulder"]]
            - 2 * place[:, joint["pelvis"]]
        )
        own = ours[:, NODE_INDEX["left_shoulder"]] + ours[:, NODE_INDEX["right_shoulder"]]
        cosine = (trunk * own).sum(1) / np.linalg.norm(trunk, axis=1) / np.linalg.norm(own, axis=1)
        assert np.degrees(np.arccos(cosine)).mean() < 8


@pytest.mark.skipif(MOCAP is None, reason="needs ../shared/data/mocap, which is not in the project")
def test_recorded_motion_lies_within_the_joint_limits() -> None:
    assert MOCAP is not None
    far = np.concatenate(
        [
            retarget(parse_bvh(MOCAP / f"{n}.bvh")).violation_deg
            for n in ("walking_1", "running_1", "basketball_1")
        ]
    )
    assert np.mean(far < 15) > 0.9
    assert np.isfinite(joint_positions(read_bvh(MOCAP / "walking_1.bvh").rotations)).all()


@pytest.mark.parametrize("axis", [0, 2])
def test_who_lies_is_not_bent_beyond_what_joints_can(tmp_path, clip, axis) -> None:
    """Joints have limits, the way that the pelvis lies in the world has none."""
    count = len(clip.rotations)
    angle = np.where(np.arange(count) <= count // 2, 0.0, np.radians(95.0))
    turn = rotvec_to_matrix(angle[:, None] * np.eye(3)[axis])
    lying = replace(clip, rotations=turn[:, None] @ clip.rotations)
    moved = retarget(parse_bvh(write_bvh(tmp_path / "a.bvh", lying)))
    assert moved.violation_deg.max() < 12.0


def test_a_motion_whose_legs_hang_on_nothing_common_is_refused(tmp_path, clip) -> None:
    source = parse_bvh(write_bvh(tmp_path / "a.bvh", clip))
    found = find_joints(source)
    parents = source.parents.copy()
    parents[found["left_hip"]] = -1
    with pytest.raises(InputError, match="no common joint"):
        find_joints(replace(source, parents=parents))
