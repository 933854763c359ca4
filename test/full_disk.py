"""Commands on a disk that fills up: each in a process that may write so many bytes to a file, and no more."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from command import environment

FULL_AT = 2000
"""Bytes that a file may have: each output's first bytes can be written."""

_RUN_ALL = """
import json, os, resource, signal, sys
from depth_pose.cli import main
from depth_pose.core import outputs
import depth_pose.cli.run, depth_pose.offline
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # else it ends the process
limit, trial, commands = json.loads(sys.argv[1])
if trial is not None:  # the disk takes what is written on trial, and is full later
    outputs.TRIAL_BYTES = trial
for arguments in commands:
    ours, theirs = os.pipe()
    if os.fork() == 0:
        os.dup2(theirs, 2)
        os.close(theirs)
        sys.dont_write_bytecode = True  # Python leaves half of a module's code behind and fails on it later
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
        sys.argv = ["depth-pose", *arguments]
        main()
    os.close(theirs)
    with open(ours, encoding="utf-8") as told:
        said = told.read()
    print(json.dumps([os.waitstatus_to_exitcode(os.wait()[1]), said]), flush=True)
"""


def run_on_full_disk(
    commands: Sequence[Sequence[str]], folder: Path, bank: Path, *, trial: int | None = None
) -> None:
    """Run commands in a folder, and assert that each says so in one line and leaves all as it was.

    Parameters
    ----------
    commands : sequence of sequences of str
        What they write is there before.
    folder, bank : Path
    trial : int, optional
        Bytes that are written on trial before the work; where they fit, the disk is full on the way.
    """
    before = {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()}
    done = subprocess.run(
        [sys.executable, "-c", _RUN_ALL, json.dumps([FULL_AT, trial, commands])],
        cwd=folder, env=environment(DEPTH_POSE_BANK=str(bank)), capture_output=True, text=True, timeout=600,
    )  # fmt: skip
    ends = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("[")]
    assert len(ends) == len(commands), done.stdout + done.stderr
    for command, (code, said) in zip(commands, ends, strict=True):
        assert code == 1 and "cannot be written: File too large" in said, (command, said)
        assert "Traceback" not in said, (command, said)
        assert said.count("cannot be written") == 1 or "many" in command, (command, said)
    left = {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()}
    assert sorted(left) == sorted(before)
    assert left == before
