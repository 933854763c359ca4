"""The report of an archive: ``report.csv``, a line for each recording."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from depth_pose.archive.jobs import Row
from depth_pose.core.errors import InputError

REPORT = "report.csv"
"""Name of the file."""

COLUMNS = (
    "file",
    "state",
    "frames",
    "people",
    "answered",
    "confidence",
    "ms_per_frame",
    "seconds",
    "warnings",
)
"""Of the report. ``people`` are the most in one frame, ``answered`` the frames that show somebody,
``confidence`` the mean over all skeletons, ``ms_per_frame`` the median in the pipeline, ``seconds`` all
the time that the recording took, reading and writing too."""


class Report:
    """Writes the report: a line as soon as a recording is done, all in their order at the end.

    What a recording took stands in no output, so that outputs are the same each time; for those that
    were done before it is taken from the report that is there.

    Parameters
    ----------
    path : Path
        The file; folders are made.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._before = _read_times(path)
        self.rows: dict[str, Row] = {}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            is_new = not path.exists()
            self._stream = path.open("a", newline="", buffering=1)
        except OSError as error:
            raise InputError(f"{path} cannot be written: {error.strerror}") from error
        self._writer = csv.writer(self._stream)
        if is_new:
            self._writer.writerow(COLUMNS)

    def add(self, row: Row) -> None:
        """Add the row of a recording that is done."""
        if row.state == "skipped" and row.file in self._before:
            ms, seconds = self._before[row.file]
            row = replace(row, ms=ms, seconds=seconds)
        self.rows[row.file] = row
        self._writer.writerow(_cells(row))

    def finish(self, order: Iterable[str]) -> list[Row]:
        """Write the rows of the recordings that were reached in this order, and give them."""
        self._stream.close()
        rows = [self.rows[name] for name in order if name in self.rows]
        part = self.path.with_name(f".{self.path.name}.part")
        with part.open("w", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow(COLUMNS)
            writer.writerows(map(_cells, rows))
        os.replace(part, self.path)
        return rows


def _cells(row: Row) -> list[str]:
    failed = row.state == "failed"
    counts = ["", "", ""] if failed else [str(n) for n in (row.frames, row.people, row.answered)]
    return [
        row.file,
        row.state,
        *counts,
        _number(row.confidence, 3),
        _number(row.ms, 2),
        _number(row.seconds, 2),
        "; ".join(row.warnings),
    ]


def _number(value: float, digits: int) -> str:
    return "" if math.isnan(value) else f"{value:.{digits}f}"


def _read_times(path: Path) -> dict[str, tuple[float, float]]:
    """Read what each recording took from a report; nothing where there is none, or another file."""
    times = {}
    try:
        with path.open(newline="") as stream:
            for line in csv.DictReader(stream):
                if line.get("ms_per_frame") and line.get("seconds"):
                    times[line["file"]] = (float(line["ms_per_frame"]), float(line["seconds"]))
    except (OSError, ValueError, KeyError, csv.Error):
        return {}
    return times
