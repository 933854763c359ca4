"""A disk that is full: every writing command says so in one line, and leaves what was there as it was."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import depth_pose
from depth_pose.cli import main
from depth_pose.core.types import Skeleton, Source
from depth_pose.evaluate.truth import load_truth
from depth_pose.io.mcap_write import SkeletonWriter

_FULL_AT = 2000
"""Bytes that a file may have: each output's first bytes can be written."""

COMMANDS = (
    ("simulate", "-o", "sim.mcap", "--seconds", "0.2", "--motion", "wave"),
    ("run", "in.mcap", "-o", "out.mcap"),
    ("run", "in.mcap", "other.mcap", "-o", "many"),
    ("export", "people.mcap", "-o", "out.bvh"),
    ("export", "people.mcap", "-o", "out.csv"),
    ("export", "people.mcap", "-o", "out.npz"),
    ("export", "people.mcap", "-o", "out.trc"),
    ("overlay", "in.mcap", "people.mcap", "-o", "out.png"),
    ("eval", "in.npz", "people.mcap", "--plot", "out.png"),
    ("bank", "info", "--sheet", "out.png"),
)

_SHORT = ("--seconds", "0.12", "--motion", "wave")

_RUN_ALL = """
import json, os, resource, signal, sys
from depth_pose.cli import main
import depth_pose.cli.run, depth_pose.offline
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # else it ends the process
limit, commands = json.loads(sys.argv[1])
for arguments in commands:
    ours, theirs = os.pipe()
    if os.fork() == 0:
        os.dup2(theirs, 2)
        os.close(theirs)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
        sys.argv = ["depth-pose", *arguments]
        main()
    os.close(theirs)
    with open(ours, encoding="utf-8") as told:
        said = told.read()
    print(json.dumps([os.waitstatus_to_exitcode(os.wait()[1]), said]), flush=True)
"""


def _make_inputs(folder: Path) -> None:
    """Simulate a recording, and give skeletons where the person is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["depth-pose", "simulate", "-o", str(folder / "in.mcap"), *_SHORT])
        with pytest.raises(SystemExit) as end:
            main()
    assert not end.value.code
    (folder / "other.mcap").write_bytes((folder / "in.mcap").read_bytes())
    rest = (np.tile([0.0, 0, 0, 1], (19, 1)), np.ones(19, np.float32), np.zeros(19, np.uint8))
    truth = load_truth(folder / "in.npz")
    with SkeletonWriter(folder / "people.mcap") as writer:
        for stamp, joints in zip(truth.stamps_ns, truth.joints, strict=True):
            writer.write(Skeleton(int(stamp), "o", "b", Source.REFINED, 1.0, 0.0, 1.0, joints, *rest))


def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path: Path, bank_path: Path) -> None:
    _make_inputs(tmp_path)
    for name in (a for command in COMMANDS for a in command if a.startswith(("out.", "sim."))):
        (tmp_path / name).write_bytes(b"good")
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    path = os.pathsep.join(
        filter(None, [str(Path(depth_pose.__file__).parents[1]), os.environ.get("PYTHONPATH")])
    )
    environment = {"PYTHONPATH": path, "COLUMNS": "200", "NO_COLOR": "1", "DEPTH_POSE_BANK": str(bank_path)}
    done = subprocess.run(
        [sys.executable, "-c", _RUN_ALL, json.dumps([_FULL_AT, COMMANDS])],
        cwd=tmp_path, env=os.environ | environment, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    ends = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("[")]
    assert len(ends) == len(COMMANDS), done.stdout + done.stderr
    for command, (code, said) in zip(COMMANDS, ends, strict=True):
        assert code == 1 and "cannot be written: File too large" in said, (command, said)
        assert "Traceback" not in said, (command, said)
    left = {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()}
    assert left == before
    many = tmp_path / "many"
    assert not many.exists() or not any(many.glob("**/*.mcap"))
