"""Reading BVH files: what they say, and what is wrong with them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from depth_pose.core.errors import InputError
from depth_pose.motion.bvh import parse_bvh, read_bvh
from depth_pose.motion.clip import Clip
from depth_pose.motion.procedural.generator import make_clip
from motion_writers import write_bvh

TINY = """HIERARCHY
ROOT Base
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Yrotation Xrotation Zrotation
  JOINT Tip {
    OFFSET 0 2 0
    CHANNELS 2 Zrotation Xrotation
    End Site
    {
      OFFSET 0 1 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.04
1 2 3 0 0 0 0 0
1 2 3 90 0 0 0 90
"""


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "tiny.bvh"
    path.write_text(text)
    return path


def test_hierarchy_and_channels_in_any_order(tmp_path: Path) -> None:
    source = parse_bvh(written(tmp_path, TINY))
    assert source.joints == ("Base", "Tip", "Tip/end")
    assert source.fps == pytest.approx(25.0)
    np.testing.assert_allclose(source.positions()[0], [[1, 2, 3], [1, 4, 3], [1, 5, 3]])
    # Y by 90 degrees, then the tip's X by 90: its end points along the turned z, which is x.
    np.testing.assert_allclose(source.positions()[1], [[1, 2, 3], [1, 4, 3], [2, 4, 3]], atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("HIERARCHY", "SKELETON", "does not begin with HIERARCHY"),
        ("MOTION", "", "no MOTION"),
        ("OFFSET 0 2 0", "OFFSET 0 two 0", "line 7"),
        ("CHANNELS 2 Zrotation", "CHANNELS 3 Zrotation", "line 8"),
        ("Zrotation Xrotation\n    End", "Zrotation Wrotation\n    End", "unknown channel"),
        ("Frames: 2", "Frames: 3", "need 24 values, there are 16"),
        ("Frame Time: 0.04", "Frame Time: 0", "make no motion"),
        ("1 2 3 90 0 0 0 90", "1 2 3 90 0 0 0 nan", "not finite"),
        ("1 2 3 90 0 0 0 90", "1 2 3 90 0 0 0 x", "not a number"),
        ("  }\n}\n", "  }\n", "not closed"),
    ],
)
def test_damaged_files_are_refused_with_the_place(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in TINY
    with pytest.raises(InputError, match=said) as caught:
        parse_bvh(written(tmp_path, TINY.replace(old, new, 1)))
    assert "tiny.bvh" in str(caught.value)


def test_missing_file_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        parse_bvh(tmp_path / "nothing.bvh")


def test_a_skeleton_that_is_no_person_names_the_joint(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no joint for the left elbow"):
        read_bvh(written(tmp_path, TINY))


def test_positions_of_a_written_clip_come_back(tmp_path: Path) -> None:
    clip = make_clip("walk", 10.0, 1.0, seed=4)
    source = parse_bvh(write_bvh(tmp_path / "walk.bvh", clip, order="XYZ"))
    expected = clip.nodes()
    for name, node in (("LeftHand", 8), ("RightFoot", 19), ("Head", 4)):
        np.testing.assert_allclose(
            source.positions()[:, source.joints.index(name)], expected[:, node] * 100, atol=0.01
        )
    assert isinstance(read_bvh(tmp_path / "walk.bvh"), Clip)
