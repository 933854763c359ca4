"""The default bank: built once, in a process of its own, and kept in the user's cache.

``python -m depth_pose.bank.default FILE`` builds it and prints its progress, one number a line. A separate
process uses all cores without importing the caller's script again, and returns its memory when it ends.
"""

from __future__ import annotations

import fcntl
import logging
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import depth_pose
from depth_pose.bank.bank import Bank, default_bank_path
from depth_pose.core.errors import BankError
from depth_pose.core.outputs import remove_parts
from depth_pose.core.private_folder import is_writable, private_folder
from depth_pose.core.progress import progress_bar

Progress = Callable[[float], None]
"""Called with the fraction done, 0 to 1."""

_GATHERING = 0.2
"""Fraction of the time that making the poses takes; for the progress bar. Measured on two cores."""

_log = logging.getLogger(__name__)


def find_default_bank() -> Path | None:
    """Return the file of the default bank, or None where it has to be built first.

    A file that ``$DEPTH_POSE_BANK`` names is returned whether it exists or not: it is never built.
    """
    path = default_bank_path()
    if "DEPTH_POSE_BANK" in os.environ or path.is_file():
        return path
    spare = _spare_path()
    return spare if spare is not None and spare.is_file() else None


def ensure_default_bank(progress: Progress | None = None, poses: int | None = None) -> Path:
    """Return the file of the default bank; build it first where there is none.

    Of several processes that ask at the same time one builds it, and the others wait.

    Parameters
    ----------
    progress : callable, optional
        Called with the fraction done.
    poses : int, optional
        Number of poses; the default is that of `depth_pose.bank.build.BuildConfig`.

    Raises
    ------
    BankError
        Where it cannot be built or kept.
    """
    found = find_default_bank()
    if found is not None:
        return found
    path = default_bank_path() if is_writable(default_bank_path().parent) else _spare_path()
    if path is None:
        raise BankError(
            f"{default_bank_path().parent} cannot be written, and there is no other place for the default "
            "bank: let XDG_CACHE_HOME be a folder that can, or build one: depth-pose bank build -o FILE.npz"
        )
    with _locked(path):
        if not path.is_file():
            _build_in_process(path, poses, progress or (lambda share: None))
    return path


def prepare_default_bank() -> Path:
    """Return the file of the default bank; build it first, with a progress bar, where there is none."""
    found = find_default_bank()
    if found is not None:
        return found
    with progress_bar("building the exemplar bank (once)", 100) as update:
        return ensure_default_bank(lambda share: update(int(100 * share)))


def _spare_path() -> Path | None:
    """Return the place of the bank where the user's cache cannot be written."""
    if is_writable(default_bank_path().parent):
        return None
    folder = private_folder("bank")
    return folder / default_bank_path().name if folder is not None else None


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Hold the lock beside a file."""
    with path.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _build_in_process(path: Path, poses: int | None, progress: Progress) -> None:
    source = Path(depth_pose.__file__).parents[1]
    search = os.pathsep.join(filter(None, (str(source), os.environ.get("PYTHONPATH"))))
    command = [sys.executable, "-m", "depth_pose.bank.default", str(path), *([str(poses)] if poses else [])]
    environment = {**os.environ, "PYTHONPATH": search}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        try:
            for line in process.stdout:
                progress(float(line))
            said = process.stderr.read().strip()
        except BaseException:  # Ctrl-C, or the caller's progress bar failed
            process.terminate()
            raise
    if process.returncode:
        remove_parts([path])
        reason = said.splitlines()[-1] if said else f"exit code {process.returncode}"
        raise BankError(f"the default bank could not be built: {reason}")
    _log.info("built the default bank, %s", path)


def build_default_bank(poses: int | None, progress: Progress) -> Bank:
    """Build the default bank from the embedded body and poses."""
    from depth_pose.bank.bodies import find_body_or_bank
    from depth_pose.bank.build import BuildConfig, build_bank
    from depth_pose.bank.sources import gather_poses

    config = BuildConfig() if poses is None else BuildConfig(poses=poses)
    sources = gather_poses(
        None, config.seed, embedded_count=config.poses, progress=lambda share: progress(_GATHERING * share)
    )
    return build_bank(
        find_body_or_bank("embedded"),
        sources.poses.rotations,
        config,
        {**sources.header, "body": "embedded"},
        lambda done, total: progress(_GATHERING + (1.0 - _GATHERING) * done / total),
    )


def _main() -> None:
    path, *poses = sys.argv[1:]
    bank = build_default_bank(
        int(poses[0]) if poses else None, lambda share: print(f"{share:.4f}", flush=True)
    )
    bank.save(path)


if __name__ == "__main__":
    _main()
