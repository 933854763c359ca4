"""A disk that is full: every writing command says so in one line, and leaves what was there as it was."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from depth_pose.cli import main
from depth_pose.evaluate.truth import load_truth
from depth_pose.io.mcap_write import SkeletonWriter
from full_disk import run_on_full_disk
from skeletons import make_skeleton

COMMANDS = (
    ("simulate", "-o", "sim.mcap", "--seconds", "0.2", "--motion", "wave"),
    ("simulate", "-o", "sim.mcap", "--seconds", "0.1", "--room", "--width", "160"),
    ("simulate", "-o", "sim.mcap", "--seconds", "0.1", "--room", "--cameras", "2"),
    ("run", "in.mcap", "-o", "out.mcap"),
    ("run", "in.mcap", "-o", "out.mcap", "--markers", "--save-build", "out.json"),
    ("run", "in.mcap", "other.mcap", "-o", "many", "--workers", "0"),
    ("export", "people.mcap", "-o", "out.bvh"),
    ("export", "people.mcap", "-o", "out.csv"),
    ("export", "people.mcap", "-o", "out.npz"),
    ("export", "people.mcap", "-o", "out.trc"),
    ("overlay", "in.mcap", "people.mcap", "-o", "out.png"),
    ("overlay", "in.mcap", "people.mcap", "-o", "out.gif"),
    ("eval", "in.npz", "people.mcap", "--plot", "out.png"),
    ("bank", "info", "--sheet", "out.png"),
    ("bank", "check", "in.mcap", "-o", "out.png"),
    ("bank", "build", "-o", "out.npz", "--poses", "10", "--workers", "0"),
)

_SHORT = ("--seconds", "0.12", "--motion", "wave")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Simulate a recording, give skeletons where the person is, and earlier outputs."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["depth-pose", "simulate", "-o", str(tmp_path / "in.mcap"), *_SHORT])
        with pytest.raises(SystemExit) as end:
            main()
    assert not end.value.code
    (tmp_path / "other.mcap").write_bytes((tmp_path / "in.mcap").read_bytes())
    truth = load_truth(tmp_path / "in.npz")
    with SkeletonWriter(tmp_path / "people.mcap") as writer:
        for stamp, joints in zip(truth.stamps_ns, truth.joints, strict=True):
            writer.write(make_skeleton(joints, stamp_ns=int(stamp)))
    for name in (a for command in COMMANDS for a in command if a.startswith(("out.", "sim."))):
        (tmp_path / name).write_bytes(b"good")
    return tmp_path


def test_a_full_disk_is_one_line_and_leaves_nothing(folder: Path, bank_path: Path) -> None:
    run_on_full_disk(COMMANDS, folder, bank_path)
    many = folder / "many"
    assert not many.exists() or not any(many.glob("**/*.mcap"))


@pytest.mark.slow
def test_a_disk_that_fills_up_on_the_way_is_one_line_too(folder: Path, bank_path: Path) -> None:
    commands = [command for command in COMMANDS if not {"--room", "--markers"} & {*command}]
    run_on_full_disk(commands, folder, bank_path, trial=1)
    assert sorted(p.name for p in (folder / "many").iterdir()) == ["report.csv"]  # which says why
    assert "File too large" in (folder / "many" / "report.csv").read_text()
