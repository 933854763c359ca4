"""Process all recordings of an archive, on all cores or a cluster."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from depth_pose.archive.inputs import ENDING, Source
from depth_pose.archive.jobs import Row, Setting, failure, work_on
from depth_pose.core.errors import DepthPoseError, InputError
from depth_pose.core.outputs import refuse_inputs, remove_parts
from depth_pose.core.workers import run_each
from depth_pose.io.recording import recording_files


@dataclass(frozen=True)
class Progress:
    """Progress: recordings done, frames processed in them, and bytes done overall."""

    recordings: int
    frames: int
    size: float


def output_of(source: Source, folder: Path) -> Path:
    """Return the output file of a recording."""
    return folder / f"{source.name}{ENDING}"


def process_archive(
    sources: Sequence[Source],
    folder: Path,
    setting: Setting,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[Progress], None] | None = None,
    collect: Callable[[Row], None] | None = None,
) -> list[Row]:
    """Compute the skeletons of many recordings; finished ones are left as they are.

    A recording's skeletons are bit-identical to those of a single run, and its file is written
    completely or not at all.

    Parameters
    ----------
    sources : sequence of Source
    folder : Path
        Where the skeletons go, ``folder/NAME.mcap``.
    setting : Setting
    workers : int, optional
        Processes; all cores by default, 0 works in this process.
    scheduler : str, optional
        Address of a Dask scheduler; its workers see the same files under the same paths.
    progress : callable, optional
        Called with the progress.
    collect : callable, optional
        Called with each row when it is done, so that finished rows survive an interruption.

    Returns
    -------
    list of Row
        In the order of the sources.

    Raises
    ------
    ConfigError, BankError
        Where no recording can be processed: the bank or the version of a worker differs.
    InputError
        Where an output would be one of the recordings, or the cluster is unreachable or lost.
    """
    files = [file for source in sources if not source.url for file in recording_files(source.path)]
    refuse_inputs((output_of(source, folder) for source in sources), files)
    # largest first, so that no long job starts last
    order = sorted(sources, key=lambda source: -source.size)
    absolute = folder.resolve()
    tasks = [(s.name, s.place, str(output_of(s, absolute)), setting) for s in order]
    rows: dict[str, Row] = {}
    shares = [0.0] * len(order)
    frames, size = 0, 0.0

    def listen(index: int, share: float) -> None:
        nonlocal size
        size += (share - shares[index]) * order[index].size
        shares[index] = share
        if progress:
            progress(Progress(len(rows), frames, size))

    try:
        with closing(run_each(work_on, tasks, workers, scheduler, listen)) as outcomes:
            for outcome in outcomes:
                row = outcome.value or _failed(order[outcome.index].name, outcome.error)
                rows[row.file] = row
                frames += row.frames if row.state == "done" else 0
                if collect:
                    collect(row)
                listen(outcome.index, 1.0)
    finally:
        # on an interruption, a cluster's workers finish what they have begun
        if scheduler is None or len(rows) == len(sources):
            remove_parts(output_of(source, folder) for source in sources)
    return [rows[source.name] for source in sources]


def _failed(name: str, error: Exception | None) -> Row:
    if isinstance(error, DepthPoseError) and not isinstance(error, InputError):
        raise error
    return failure(name, str(error))
