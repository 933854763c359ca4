"""Recordings of skeletons that nobody means: refused in one line, or written whole; nothing goes unsaid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_export import skeleton_of

from depth_pose.core.errors import InputError
from depth_pose.export import export_skeletons
from depth_pose.export.tracks import MOST_FRAMES
from depth_pose.io.mcap_write import SkeletonWriter
from depth_pose.io.messages import read_skeleton
from depth_pose.io.skeleton_cdr import write_skeleton


def record(path, frames):
    with SkeletonWriter(path) as writer:
        for people in frames:
            writer.write_people(people, people[0].stamp_ns, people[0].frame_id)
    return path


def test_people_whose_ids_make_the_same_name_get_a_file_each(tmp_path):
    ids = ("a/b", "a_b", "a b", "a_b_2", "../../b")
    path = record(tmp_path / "in.mcap", [[skeleton_of(i, body_id) for body_id in ids] for i in range(3)])
    files = [file.path for file in export_skeletons(path, tmp_path / "out.bvh").files]
    assert len(set(files)) == len(ids) and all(file.parent == tmp_path for file in files)
    assert sorted(files) == sorted(tmp_path.glob("*.bvh"))


def test_a_name_that_is_too_long_is_told_before_anything_is_written(tmp_path):
    path = record(tmp_path / "in.mcap", [[skeleton_of(i, "a"), skeleton_of(i, 300 * "x")] for i in range(3)])
    with pytest.raises(InputError, match="File name too long"):
        export_skeletons(path, tmp_path / "out.bvh")
    assert list(tmp_path.iterdir()) == [path]


def test_one_id_twice_in_a_frame_is_refused(tmp_path):
    path = record(tmp_path / "in.mcap", [[skeleton_of(0, "b"), skeleton_of(0, "b")]])
    for ending in (".bvh", ".csv", ".npz", ".trc"):
        with pytest.raises(InputError, match="have the id 'b'"):
            export_skeletons(path, tmp_path / f"out{ending}")


@pytest.mark.parametrize("ending", [".bvh", ".trc"])
def test_stamps_thirty_years_apart_are_no_bomb(tmp_path, ending):
    frames = [[skeleton_of(i)] for i in range(50)] + [[skeleton_of(0, stamp_ns=2_000_000_000 * 10**9)]]
    path = record(tmp_path / "in.mcap", frames)
    with pytest.raises(InputError, match=f"at most {MOST_FRAMES}"):
        export_skeletons(path, tmp_path / f"out{ending}")
    assert export_skeletons(path, tmp_path / "out.csv").files[0].frames == 51


def test_a_crowd_is_no_bomb_either(tmp_path):
    frames = [
        [replace(skeleton_of(0), stamp_ns=i, body_id=f"{i}_{k}") for k in range(40)] for i in range(1, 251)
    ]
    path = record(tmp_path / "in.mcap", frames)
    with pytest.raises(InputError, match="choose people"):
        export_skeletons(path, tmp_path / "out.npz")
    assert not (tmp_path / "out.npz").exists()


@pytest.mark.parametrize("field, value, says", [
    ("body_id", "x" * 100_000, "body_id has 100000 letters"),
    ("frame_id", "x" * 100_000, "frame_id has 100000 letters"),
    ("joint_states", np.full(19, 250, np.uint8), "state is 250"),
    ("build", np.zeros(2, np.float32), "the build has 2 numbers"),
])  # fmt: skip
def test_numbers_that_no_skeleton_has_are_refused(tmp_path, field, value, says):
    path = record(tmp_path / "in.mcap", [[replace(skeleton_of(i), **{field: value})] for i in range(3)])
    for ending in (".bvh", ".csv", ".npz", ".trc"):
        with pytest.raises(InputError, match=says):
            export_skeletons(path, tmp_path / f"out{ending}")


@pytest.mark.parametrize("ending", [".bvh", ".trc"])
def test_joints_that_are_no_numbers_are_gaps_or_refused(tmp_path, ending):
    bad = [replace(skeleton_of(i), positions=np.full((19, 3), np.inf)) for i in range(5)]
    mixed = [bad[i] if i in (0, 2) else skeleton_of(i) for i in range(5)]
    given = record(tmp_path / "a.mcap", [[s] for s in mixed])
    (written,) = export_skeletons(given, tmp_path / f"a{ending}").files
    assert written.tracks[0].gaps() == [(1, 2)] and len(written.tracks[0]) == 4
    assert "inf" not in written.path.read_text()
    path = record(tmp_path / "b.mcap", [[s] for s in bad])
    with pytest.raises(InputError, match="no frame in which all joints are there"):
        export_skeletons(path, tmp_path / f"b{ending}")
    assert not (tmp_path / f"b{ending}").exists()


def test_a_skeleton_of_very_many_joints_is_refused(tmp_path):
    message = write_skeleton(skeleton_of(0)) + bytes(5 << 20)
    with pytest.raises(InputError, match="at most 4194304 are read"):
        read_skeleton(message)
