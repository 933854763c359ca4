"""Contact sheets and the agreement with 2D references, on a drawn figure of known size."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from depth_pose.core.camera import Camera
from depth_pose.core.errors import InputError
from depth_pose.core.result import Skeleton
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES, JOINTS, rest_nodes
from depth_pose.evaluate.overlay import save_overlay
from depth_pose.evaluate.panels import collect_panels, project
from depth_pose.evaluate.score2d import person_height_px, score_2d
from depth_pose.evaluate.shading import shade_depth
from depth_pose.io.mcap_write import DepthWriter, SkeletonWriter
from skeletons import make_skeleton

CAMERA = Camera(176, 144, 225.0, 225.0, 87.5, 71.5)
REST = (rest_nodes()[JOINT_NODES] * 1.75) @ R_CAMERA_FACING_MODEL + [0, 0.9, 3.8]
STAMPS = [10**18 + i * 40_000_000 for i in range(5)]


@pytest.fixture
def recordings(tmp_path: Path) -> tuple[Path, Path]:
    """Five frames of a box 100 pixels high; the third shows nobody, the fourth has no answer."""
    depth = np.zeros((144, 176), np.float32)
    depth[20:120, 70:106] = 3.8
    depth[5:8, 5:8] = 3.0  # a speck
    with DepthWriter(tmp_path / "depth.mcap", CAMERA, "optical") as writer:
        for stamp in STAMPS:
            writer.write(stamp, depth)
    with SkeletonWriter(tmp_path / "skeletons.mcap") as writer:
        for i, stamp in enumerate(STAMPS):
            if i == 2:
                writer.write(Skeleton.lost(stamp, "optical"))
            elif i != 3:
                writer.write(_skeleton(stamp))
    return tmp_path / "depth.mcap", tmp_path / "skeletons.mcap"


def _skeleton(stamp: int) -> Skeleton:
    return make_skeleton(
        REST,
        stamp_ns=stamp,
        joint_confidence=np.linspace(0, 1, 19).astype(np.float32),
        joint_states=(np.arange(19) % 4).astype(np.uint8),
    )


def _pixels(path: Path) -> np.ndarray:
    from matplotlib.image import imread

    return imread(path)


def _has(picture: np.ndarray, colour: str) -> bool:
    from matplotlib.colors import to_rgb

    return bool((np.abs(picture[..., :3] - to_rgb(colour)).max(axis=-1) < 0.02).sum() > 20)


def test_sheet_shows_both_sides(tmp_path: Path, recordings: tuple[Path, Path]) -> None:
    save_overlay(*recordings, tmp_path / "new" / "sheet.png", frames=5)
    picture = _pixels(tmp_path / "new" / "sheet.png")
    assert picture.shape[1] > 1000
    assert _has(picture, "#f08a24")
    assert _has(picture, "#1f9bcf")


def test_sheet_with_truth_and_more_frames_than_there_are(
    tmp_path: Path, recordings: tuple[Path, Path]
) -> None:
    truth = tmp_path / "truth.npz"
    joints = np.repeat(REST[None] + 0.05, 5, axis=0)
    np.savez(
        truth, joints=joints, names=np.array(JOINTS), stamps_ns=np.array(STAMPS), seen=np.ones((5, 19), bool)
    )
    save_overlay(*recordings, tmp_path / "a.png", frames=20, truth_path=truth)
    save_overlay(*recordings, tmp_path / "b.png", frames=20)
    assert (_pixels(tmp_path / "a.png") != _pixels(tmp_path / "b.png")).any()


def test_truth_of_several_people_is_drawn(tmp_path: Path, recordings: tuple[Path, Path]) -> None:
    """Everybody whom the image shows is drawn; somebody who is not visible is not."""
    everybody = np.tile(np.stack([REST + [0.4, 0, 0], REST - [0.4, 0, 0]]), (5, 1, 1, 1))
    fields = {"joints": everybody, "names": np.array(JOINTS), "stamps_ns": np.array(STAMPS)}
    for shown in (1.0, 0.0):
        visible = np.tile([1.0, shown], (5, 1))
        np.savez(tmp_path / "t.npz", **fields, seen=np.ones((5, 2, 19), bool), visible=visible)
        save_overlay(*recordings, tmp_path / f"{shown}.png", frames=2, truth_path=tmp_path / "t.npz")
        panels = collect_panels(*recordings, frames=2, truth_path=tmp_path / "t.npz")
        for panel in panels:
            np.testing.assert_array_equal(panel.truth, everybody[0, : 2 if shown else 1])
    assert (tmp_path / "1.0.png").read_bytes() != (tmp_path / "0.0.png").read_bytes()


def test_bad_overlay_is_refused(tmp_path: Path, recordings: tuple[Path, Path]) -> None:
    with pytest.raises(InputError, match="frames is 0"):
        save_overlay(*recordings, tmp_path / "a.png", frames=0)
    with pytest.raises(InputError, match="no skeletons"):
        save_overlay(recordings[0], recordings[0], tmp_path / "a.png")


def test_projection() -> None:
    pixels = project(np.array([[0.0, 0, 2], [1.0, -1, 2], [0, 0, -1]]), CAMERA)
    np.testing.assert_allclose(pixels[:2], [[87.5, 71.5], [200.0, -41.0]])
    assert np.isnan(pixels[2]).all()


def test_shading_stays_a_picture() -> None:
    rng = np.random.default_rng(0)
    depth = rng.normal(3, 0.5, (40, 50)).astype(np.float32)
    depth[:10] = 0
    depth[10, :5] = np.nan
    picture = shade_depth(depth)
    assert picture.shape == (40, 50, 3)
    assert np.isfinite(picture).all()
    assert picture.min() >= 0
    assert picture.max() <= 1
    assert len(np.unique(picture[:10].reshape(-1, 3), axis=0)) == 1
    assert shade_depth(np.zeros((4, 5), np.float32)).shape == (4, 5, 3)


def test_height_is_the_persons() -> None:
    depth = np.zeros((144, 176), np.float32)
    depth[20:120, 70:106] = 3.8
    depth[2:5, 2:5] = 1.0
    assert person_height_px(depth) == 100
    with pytest.raises(InputError, match="no depth"):
        person_height_px(np.zeros((4, 4), np.float32))


def _reference(tmp_path: Path, shift: float) -> Path:
    pixels = project(REST, CAMERA)
    frame = {}
    for name in ("left_wrist", "right_wrist", "left_knee", "right_ankle"):
        u, v = pixels[JOINT_INDEX[name]]
        frame[name] = [u, v, 0.9]
    frame["left_wrist"][0] += shift
    frame["right_ankle"][2] = 0.1
    path = tmp_path / "joints.json"
    path.write_text(json.dumps([frame] * 5))
    return path


@pytest.mark.parametrize(("shift", "within_10", "within_05"), [(4.9, 3, 3), (5.1, 3, 2), (10.1, 2, 2)])
def test_agreement_in_pixels(
    tmp_path: Path, recordings: tuple[Path, Path], shift: float, within_10: int, within_05: int
) -> None:
    """Three visible joints in five frames of which three are answered; the person is 100 px high."""
    result = score_2d(*recordings, _reference(tmp_path, shift))
    assert (result.frames, result.answered, result.joints) == (5, 3, 15)
    assert result.within_10 == pytest.approx(3 * within_10 / 15)
    assert result.within_05 == pytest.approx(3 * within_05 / 15)
    assert result.per_joint["left_knee"] == pytest.approx(0.6)
    assert result.per_frame[2] == result.per_frame[3] == 0
    assert "right_ankle" not in result.per_joint


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[", "not JSON"),
        ("{}", "must be a list"),
        ("[{}]", "has 1 frames"),
        ('[{"nose": [1, 2, 3]}]', "nose must be a joint"),
        ("[{},{},{},{},{}]", "no visible joint"),
    ],
)
def test_bad_reference_is_refused(
    tmp_path: Path, recordings: tuple[Path, Path], text: str, says: str
) -> None:
    path = tmp_path / "joints.json"
    path.write_text(text)
    with pytest.raises(InputError, match=says):
        score_2d(*recordings, path)
