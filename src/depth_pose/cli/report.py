"""``depth-pose report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from depth_pose.cli import shared
from depth_pose.cli.console import console, progress_bar
from depth_pose.core.printable import printable
from depth_pose.io.schemas import PEOPLE_TOPIC


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(report)


def report(
    skeletons: Annotated[Path, typer.Argument(help="Recording of skeletons, as `depth-pose run` writes it.")],
    output: Annotated[
        list[Path],
        typer.Option(
            "--output", "-o", help="The report: .html (a page with plots) or .csv; may be repeated for both."
        ),
    ],
    person: Annotated[
        list[str] | None, typer.Option(help="Only the person with this body_id; may be repeated.")
    ] = None,
    recording: Annotated[
        Path | None,
        typer.Option(
            help="The depth recording in which to find the floor.",
            show_default="the floor that `run` recorded, else estimated from feet",
        ),
    ] = None,
    topic: shared.SkeletonsTopic = PEOPLE_TOPIC,
    depth_topic: shared.DepthTopic = None,
) -> None:
    """Measure gait, rising from a chair, standing still and ranges of motion.

    For each person: speed, cadence, step length and width, stance and swing, symmetry; count and time of
    rises; sway; the least and the greatest of each joint angle. Each number has a standard deviation and
    says how many steps or frames it is of. What the recording does not show is not known, with the reason:
    too few steps, feet that are not seen, no floor.

    [bold]Examples:[/bold]

    depth-pose run walk.mcap -o skeletons.mcap

    depth-pose report skeletons.mcap -o report.html

    depth-pose report skeletons.mcap -o report.html -o report.csv --person body_1

    depth-pose report skeletons.mcap -o report.html --recording walk.mcap

    depth-pose simulate -o walk.mcap --motion walk_straight --seconds 4 --wall 4
    """
    from depth_pose.analysis.report import analyse_recording
    from depth_pose.analysis.write import check_report, write_report

    check_report(output, [skeletons, recording])
    with progress_bar(skeletons.name, None) as update:
        found = analyse_recording(
            skeletons,
            people=person or (),
            recording=recording,
            topic=topic,
            depth_topic=depth_topic,
            progress=update,
        )
    _say(f"the floor is {escape(printable(found.floor))}")
    for one in found.people:
        known = [m for m in one.measures if m.is_known]
        _say(f"{escape(printable(one.body_id))}: {len(known)} of {len(one.measures)} measures are known")
        for reason in dict.fromkeys(
            m.reason for m in one.measures if m.group != "range of motion" and m.reason
        ):
            _say(f"  [yellow]not known:[/yellow] {escape(printable(reason))}")
    for path in output:
        write_report(found, path)
        _say(f"wrote {escape(printable(path))}")


def _say(line: str) -> None:
    console.print(line, highlight=False, soft_wrap=True)
