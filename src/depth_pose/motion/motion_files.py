"""Folders of recorded motion: every file is read, retargeted and reported.

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import InputError
from depth_pose.motion.asf_amc import find_skeleton, parse_asf_amc
from depth_pose.motion.bvh import parse_bvh
from depth_pose.motion.clip import Clip, PoseSet, join_poses, remove_near_duplicates, without_heading
from depth_pose.motion.retarget import Retargeted, retarget

Progress = Callable[[float], None]

SUFFIXES = (".bvh", ".amc")
"""Kinds of files that are read; an .amc needs its .asf beside it."""

_MOST_FPS = 30.0
"""Faster recordings are thinned to at most this rate."""

_TOO_FAR_DEG = 45.0
"""Maximum violation of a joint limit (degrees); frames beyond it are dropped."""

_CALIBRATION_M = 0.08
"""Mean joint displacement (m) to the second frame above which the first is dropped as a lone pose."""

_CALIBRATION_RATIO = 5.0
"""Minimum ratio of that displacement to the next one."""


@dataclass(frozen=True)
class FileReport:
    """Result of reading one file.

    Attributes
    ----------
    path : Path
    frames : int
        Frames used; 0 if the file was refused.
    seconds : float
        Length of the recording.
    note : str
        Why it was refused, or what was left out of it.
    refused : bool
    """

    path: Path
    frames: int
    seconds: float
    note: str
    refused: bool

    def __str__(self) -> str:
        if self.refused:
            return f"{self.path.name}: refused: {self.note}"
        return f"{self.path.name}: {self.frames} frames, {self.seconds:.1f} s" + (
            f"; {self.note}" if self.note else ""
        )


_BAD_FILE = (InputError, ValueError, LookupError, TypeError, ArithmeticError, OSError)
"""Exceptions that a bad file may raise; the others are still read."""


@dataclass(frozen=True)
class LoadedMotion:
    """The motion found in a folder.

    Attributes
    ----------
    clips : tuple of Clip
    reports : tuple of FileReport
        One for each file, in the order of their names.
    """

    clips: tuple[Clip, ...]
    reports: tuple[FileReport, ...]

    def poses(self, distance_m: float = 0.0, mirrored: bool = True) -> PoseSet:
        """Return the poses of all clips.

        Parameters
        ----------
        distance_m : float
            RMS joint distance below which two poses count as one; 0 keeps all.
        mirrored : bool
            Whether mirror images are added.
        """
        parts = [
            PoseSet(without_heading(clip.rotations), (family_of(clip.name),) * len(clip))
            for clip in self.clips
        ]
        poses = join_poses(*parts)
        if distance_m > 0:
            poses = remove_near_duplicates(poses, distance_m)
        if mirrored:
            poses = join_poses(poses, poses.mirrored())
            if distance_m > 0:
                poses = remove_near_duplicates(poses, distance_m)
        return poses

    def summary(self) -> str:
        """Return what each file contributed, one a line, and the sum."""
        used = [r for r in self.reports if not r.refused]
        total = (
            f"{len(used)} of {len(self.reports)} files used, {sum(r.frames for r in used)} frames, "
            f"{sum(r.seconds for r in used):.0f} s"
        )
        return "\n".join([*map(str, self.reports), total])


def family_of(name: str) -> str:
    """Return the name of a clip without its number: ``walking_12`` belongs to ``walking``."""
    return name.rstrip("0123456789").rstrip("_- ") or name


def load_motion_dir(path: str | Path, progress: Progress | None = None) -> LoadedMotion:
    """Read and retarget every motion file in a folder and the folders below it.

    Parameters
    ----------
    path : path
        A folder, or one file.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    LoadedMotion

    Raises
    ------
    InputError
        If there is no such folder, no file of a known kind, or every file was refused.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    found = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.suffix.lower() in SUFFIXES)
    if not found:
        raise InputError(f"{path}: holds no motion; looked for files ending in {', '.join(SUFFIXES)}")
    clips, reports = [], []
    for i, file in enumerate(found):
        try:
            clip, report = _load_file(file)
            clips.append(clip)
        except _BAD_FILE as error:
            report = FileReport(file, 0, 0.0, " ".join(str(error).split()), refused=True)
        reports.append(report)
        if progress is not None:
            progress((i + 1) / len(found))
    if not clips:
        reasons = "\n".join(map(str, reports[:5]))
        raise InputError(f"{path}: none of its {len(found)} files could be used:\n{reasons}")
    return LoadedMotion(tuple(clips), tuple(reports))


def _load_file(file: Path) -> tuple[Clip, FileReport]:
    source = parse_asf_amc(find_skeleton(file), file) if file.suffix.lower() == ".amc" else parse_bvh(file)
    moved = retarget(source)
    first = _skip_calibration(moved)
    stride = max(int(np.ceil(moved.clip.fps / _MOST_FPS - 1e-3)), 1)
    kept = np.arange(first, len(moved.clip), stride)
    possible = moved.violation_deg[kept] <= _TOO_FAR_DEG
    notes = [f"in {moved.unit}"]
    if first:
        notes.append("first frame is a calibration pose, left out")
    if not possible.all():
        notes.append(f"{int((~possible).sum())} frames beyond the joint limits, left out")
    if not possible.any():
        raise InputError(
            f"{file}: no frame within the joint limits (all exceed them by over {_TOO_FAR_DEG:.0f} degrees)"
        )
    clip = _rows(moved.clip, kept[possible], moved.clip.fps / stride)
    return clip, FileReport(
        file, len(clip), len(moved.clip) / moved.clip.fps, ", ".join(notes), refused=False
    )


def _rows(clip: Clip, rows: NDArray[np.int64], fps: float) -> Clip:
    return Clip(clip.name, fps, clip.rotations[rows], clip.roots[rows])


def _skip_calibration(moved: Retargeted) -> int:
    """Return 1 if the first frame is a lone pose before the motion (many libraries store a T pose there)."""
    if len(moved.clip) < 3:
        return 0
    nodes = moved.clip.nodes() - moved.clip.roots[:, None]
    step = np.linalg.norm(np.diff(nodes[:3], axis=0), axis=-1).mean(axis=-1)
    return int(step[0] > _CALIBRATION_M and step[0] > _CALIBRATION_RATIO * step[1])
