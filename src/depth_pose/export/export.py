"""Export a recording of skeletons to files for other tools."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain, count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.extras import require
from depth_pose.core.outputs import check_targets, new_file, new_text_file
from depth_pose.detect.floor import Floor
from depth_pose.export.as_read import FramesOutOfOrder, PartsReader
from depth_pose.export.bvh import bvh_text
from depth_pose.export.c3d_file import write_c3d
from depth_pose.export.floor import FLOOR_FRAME, find_floor, on_floor, recorded_floor
from depth_pose.export.opensim import mot_lines, sto_lines
from depth_pose.export.tables import npz_arrays, write_angles, write_csv, write_json
from depth_pose.export.tracks import (
    MOST_FRAMES,
    Presence,
    Track,
    Tracks,
    chosen,
    even,
    even_step_s,
    fill_gaps,
    held,
    in_world,
    read_tracks,
    whole,
)
from depth_pose.export.trc import trc_text
from depth_pose.io.schemas import PEOPLE_TOPIC
from depth_pose.rooms.rig import ROOM_FRAME

FORMATS = {
    ".bvh": "animation (Blender, MotionBuilder, Unity and others); a file a person",
    ".trc": "OpenSim and biomechanics, joints; a file a person",
    ".c3d": "motion laboratories, joints; a file a person",
    ".mot": "OpenSim, joint angles; a file a person",
    ".sto": "OpenSim (OpenSense), rotations of segments; a file a person",
    ".csv": "spreadsheets, R, pandas; a row a joint a frame a person, or their angles",
    ".json": "JavaScript and others; frames of people, joints and angles",
    ".npz": "NumPy; arrays over frames and people",
}
"""Formats by file extension, and their uses."""

UNITS = {"m": 1.0, "cm": 100.0, "mm": 1000.0}
"""Units of length, per metre."""

_USUAL_UNIT = {".bvh": "m", ".trc": "mm", ".c3d": "mm"}
_A_FILE_A_PERSON = (".bvh", ".trc", ".c3d", ".mot", ".sto")
_ROWS = (".csv", ".json")
_LEVEL = (FLOOR_FRAME, ROOM_FRAME)
"""Frames with z up."""

_T_UP_OPTICAL = np.diag([1.0, -1.0, -1.0, 1.0])
"""The optical frame turned to y up, z towards the viewer: people who face the sensor face the viewer."""
_T_UP_WORLD = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""REP-103's z up turned to y up, as importers turn it back: (x, y, z) goes to (x, z, -y)."""
_UP = np.array([0.0, 0.0, 1.0])
"""Up on the floor and in a room."""


@dataclass(frozen=True)
class Exported:
    """One file that was written.

    Attributes
    ----------
    path : Path
    tracks : tuple of Presence
        People in the file, as found, before gaps were filled: when each is there.
    frames : int
        Frames in the file.
    rate_hz : float
        Frames a second; for CSV and NPZ the recording's mean.
    start_ns : int
        Stamp of the recording's first frame. A file of one person begins with their first frame.
    """

    path: Path
    tracks: tuple[Presence, ...]
    frames: int
    rate_hz: float
    start_ns: int


@dataclass(frozen=True)
class ExportResult:
    """Files of an export, the frame of their skeletons, and the floor where it was estimated."""

    files: tuple[Exported, ...]
    frame_id: str
    floor: Floor | None


def export_skeletons(
    skeletons: Path | str,
    output: Path | str,
    *,
    people: Sequence[str] = (),
    fill: bool = False,
    world: str = "camera",
    recording: Path | str | None = None,
    unit: str | None = None,
    angles: bool = False,
    topic: str = PEOPLE_TOPIC,
    depth_topic: str | None = None,
) -> ExportResult:
    """Write a recording's skeletons in the format of the output's file extension.

    Parameters
    ----------
    skeletons : Path or str
        The recording of skeletons.
    output : Path or str
        The file; with several people, a format for one person gets one file each, NAME_ID.bvh.
    people : sequence of str
        Only these ``body_id``; all if empty.
    fill : bool
        Fill gaps. Without it BVH holds the last pose, CSV, JSON and STO leave the person out, the others have
        NaN or, in C3D, missing points.
    world : str
        ``camera``, or ``floor``: z up, the origin on the floor below the sensor. Skeletons in a room's
        frame (`depth_pose.rooms.rig.ROOM_FRAME`) stay in it with both: z is up, the floor at z = 0.
    recording : Path or str, optional
        The depth recording in which to find the floor; without it, it is the one that `run` recorded, or is
        estimated from feet.
    unit : str, optional
        ``m``, ``cm`` or ``mm`` of BVH (m), TRC and C3D (mm); the others are in metres.
    angles : bool
        Write joint angles to CSV, in place of joints.
    topic, depth_topic : str, optional
        The topics.

    Raises
    ------
    InputError
        Where a recording cannot be used, has nobody, or the file cannot be written.
    ConfigError
        Where the format, the unit or the world is unknown.
    """
    output = Path(output)
    kind = output.suffix.lower()
    _check(output, kind, world, unit, recording)
    if angles and kind != ".csv":
        raise ConfigError(f"--angles is for .csv; {kind} files have either joints or angles, or both")
    check_targets([output], [skeletons, recording])
    of_floor = _FloorChoice(world == "floor", skeletons, recording, depth_topic)
    if kind in _ROWS and not fill:
        with suppress(FramesOutOfOrder):
            reader = PartsReader(skeletons, topic, people)
            as_read = _write_as_read(output, kind, reader, of_floor, angles)
            if as_read is not None:
                return as_read
    found = chosen(read_tracks(skeletons, topic), people, skeletons)
    floor = of_floor.find(found.people) if of_floor.is_sought(found.frame_id) else None
    tracks = found if floor is None else on_floor(found, floor)
    if kind == ".mot" and tracks.frame_id not in _LEVEL:
        raise ConfigError(f"{output} holds angles against the vertical: add --world floor")
    if kind in _A_FILE_A_PERSON:
        unit = unit or _USUAL_UNIT.get(kind, "m")
        check_targets(_paths_of(output, tracks), [skeletons, recording])
        return ExportResult(_write_each(output, kind, tracks, fill, unit), tracks.frame_id, floor)
    shown = replace(tracks, people=tuple(map(fill_gaps, tracks.people))) if fill else tracks
    if kind == ".npz":
        _write_npz(output, shown, floor)
    else:
        _write_rows(output, kind, [shown], shown.frame_id, angles)
    return ExportResult((_exported(output, tracks.people, tracks.stamps_ns),), tracks.frame_id, floor)


@dataclass(frozen=True)
class _FloorChoice:
    """Whether and where to find the floor, for skeletons in the sensor's frame."""

    is_wanted: bool
    skeletons: Path | str
    recording: Path | str | None
    depth_topic: str | None

    def is_sought(self, frame_id: str) -> bool:
        """Check that the depth recording is of use; return whether the floor must be found."""
        if frame_id == ROOM_FRAME and self.recording is not None:
            raise ConfigError(
                f"{self.skeletons} is in the room's frame, whose floor is known; leave out --recording"
            )
        return self.is_wanted and frame_id != ROOM_FRAME

    @property
    def needs_feet(self) -> bool:
        """Whether no floor was recorded, so that the feet of the whole recording must be known."""
        return recorded_floor(self.skeletons) is None

    def find(self, people: Sequence[Track]) -> Floor:
        """Find the floor, as `find_floor`."""
        return find_floor(people, self.skeletons, self.recording, self.depth_topic)


def _write_as_read(
    output: Path, kind: str, reader: PartsReader, of_floor: _FloorChoice, angles: bool
) -> ExportResult | None:
    """Write rows while reading; None where all people's feet are needed first."""
    parts = reader.parts()
    first = next(parts)
    floor = None
    if of_floor.is_sought(reader.frame_id):
        if of_floor.needs_feet:
            return None
        floor = of_floor.find(())
    frame_id = reader.frame_id if floor is None else FLOOR_FRAME
    found = chain([first], parts)
    _write_rows(
        output,
        kind,
        found if floor is None else (on_floor(part, floor) for part in found),
        frame_id,
        angles,
        lambda: reader.check(of_floor.skeletons),
    )
    return ExportResult((_exported(output, reader.presences(frame_id), reader.stamps_ns),), frame_id, floor)


def _write_rows(
    output: Path,
    kind: str,
    parts: Iterable[Tracks],
    frame_id: str,
    angles: bool,
    check: Callable[[], None] = lambda: None,
) -> None:
    """Write CSV or JSON; ``check`` may raise once all is read, and then there is no file."""
    up = _UP if frame_id in _LEVEL else None
    with new_text_file(output, newline="") as stream:
        if kind == ".json":
            write_json(stream, parts, frame_id, up)
        elif angles:
            write_angles(stream, parts, up)
        else:
            write_csv(stream, parts)
        check()


def _write_npz(output: Path, tracks: Tracks, floor: Floor | None) -> None:
    if len(tracks.stamps_ns) * len(tracks.people) > MOST_FRAMES:
        raise InputError(
            f"{output} would hold {len(tracks.stamps_ns)} frames of {len(tracks.people)} people each; "
            f"at most {MOST_FRAMES} are written: choose people with --person, or write .csv"
        )
    up = _UP if tracks.frame_id in _LEVEL else None
    arrays = npz_arrays(tracks, up, floor.T_floor_camera if floor else None)
    with new_file(output) as stream:
        np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]


def _exported(output: Path, people: tuple[Presence, ...], stamps_ns: NDArray[np.int64]) -> Exported:
    span = max(float(stamps_ns[-1] - stamps_ns[0]) * 1e-9, 1e-9)
    return Exported(output, people, len(stamps_ns), (len(stamps_ns) - 1) / span, int(stamps_ns[0]))


def _check(output: Path, kind: str, world: str, unit: str | None, recording: Path | str | None) -> None:
    if kind not in FORMATS:
        raise ConfigError(
            f"{output}: the format is inferred from the file extension, one of {', '.join(FORMATS)}"
        )
    if kind == ".c3d":
        require("c3d", "a .c3d file")
    if world not in ("camera", "floor"):
        raise ConfigError(f"the world is {world!r}; it is camera or floor")
    if unit is not None and unit not in UNITS:
        raise ConfigError(f"the unit is {unit!r}; it is one of {', '.join(UNITS)}")
    if unit is not None and kind not in _USUAL_UNIT and unit != "m":
        raise ConfigError(f"{kind} files are in metres; the unit is for {' and '.join(_USUAL_UNIT)}")
    if recording is not None and world != "floor":
        raise ConfigError("the depth recording is for finding the floor; use it with the world floor")


def _write_each(output: Path, kind: str, tracks: Tracks, fill: bool, unit: str) -> tuple[Exported, ...]:
    """Write one file per person, y up."""
    has_z_up = tracks.frame_id in _LEVEL
    T_up: NDArray[np.float64] = _T_UP_WORLD if has_z_up else _T_UP_OPTICAL
    step_s = even_step_s(tracks.stamps_ns)
    written = []
    for track, path in zip(map(whole, tracks.people), _paths_of(output, tracks), strict=True):
        motion = even(in_world(track, T_up, track.frame_id), step_s)
        if fill:
            motion = fill_gaps(motion)
        elif kind == ".bvh":
            motion = held(motion)
        _write_one(path, kind, motion, step_s, unit, fill)
        written.append(Exported(path, (track,), len(motion), 1 / step_s, int(tracks.stamps_ns[0])))
    return tuple(written)


def _write_one(path: Path, kind: str, motion: Track, step_s: float, unit: str, fill: bool) -> None:
    """Write one person's motion, y up."""
    if kind == ".c3d":
        with new_file(path) as binary:
            write_c3d(binary, motion, step_s, unit, UNITS[unit])
        return
    with new_text_file(path, newline="") as stream:
        if kind == ".bvh":
            stream.write(bvh_text(motion, step_s, UNITS[unit]))
        elif kind == ".trc":
            stream.write(trc_text(motion, step_s, path.name, unit, UNITS[unit]))
        else:
            lines = (
                mot_lines(motion, step_s, path.stem, fill) if kind == ".mot" else sto_lines(motion, step_s)
            )
            stream.writelines(f"{line}\n" for line in lines)


def _paths_of(output: Path, tracks: Tracks) -> list[Path]:
    """Return a unique file name for each person, for any ids."""
    if len(tracks.people) == 1:
        return [output]
    names: dict[str, None] = {}
    for track in tracks.people:
        plain = re.sub(r"[^\w.-]", "_", track.body_id)
        numbered = (f"{plain}_{n}" for n in count(2))
        names[plain if plain not in names else next(name for name in numbered if name not in names)] = None
    return [output.with_name(f"{output.stem}_{name}{output.suffix}") for name in names]
