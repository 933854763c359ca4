"""Sources of a bank: poses of the embedded source and of recorded motion."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from depth_pose.motion.clip import (
    PoseSet,
    choose_for_coverage,
    join_poses,
    remove_near_duplicates,
)
from depth_pose.motion.motion_files import FileReport, load_motion_dir
from depth_pose.motion.procedural.generator import make_poses

Progress = Callable[[float], None]
"""Called with the fraction done."""

NEAR_DUPLICATE_M = 0.025
"""RMS joint distance below which two recorded poses count as one."""


@dataclass(frozen=True)
class PoseSources:
    """Poses for a bank.

    Attributes
    ----------
    poses : PoseSet
    reports : tuple of FileReport
        Report on each file of recorded motion.
    header : dict
        What the poses come from, for the bank's header.
    """

    poses: PoseSet
    reports: tuple[FileReport, ...]
    header: dict[str, Any]


def gather_poses(
    count: int | None,
    seed: int,
    mocap: Path | None = None,
    embedded: bool = True,
    embedded_count: int = 10_000,
    progress: Progress | None = None,
) -> PoseSources:
    """Make the embedded poses, read the recorded ones, and put them together.

    Parameters
    ----------
    count : int, optional
        Poses of each source: the number generated, and the maximum taken of recorded motion,
        chosen for coverage. By default ``embedded_count`` are made and all recorded ones taken.
    seed : int
        Of the embedded source.
    mocap : path, optional
        Folder of recorded motion. Near-duplicates are left out, mirror images added.
    embedded : bool
        Whether the embedded poses are in it.
    embedded_count : int
    progress : callable, optional

    Raises
    ------
    InputError
        Where the folder has no motion that can be used.
    """
    tell = progress or (lambda share: None)
    part = 0.5 if embedded and mocap is not None else 1.0
    sets: list[PoseSet] = []
    header: dict[str, Any] = {}
    reports: tuple[FileReport, ...] = ()
    if embedded:
        made = count or embedded_count
        sets.append(make_poses(made, seed, lambda share: tell(part * share)))
        header["embedded"] = f"{made} poses, seed {seed}"
    if mocap is not None:
        motion = load_motion_dir(mocap, lambda share: tell(1.0 - part + part * share))
        recorded = motion.poses(NEAR_DUPLICATE_M)
        if count is not None and len(recorded) > count:
            recorded = recorded.take(choose_for_coverage(recorded, count))
        used = [r for r in motion.reports if not r.refused]
        header["mocap"] = (
            f"{mocap.resolve().name}: {len(recorded)} poses of {sum(r.frames for r in used)} frames "
            f"in {len(used)} of {len(motion.reports)} files"
        )
        sets.append(recorded)
        reports = motion.reports
    poses = join_poses(*sets)
    if len(sets) > 1:
        poses = remove_near_duplicates(poses, NEAR_DUPLICATE_M)
    header["families"] = dict(sorted(Counter(poses.families).items()))
    return PoseSources(poses, reports, header)
