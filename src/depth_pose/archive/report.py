"""The report of an archive: ``report.csv``, one line per recording."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TextIO

from depth_pose.archive.jobs import Row
from depth_pose.core.errors import InputError
from depth_pose.core.outputs import new_text_file

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
"""Columns of the report. ``people`` is the maximum in one frame, ``answered`` the frames with a skeleton,
``confidence`` the mean over all skeletons, ``ms_per_frame`` the median in the pipeline, ``seconds`` the
total time of the recording, including reading and writing."""


class Report:
    """Writes the report: one line per finished recording, rewritten in input order at the end.

    The file is created with the first line.

    Outputs do not contain processing times, so that they are reproducible; for recordings that were
    done before, times are taken from the existing report.

    Parameters
    ----------
    path : Path
        The file; folders are made.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._before = _read_lines(path)
        self.rows: dict[str, Row] = {}
        self._stream: TextIO | None = None

    def add(self, row: Row) -> None:
        """Add the row of a finished recording."""
        if row.state == "skipped" and _plain(row.file) in self._before:
            line = self._before[_plain(row.file)]
            row = replace(row, ms=_value(line["ms_per_frame"]), seconds=_value(line["seconds"]))
        self.rows[row.file] = row
        try:
            if self._stream is None:
                self._stream = self._open()
            csv.writer(self._stream).writerow(_cells(row))
        except OSError as error:
            raise InputError(f"{self.path} cannot be written: {error.strerror}") from error

    def _open(self) -> TextIO:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        is_new = not self.path.exists()
        stream = self.path.open("a", encoding="utf-8", newline="", buffering=1)
        if is_new:
            csv.writer(stream).writerow(COLUMNS)
        return stream

    def finish(self, order: Iterable[str]) -> list[Row]:
        """Write the recordings in this order, and return the rows of those that were processed.

        For the others, the lines of the previous report are kept.
        """
        if self._stream is None:
            return []
        with suppress(OSError):  # a full disk, already reported
            self._stream.close()
        order = list(order)
        with new_text_file(self.path, newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow(COLUMNS)
            for name in order:
                if name in self.rows:
                    writer.writerow(_cells(self.rows[name]))
                elif _plain(name) in self._before:
                    writer.writerow(self._before[_plain(name)].values())
        return [self.rows[name] for name in order if name in self.rows]


def _cells(row: Row) -> list[str]:
    failed = row.state == "failed"
    counts = ["", "", ""] if failed else [str(n) for n in (row.frames, row.people, row.answered)]
    return [
        _plain(row.file),
        row.state,
        *counts,
        _number(row.confidence, 3),
        _number(row.ms, 2),
        _number(row.seconds, 2),
        _plain("; ".join(row.warnings)),
    ]


def _plain(text: str) -> str:
    """Return text for a report; bytes of file names that are not UTF-8 are escaped."""
    return text.encode("utf-8", "backslashreplace").decode()


def _number(value: float, digits: int) -> str:
    return "" if math.isnan(value) else f"{value:.{digits}f}"


def _value(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _read_lines(path: Path) -> dict[str, dict[str, str]]:
    """Read the last line of each recording from a report; empty if there is no report."""
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            lines = csv.DictReader(stream)
            if tuple(lines.fieldnames or ()) != COLUMNS:
                return {}
            return {line["file"]: line for line in lines if None not in (*line, *line.values())}
    except (OSError, ValueError, csv.Error):
        return {}
