import numpy as np
import pytest

from depth_pose.bank.sources import NEAR_DUPLICATE_M, gather_poses
from depth_pose.core.errors import InputError
from depth_pose.motion.clip import joint_positions, mirror_joints
from depth_pose.motion.procedural.generator import make_clip
from motion_writers import MIXAMO, write_bvh


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("library")
    for i, name in enumerate(("walk", "kick")):
        write_bvh(made / f"{name}_{i}.bvh", make_clip(name, 15.0, 2.0, seed=i), MIXAMO)
    (made / "damaged.bvh").write_text("HIERARCHY\nROOT")
    return made


def test_recorded_alone(folder):
    told = []
    found = gather_poses(None, 1, folder, embedded=False, progress=told.append)
    assert set(found.poses.families) == {"walk", "kick"}
    assert found.header["families"] == {
        n: found.poses.families.count(n) for n in sorted(set(found.poses.families))
    }
    assert "2 of 3 files" in found.header["mocap"]
    assert str(folder) not in found.header["mocap"]  # nothing about where the user keeps it
    refused = [r for r in found.reports if r.refused]
    assert [r.path.name for r in refused] == ["damaged.bvh"]
    assert told[-1] == pytest.approx(1.0)
    joints = joint_positions(found.poses.rotations)
    gaps = np.sqrt(np.square(joints[:, None] - joints[None]).sum(-1).mean(-1))
    assert gaps[~np.eye(len(joints), dtype=bool)].min() > 0.99 * NEAR_DUPLICATE_M
    mirrored = mirror_joints(joints)
    to_mirror = np.sqrt(np.square(mirrored[:, None] - joints[None]).sum(-1).mean(-1)).min(axis=1)
    assert to_mirror.max() < 1.01 * NEAR_DUPLICATE_M  # every pose's mirror image is there


def test_union_and_limit(folder):
    found = gather_poses(20, 1, folder, embedded=True)
    assert set(found.header) == {"embedded", "mocap", "families"}
    assert 30 <= len(found.poses) <= 40
    assert found.header["embedded"] == "20 poses, seed 1"


def test_embedded_alone():
    found = gather_poses(None, 3, embedded_count=30)
    assert len(found.poses) == 30
    assert found.reports == ()
    assert "mocap" not in found.header


def test_no_motion_there(tmp_path):
    with pytest.raises(InputError, match="holds no motion"):
        gather_poses(None, 1, tmp_path, embedded=False)
