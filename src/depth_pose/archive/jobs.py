"""Process one recording of an archive, in any process.

A finished output records its provenance (`Work.marks`): input, bank, settings and version. If all are
unchanged, the recording is skipped.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import os
import platform
import threading
import time
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from depth_pose import __version__
from depth_pose.archive.remote import fetched
from depth_pose.core.config import PipelineConfig
from depth_pose.core.errors import BankError, ConfigError, DepthPoseError, InputError
from depth_pose.core.reading import MOST_SETTINGS_BYTES, open_ordinary
from depth_pose.core.workers import Tell
from depth_pose.io._rosbag2_folder import METADATA
from depth_pose.io.image_folder import CAMERA_FILE, IMAGE_ENDINGS
from depth_pose.io.image_options import ImageOptions
from depth_pose.io.recording import open_regular, read_metadata, recording_files
from depth_pose.offline import NOTE, RunSummary, process_recording

if TYPE_CHECKING:
    from depth_pose.pipeline import PosePipeline

_BLOCK = 1 << 20
"""Size of a block: 1 MiB."""
_BLOCKS = 8
"""Number of blocks of 1 MiB that are hashed in larger files, including the first and the last."""
_TELL_EVERY_S = 0.5
"""Minimum time between two progress reports, seconds."""


@dataclass(frozen=True)
class Setting:
    """Settings shared by all recordings of an archive.

    Attributes
    ----------
    bank : str or None
        The bank's file; None for the default one of the machine that processes the recording.
    bank_id : str
        Id of the bank; a different one is refused.
    config : PipelineConfig
    depth_topic : str or None
        The depth topic; None for the only one there is.
    images : ImageOptions
        Options for folders of images.
    passes : int
        2: a second pass over each recording (`depth_pose.passes`).
    version : str
        Version of this package; a different one is refused.
    """

    bank: str | None
    bank_id: str
    config: PipelineConfig
    depth_topic: str | None = None
    images: ImageOptions = field(default_factory=ImageOptions)
    passes: int = 1
    version: str = __version__

    @cached_property
    def digest(self) -> str:
        """Hash of the settings, 16 hexadecimal digits."""
        settings = self.config.as_mapping()
        if self.config.build.file:  # hash the file's content, not its name
            settings["build"]["file"] = _hash_of_build(self.config.build.file)
        given: list[Any] = [settings, self.depth_topic]
        if self.images != ImageOptions():
            given.append(dataclasses.asdict(self.images))
        if self.passes > 1:
            given.append(self.passes)
        text = json.dumps(given, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def _hash_of_build(path: str) -> str:
    try:
        with open_ordinary(path, MOST_SETTINGS_BYTES) as stream:
            return hashlib.sha256(stream.read()).hexdigest()
    except InputError as error:
        raise ConfigError(f"{path}: the build cannot be read: {error}") from error
    except OSError as error:
        raise ConfigError(f"{path}: the build cannot be read: {error.strerror}") from error


@dataclass(frozen=True)
class Row:
    """Result of one recording: a row of the report.

    Attributes
    ----------
    file : str
        The recording's name within the archive.
    state : str
        ``done``, ``skipped`` (it was done before) or ``failed``.
    frames, answered : int
        Frames, and those with a skeleton.
    people : int
        Most people in one frame.
    confidence : float
        Mean of the skeletons' confidences; NaN without any.
    ms : float
        Median time of a frame in the pipeline, milliseconds; NaN where it was not measured.
    warnings : tuple of str
        Problems; for a failed recording, the reason.
    damage : tuple of str
        The warnings about parts of the recording that could not be read.
    seconds : float
        Total time, including reading and writing; NaN where it was not measured.
    """

    file: str
    state: str
    frames: int = 0
    people: int = 0
    answered: int = 0
    confidence: float = math.nan
    ms: float = math.nan
    warnings: tuple[str, ...] = ()
    damage: tuple[str, ...] = ()
    seconds: float = math.nan


def work_on(name: str, recording: str, output: str, setting: Setting, tell: Tell) -> Row:
    """Compute the skeletons of one recording, unless they exist.

    Parameters
    ----------
    name : str
        The recording's name within the archive.
    recording, output : str
        Its file, folder or URL; the skeletons' file.
    setting : Setting
    tell : callable
        Called with the fraction done.

    Returns
    -------
    Row
        State ``failed``, with the reason, if the recording is invalid or a bug occurs.

    Raises
    ------
    ConfigError, BankError
        Where no recording can be processed here: the bank or the version differs.
    """
    try:
        with fetched(recording) as local:
            marks = _marks(Path(local), setting)
            before = read_metadata(output, NOTE)
            if before is not None and all(before.get(key) == value for key, value in marks.items()):
                row = _remembered(name, before)
                if row is not None:
                    return row
            with _one_at_a_time:
                return _process(name, local, output, setting, marks, tell)
    except (ConfigError, BankError):
        raise
    except DepthPoseError as error:
        return failure(name, str(error))
    except OSError as error:
        return failure(name, f"{error.filename or recording}: {error.strerror or error}")
    except MemoryError as error:
        return failure(name, f"there is too little memory: {error}")
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{type(error).__name__}: {error} ({Path(where.filename).name}, line {where.lineno})"
        return failure(name, text)


def failure(name: str, reason: str) -> Row:
    """Make the row of a recording that failed."""
    return Row(name, "failed", warnings=(" ".join(reason.split()),))


def _process(
    name: str, recording: str, output: str, setting: Setting, marks: Mapping[str, str], tell: Tell
) -> Row:
    from depth_pose.io.mcap_read import DepthReader
    from depth_pose.passes import SecondPass

    reader = DepthReader(recording, setting.depth_topic, setting.images, tell=False)
    pipeline = _pipeline(setting)
    pipeline.restart()
    start = told = time.monotonic()

    def progress(done: int) -> None:
        nonlocal told
        now = time.monotonic()
        if now - told > _TELL_EVERY_S:
            told = now
            tell(done / max(setting.passes * len(reader), 1))

    def note(summary: RunSummary) -> dict[str, str]:
        return {**marks, "row": json.dumps(_facts(summary, reader.damage))}

    second = SecondPass(pipeline) if setting.passes > 1 else None
    summary = process_recording(reader, output, pipeline, progress, note, second=second)
    took = time.monotonic() - start
    row = Row(name, "done", **_facts(summary, reader.damage))
    return dataclasses.replace(row, ms=summary.median_ms, seconds=took, warnings=summary.warnings)


def _facts(summary: RunSummary, damage: Sequence[str]) -> dict[str, Any]:
    """Return the reproducible part of a summary, which goes into the output."""
    return {
        "frames": summary.frames,
        "people": summary.most_people,
        "answered": summary.answered,
        "confidence": summary.confidence,
        "warnings": summary.warnings,
        "damage": tuple(damage),
    }


def _remembered(name: str, note: Mapping[str, str]) -> Row | None:
    """Return the report row of a finished output; None if the output does not contain it."""
    try:
        facts = json.loads(note["row"])
        return Row(
            name,
            "skipped",
            frames=int(facts["frames"]),
            people=int(facts["people"]),
            answered=int(facts["answered"]),
            confidence=float(facts["confidence"]),
            warnings=tuple(map(str, facts["warnings"])),
            damage=tuple(map(str, facts["damage"])),
        )
    except (KeyError, TypeError, ValueError, OverflowError, RecursionError):
        return None


def _marks(recording: Path, setting: Setting) -> dict[str, str]:
    """Return what an output is made from."""
    return {
        "input": content_hash(recording),
        "bank": setting.bank_id,
        "settings": setting.digest,
        "version": setting.version,
    }


def content_hash(recording: Path) -> str:
    """Compute the hash of a recording's content, 32 hexadecimal digits.

    Covers each file's size and up to eight blocks of 1 MiB, evenly spread, including the beginning and the
    end, where MCAP has its index. File names are included where they define the images' stamps and order.
    """
    digest = hashlib.blake2b(digest_size=16)
    files = recording_files(recording)
    if not files:
        raise InputError(f"{recording} has no recording in it")
    for file in [*files, *_read_beside(recording, files)]:
        if file.suffix.lower() in IMAGE_ENDINGS:
            digest.update(os.fsencode(file.name) + b"/")
        size = file.stat().st_size
        digest.update(size.to_bytes(8, "little"))
        last = max(size - _BLOCK, 0)
        starts = {last * k // (_BLOCKS - 1) for k in range(_BLOCKS)}
        if size <= _BLOCK * _BLOCKS:
            starts = set(range(0, size, _BLOCK))
        with open_regular(file) as stream:
            for start in sorted(starts):
                stream.seek(start)
                digest.update(stream.read(_BLOCK))
    return digest.hexdigest()


def _read_beside(recording: Path, files: Sequence[Path]) -> list[Path]:
    """Return the files read beside a recording's own: metadata, the images' camera, SQLite's logs."""
    beside = [recording / METADATA, recording / CAMERA_FILE] if recording.is_dir() else []
    beside += [file.with_name(f"{file.name}-wal") for file in files]
    return [file for file in beside if file.is_file()]


_one_at_a_time = threading.Lock()
"""A Dask worker may have several threads, but there is one pipeline, and one BLAS limit, per process."""

_held: dict[tuple[str, str], PosePipeline] = {}
"""The pipeline of this process, by bank and settings: one at most."""


def _pipeline(setting: Setting) -> PosePipeline:
    """Return this process's pipeline; it is built for the first recording."""
    key = (setting.bank_id, setting.digest)
    if key not in _held:
        from depth_pose.bank import Bank, default_bank_path
        from depth_pose.pipeline import PosePipeline

        here = platform.node()
        if setting.version != __version__:
            raise ConfigError(
                f"{here} has depth_pose {__version__}, not {setting.version}: install that there"
            )
        path = setting.bank or default_bank_path()
        bank = Bank.load(path)
        if bank.bank_id != setting.bank_id:
            raise ConfigError(
                f"{path} on {here} is the bank {bank.bank_id}, not {setting.bank_id}; copy that there, or "
                "give --bank a path that all machines share"
            )
        _held.clear()
        pipeline = PosePipeline(bank, setting.config)
        pipeline.warm_up()
        _held[key] = pipeline
    return _held[key]
