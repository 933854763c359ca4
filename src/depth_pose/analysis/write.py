"""Reports as files: HTML for people, CSV for spreadsheets."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from depth_pose.analysis.measures import Measure
from depth_pose.analysis.report import Report
from depth_pose.core.errors import ConfigError
from depth_pose.core.extras import require
from depth_pose.core.outputs import check_targets, new_text_file

REPORT_FORMATS = {".html": "a page with plots, for people", ".csv": "a row a measure, for spreadsheets"}
"""Formats of a report by file extension."""

CSV_COLUMNS = (
    *("body_id", "group", "measure", "side", "value", "deviation", "unit", "count", "of", "frames", "reason"),
)
"""Columns of a report as CSV."""


def check_report(paths: Sequence[Path], inputs: Sequence[Path | str | None]) -> None:
    """Refuse reports that cannot be written, before any work.

    Raises
    ------
    ConfigError
        Where an extension is not of `REPORT_FORMATS`, or matplotlib is not installed for a page.
    InputError
        As for `depth_pose.core.outputs.check_targets`.
    """
    for path in paths:
        if path.suffix.lower() not in REPORT_FORMATS:
            raise ConfigError(
                f"{path}: the format is inferred from the file extension, one of {', '.join(REPORT_FORMATS)}"
            )
        if path.suffix.lower() == ".html":
            require("matplotlib", "a report with plots")
    check_targets(paths, inputs)


def write_report(report: Report, path: Path) -> None:
    """Write a report in the format of the file extension, one of `REPORT_FORMATS`."""
    if path.suffix.lower() == ".csv":
        with new_text_file(path, newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(CSV_COLUMNS)
            for person in report.people:
                writer.writerows(_row(person.body_id, measure) for measure in person.measures)
        return
    from depth_pose.analysis.page import page_of

    with new_text_file(path) as stream:
        stream.write(page_of(report))


def _row(body_id: str, measure: Measure) -> list[object]:
    known = replace(measure, value=round(measure.value, 6), deviation=round(measure.deviation, 6))
    value = [known.value, known.deviation] if measure.is_known else ["", ""]
    return [
        *(body_id, measure.group, measure.name, measure.side, *value, measure.unit),
        *(measure.count, measure.of, measure.frames, measure.reason),
    ]
