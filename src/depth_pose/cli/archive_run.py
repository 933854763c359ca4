"""``depth-pose run`` of many recordings to a folder."""

from __future__ import annotations

import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from depth_pose.cli import STOPPED
from depth_pose.cli.console import archive_bar, console, errors, print_facts, warn
from depth_pose.core.config import PipelineConfig
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.extras import require
from depth_pose.core.outputs import check_targets, own_folder
from depth_pose.core.printable import printable
from depth_pose.io.damage import tell_damage
from depth_pose.io.image_options import ImageOptions

if TYPE_CHECKING:
    from depth_pose.archive.inputs import Source
    from depth_pose.archive.jobs import Row, Setting

_MOST_ROWS = 40
"""Maximum rows of the printed table; with more recordings it lists only those with warnings."""


def run_archive(
    inputs: list[str],
    folder: Path,
    bank: Path | None,
    depth_topic: str | None,
    images: ImageOptions,
    config: PipelineConfig,
    workers: int | None,
    cluster: str | None,
    passes: int,
) -> None:
    """Run many recordings to a folder."""
    from depth_pose.archive.inputs import find_sources
    from depth_pose.archive.report import REPORT
    from depth_pose.archive.sheet import SHEET

    if workers is not None and cluster is not None:
        raise ConfigError("give either --workers (processes of this machine) or --cluster (its own workers)")
    sources = find_sources(inputs, folder)
    if folder.suffix == ".mcap" or folder.is_file():
        raise ConfigError(f"the skeletons of several recordings go to a folder; {folder} is a file's name")
    check_targets([folder / REPORT, folder / SHEET], [bank])

    from depth_pose.archive.jobs import Setting
    from depth_pose.bank import Bank, default_bank_path

    bank_id = Bank.load(bank or default_bank_path()).bank_id
    setting = Setting(str(bank.resolve()) if bank else None, bank_id, config, depth_topic, images, passes)
    start = time.monotonic()
    with own_folder(folder):
        rows = _work_through(sources, folder, setting, workers, cluster)
        _print_rows(rows)
        is_drawn = _draw(sources, rows, folder, depth_topic, images)
    _print_total(rows, folder, time.monotonic() - start)
    tell_damage(f"{row.file}: {line}" for row in rows for line in row.damage)
    if not is_drawn or any(row.state == "failed" for row in rows):
        raise typer.Exit(1)


def _work_through(
    sources: list[Source], folder: Path, setting: Setting, workers: int | None, cluster: str | None
) -> list[Row]:
    """Compute the skeletons of all recordings, with a progress bar and a report."""
    from depth_pose.archive.process import Progress, process_archive
    from depth_pose.archive.report import REPORT, Report

    report = Report(folder / REPORT)
    size = sum(source.size for source in sources)
    names = [source.name for source in sources]
    try:
        with archive_bar("recordings", size, len(sources)) as update:

            def tell(at: Progress) -> None:
                update(at.size, at.recordings, at.frames)

            process_archive(sources, folder, setting, workers, cluster, tell, report.add)
    except KeyboardInterrupt:
        rows = report.finish(names)
        errors.print(
            f"stopped; {len(rows)} of {len(sources)} recordings are done; the same command continues"
        )
        raise typer.Exit(STOPPED) from None
    except BaseException:
        report.finish(names)
        raise
    return report.finish(names)


def _draw(
    sources: list[Source], rows: list[Row], folder: Path, depth_topic: str | None, images: ImageOptions
) -> bool:
    """Draw the sheet if anything is new; return False if that failed."""
    from depth_pose.archive.sheet import SHEET, save_archive_sheet

    if all(row.state != "done" for row in rows):
        return True
    here = [(source, row) for source, row in zip(sources, rows, strict=True) if not source.url]
    made = [source for source, row in here if row.state != "failed" and row.people]
    if not made:
        return True
    try:
        require("matplotlib", f"the picture {SHEET}")
    except ConfigError as error:
        warn([str(error)])
        return True
    try:
        with console.status("drawing the sheet"):
            save_archive_sheet(made, folder, folder / SHEET, depth_topic, images)
    except InputError as error:
        warn([f"no picture: {error}"])
        return False
    return True


def _print_rows(rows: list[Row]) -> None:
    """Print a table of the recordings and their warnings; for many, only those with warnings."""
    from rich.markup import escape
    from rich.table import Table

    warned = [row for row in rows if row.warnings][:_MOST_ROWS]
    shown = rows if len(rows) <= _MOST_ROWS else warned
    if not shown:
        return
    table = Table()
    for name in ("file", "state"):
        table.add_column(name)
    for name in ("frames", "people", "answered", "confidence", "ms"):
        table.add_column(name, justify="right")
    for row in shown:
        counts = ("", "", "") if row.state == "failed" else (row.frames, row.people, row.answered)
        numbers = ("" if value != value else f"{value:.2f}" for value in (row.confidence, row.ms))
        colour = {"failed": "red", "skipped": "dim"}.get(row.state, "green")
        table.add_row(
            escape(printable(row.file)),
            f"[{colour}]{row.state}[/]",
            *map(str, counts),
            *numbers,
        )
    console.print(table)
    warn(f"{row.file}: {line}" for row in warned for line in row.warnings if line not in row.damage)


def _print_total(rows: list[Row], folder: Path, seconds: float) -> None:
    counts = Counter(row.state for row in rows)
    frames = sum(row.frames for row in rows if row.state == "done")
    facts = [
        ("recordings", ", ".join(f"{counts[s]} {s}" for s in ("done", "skipped", "failed") if counts[s])),
        ("frames", f"{frames} in {seconds:.0f} s, {frames / seconds:.1f} a second"),
    ]
    print_facts(str(folder), facts)
