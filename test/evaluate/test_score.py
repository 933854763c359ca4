"""Scores of answers whose errors are known, and the same numbers as the reference scorer's."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from depth_pose.core.errors import InputError
from depth_pose.core.result import Skeleton
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL
from depth_pose.core.skeleton import JOINT_NODES, JOINTS, rest_nodes
from depth_pose.evaluate.joint_error_plot import save_joint_errors
from depth_pose.evaluate.score import match_sequence, score, score_sequences
from depth_pose.evaluate.truth import KnownJoints, load_truth
from depth_pose.io.mcap_write import SkeletonWriter
from skeletons import make_skeleton

SHARED_SCORER = Path(__file__).parents[2].parent / "shared" / "tools" / "score.py"
REST = (rest_nodes()[JOINT_NODES] * 1.75) @ R_CAMERA_FACING_MODEL + [0, 1.0, 3.0]


def make_truth(frames: int, seed: int = 0) -> KnownJoints:
    rng = np.random.default_rng(seed)
    joints = REST + 0.2 * rng.normal(size=(frames, 1, 3)) + 0.02 * rng.normal(size=(frames, 19, 3))
    stamps = 10**18 + 40_000_000 * np.arange(frames)
    return KnownJoints(joints, JOINTS, stamps, rng.random((frames, 19)) < 0.8)


def save_truth(path: Path, truth: KnownJoints) -> None:
    np.savez(
        path, joints=truth.joints, names=np.array(truth.names), stamps_ns=truth.stamps_ns, seen=truth.seen
    )


def _answers(truth: KnownJoints, positions: np.ndarray) -> dict:
    return {
        int(s): dict(zip(truth.names, p, strict=True))
        for s, p in zip(truth.stamps_ns, positions, strict=True)
    }


def test_perfect_answers() -> None:
    truth = make_truth(20)
    result = score_sequences([match_sequence("a", truth, _answers(truth, truth.joints))])
    assert (result.frames, result.coverage, result.pck10) == (20, 1.0, 1.0)
    assert result.mean_error_mm == result.offset_free_mm == result.hidden_mm == 0


def test_constant_offset_in_the_torsos_frame_is_taken_out() -> None:
    """A body turned about the vertical with an offset that turns with it: 30 mm, offset-free 0."""
    angles = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    turns = np.array([[[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]] for a in angles])
    centred = REST - REST[0]
    joints = np.einsum("tij,nj->tni", turns, centred) + np.array([0, 0, 3])
    offset = np.zeros((19, 3))
    offset[3] = [0.03, 0, 0]
    answered = np.einsum("tij,nj->tni", turns, centred + offset) + np.array([0, 0, 3])
    truth = KnownJoints(joints, JOINTS, np.arange(16) * 40_000_000, np.ones((16, 19), bool))
    result = score_sequences([match_sequence("a", truth, _answers(truth, answered))])
    assert result.joints["neck"].mean_error_mm == pytest.approx(30)
    assert result.mean_error_mm == pytest.approx(30 / 19)
    assert result.offset_free_mm == pytest.approx(0, abs=1e-9)


def test_missing_frames_and_joints_are_misses() -> None:
    truth = make_truth(10)
    answers = _answers(truth, truth.joints + np.array([0.06, 0, 0]))
    for stamp in truth.stamps_ns[:4]:
        del answers[int(stamp)]
    del answers[int(truth.stamps_ns[5])]["left_wrist"]
    result = score_sequences([match_sequence("a", truth, answers)])
    assert result.coverage == pytest.approx(0.5)
    assert result.mean_error_mm == pytest.approx(60)
    assert result.pck[0.05] == 0
    assert result.pck[0.07] == pytest.approx((6 * 19 - 1) / 190)
    assert result.joints["left_wrist"].pck10 == pytest.approx(0.5)


def test_stamps_match_within_two_milliseconds() -> None:
    truth = make_truth(3)
    near = {int(s) + 1_900_000: dict.fromkeys(JOINTS, np.zeros(3)) for s in truth.stamps_ns}
    far = {int(s) + 2_100_000: dict.fromkeys(JOINTS, np.zeros(3)) for s in truth.stamps_ns}
    assert np.isfinite(match_sequence("a", truth, near).errors).all()
    assert np.isnan(match_sequence("a", truth, far).errors).all()
    assert np.isnan(match_sequence("a", truth, {}).errors).all()


def test_nothing_answered_is_a_score_too() -> None:
    result = score_sequences([match_sequence("a", make_truth(3), {})])
    assert (result.coverage, result.pck10) == (0.0, 0.0)
    assert np.isnan(result.mean_error_mm)


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    """Three sequences; one has lost frames and a stamp jitter, one is not answered."""
    truth_dir, predicted_dir = tmp_path / "truth", tmp_path / "predicted"
    truth_dir.mkdir()
    predicted_dir.mkdir()
    for k, name in enumerate(["a", "b", "c"]):
        truth = make_truth(12, seed=k)
        save_truth(truth_dir / f"{name}.npz", truth)
        if name == "c":
            continue
        rng = np.random.default_rng(k)
        with SkeletonWriter(predicted_dir / f"{name}.mcap") as writer:
            for i, stamp in enumerate(truth.stamps_ns):
                if i == 3:
                    writer.write(Skeleton.lost(int(stamp), "optical"))
                else:
                    noisy = truth.joints[i] + 0.05 * rng.normal(size=(19, 3))
                    writer.write(make_skeleton(noisy, stamp_ns=int(stamp) + 1000 * k))
    return truth_dir, predicted_dir


def test_folders_and_files(folders: tuple[Path, Path]) -> None:
    truth_dir, predicted_dir = folders
    both = score(truth_dir, predicted_dir)
    assert both.frames == 36
    assert both.coverage == pytest.approx(22 / 36)
    assert list(both.sequences) == ["a", "b", "c"]
    one = score(truth_dir / "a.npz", predicted_dir / "a.mcap")
    assert one.sequences["a"] == both.sequences["a"]
    assert score(truth_dir / "a.npz", predicted_dir).mean_error_mm == one.mean_error_mm


@pytest.mark.skipif(not SHARED_SCORER.exists(), reason="needs ../shared/tools, which is not in the project")
def test_same_numbers_as_the_reference_scorer(folders: tuple[Path, Path]) -> None:
    command = [sys.executable, "-W", "ignore", str(SHARED_SCORER), *map(str, folders), "--per-joint"]
    text = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300).stdout
    result = score(*folders)
    last = dict(zip(*[iter(text.splitlines()[-1].split())] * 2, strict=True))
    assert int(last.pop("frames")) == result.frames
    assert float(last.pop("mAP10")) == pytest.approx(result.pck10, abs=1e-4)
    for name, value in {**last, "coverage": last.pop("coverage")}.items():
        field = {"per_sequence_mean_mm": "per_sequence_mean_mm"}.get(name, name)
        assert float(value) == pytest.approx(getattr(result, field), abs=0.051), name
    rows = re.findall(r"^  (\w+) +([\d.]+) mm  offset-free +([\d.]+)  mAP10 ([\d.]+)", text, re.M)
    assert len(rows) == 19
    for name, mean, free, share in rows:
        joint = result.joints[name]
        assert [float(mean), float(free)] == pytest.approx(
            [joint.mean_error_mm, joint.offset_free_mm], abs=0.051
        )
        assert float(share) == pytest.approx(joint.pck10, abs=0.00051)


def test_bad_files_are_refused(tmp_path: Path, folders: tuple[Path, Path]) -> None:
    truth_dir, predicted_dir = folders
    with pytest.raises(InputError, match="cannot be read"):
        load_truth(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("hello")
    with pytest.raises(InputError, match=r"as a truth file|no truth file"):
        load_truth(tmp_path / "text.npz")
    np.savez(tmp_path / "other.npz", joints=np.zeros((2, 19, 3)))
    with pytest.raises(InputError, match="no names, stamps_ns, seen"):
        load_truth(tmp_path / "other.npz")
    known = make_truth(2)
    save_truth(tmp_path / "tail.npz", replace(known, names=("tail", *JOINTS[1:])))
    with pytest.raises(InputError, match="no joint is called 'tail'"):
        load_truth(tmp_path / "tail.npz")
    few = [JOINTS.index(name) for name in ("head", "neck")]
    save_truth(
        tmp_path / "head.npz",
        replace(known, joints=known.joints[:, few], names=("head", "neck"), seen=known.seen[:, few]),
    )
    with pytest.raises(InputError, match="has no pelvis, left_shoulder"):
        load_truth(tmp_path / "head.npz")
    save_truth(tmp_path / "empty.npz", make_truth(0))
    with pytest.raises(InputError, match="it has no frames"):
        load_truth(tmp_path / "empty.npz")
    with pytest.raises(InputError, match="has no truth files"):
        score(predicted_dir, predicted_dir)
    with pytest.raises(InputError, match="must be one too"):
        score(truth_dir, predicted_dir / "a.mcap")
    with pytest.raises(InputError, match="no recording for a, b, c"):
        score(truth_dir, tmp_path)


def test_error_picture(tmp_path: Path, folders: tuple[Path, Path]) -> None:
    save_joint_errors(score(*folders), tmp_path / "new" / "errors.png", "test")
    assert (tmp_path / "new" / "errors.png").read_bytes().startswith(b"\x89PNG")
    nothing = score_sequences([match_sequence("a", make_truth(3), {})])
    save_joint_errors(nothing, tmp_path / "nothing.png")
    assert (tmp_path / "nothing.png").exists()
