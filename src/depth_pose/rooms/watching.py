"""Run each camera's pipeline over its recording and spool every frame's people and poses to a file."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from depth_pose.bank.bank import Bank
from depth_pose.core.config import PipelineConfig
from depth_pose.core.errors import InputError
from depth_pose.core.workers import run_each
from depth_pose.io.image_options import ImageOptions
from depth_pose.io.mcap_read import DepthReader
from depth_pose.pipeline import PosePipeline
from depth_pose.rooms.camera_frame import CameraFrame


@dataclass(frozen=True)
class Watched:
    """Result of one camera's recording.

    Attributes
    ----------
    spool : Path
        Its frames; read with `read_spool`.
    frames : int
        Frames of the recording, including unusable ones.
    dropped : int
        Unusable ones; `warnings` say why.
    stamps_ns : tuple of int
        Of the spooled frames.
    warnings, damage : tuple of str
        One line each.
    """

    spool: Path
    frames: int
    dropped: int
    stamps_ns: tuple[int, ...]
    warnings: tuple[str, ...]
    damage: tuple[str, ...]


@dataclass(frozen=True)
class Watch:
    """Settings of the runs.

    Attributes
    ----------
    bank : Path
    config : PipelineConfig
    depth_topic : str or None
        By default the only one.
    images : ImageOptions
    """

    bank: Path
    config: PipelineConfig
    depth_topic: str | None
    images: ImageOptions


def watch_all(
    recordings: Sequence[Path],
    watch: Watch,
    folder: Path,
    workers: int | None = None,
    listen: Callable[[int, float], None] | None = None,
) -> list[Watched]:
    """Run each camera's pipeline over its recording; the frames are the same with any number of workers.

    Parameters
    ----------
    recordings : sequence of Path
    watch : Watch
    folder : Path
        For the spools.
    workers : int, optional
        Processes; all cores by default, 0 works in this process.
    listen : callable, optional
        Called with a recording's number and the share done.

    Raises
    ------
    InputError
        Where a recording has no usable frame, or the disk is full.
    """
    tasks = [(path, watch, folder / f"{k}.spool") for k, path in enumerate(recordings)]
    done: dict[int, Watched] = {}
    with closing(run_each(_watch, tasks, workers, listen=listen)) as outcomes:
        for outcome in outcomes:
            if outcome.error is not None:
                raise outcome.error
            assert outcome.value is not None, "a part has a value or an error"
            done[outcome.index] = outcome.value
    return [done[k] for k in range(len(tasks))]


def _watch(path: Path, watch: Watch, spool: Path, tell: Callable[[float], None]) -> Watched:
    """Run one camera's pipeline over its recording."""
    reader = DepthReader(path, watch.depth_topic, watch.images, tell=False)
    pipeline = PosePipeline(Bank.load(watch.bank), watch.config)
    stamps, refused = [], dict[str, int]()
    try:
        with spool.open("wb") as stream:
            for frame in reader:
                height, width = frame.depth.shape
                try:
                    result = pipeline.process_frame(frame)
                except InputError as error:
                    refused[str(error)] = refused.get(str(error), 0) + 1
                    continue
                pickle.dump(CameraFrame.of(result, (width, height)), stream)
                stamps.append(frame.stamp_ns)
                tell(len(stamps) / max(len(reader), 1))
    except OSError as error:
        raise InputError(
            f"{spool.parent} has no room for what {path} shows ({error.strerror}): let TMPDIR name a folder "
            "with more"
        ) from error
    lines = [f"{count} frames of {path} were dropped: {reason}" for reason, count in refused.items()]
    lines = [*reader.warnings, *(f"{path}: {line}" for line in pipeline.warnings), *lines]
    if not stamps:
        raise InputError("; ".join(lines))
    dropped = reader.dropped + sum(refused.values())
    return Watched(spool, len(stamps) + dropped, dropped, tuple(stamps), tuple(lines), tuple(reader.damage))


def read_spool(path: Path) -> Iterator[CameraFrame]:
    """Yield the frames of a spool of `watch_all`, in order."""
    with path.open("rb") as stream:
        while stream.peek(1):
            yield pickle.load(stream)  # our own file
