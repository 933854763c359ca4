"""``depth-pose export``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from depth_pose.cli import shared
from depth_pose.cli.console import console
from depth_pose.core.printable import printable
from depth_pose.io.schemas import PEOPLE_TOPIC

if TYPE_CHECKING:
    from depth_pose.export import Exported
    from depth_pose.export.tracks import Presence


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(export)


def export(
    skeletons: Annotated[Path, typer.Argument(help="Recording of skeletons, as `depth-pose run` writes it.")],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="The file; its extension is the format: .bvh .trc .c3d .mot .sto .csv .json .npz",
        ),
    ],
    person: Annotated[
        list[str] | None, typer.Option(help="Only the person with this body_id; may be repeated.")
    ] = None,
    fill: Annotated[bool, typer.Option("--fill", help="Interpolate poses in gaps.")] = False,
    world: Annotated[
        str, typer.Option(help="camera, or floor: z = 0 on the floor, x forward, y left, z up (REP-103).")
    ] = "camera",
    recording: Annotated[
        Path | None,
        typer.Option(
            help="With --world floor: the depth recording in which to find the floor.",
            show_default="the floor that `run` recorded, else estimated from feet",
        ),
    ] = None,
    unit: Annotated[
        str | None,
        typer.Option(help="m, cm or mm, of .bvh, .trc and .c3d.", show_default="m of .bvh, else mm"),
    ] = None,
    angles: Annotated[
        bool, typer.Option("--angles", help="Of .csv: joint angles with deviations, a row a person a frame.")
    ] = False,
    topic: shared.SkeletonsTopic = PEOPLE_TOPIC,
    depth_topic: shared.DepthTopic = None,
) -> None:
    """Write skeletons for other tools: animation, OpenSim, motion laboratories, spreadsheets, programs.

    A .bvh, .trc, .c3d, .mot or .sto holds one person; several people get one file each, NAME_ID.bvh, with the
    bone lengths of that person. y is up, as importers expect. .csv, .json and .npz hold everybody, in
    metres, in the sensor's optical frame (x right, y down, z forward) or the floor's. Skeletons of `run
    --rig` stay in the room's frame (z up, z = 0 on the floor).

    Gaps in which a person was not found are reported. Without --fill .bvh keeps the last pose, .trc, .c3d,
    .mot and .npz have NaN, .csv, .json and .sto leave them out.

    [bold]Examples:[/bold]

    depth-pose run in.mcap -o out.mcap

    depth-pose export out.mcap -o dance.bvh --world floor --recording in.mcap

    depth-pose export out.mcap -o gait.trc --world floor --fill

    depth-pose export out.mcap -o gait.mot --world floor

    depth-pose export out.mcap -o gait.c3d --world floor

    depth-pose export out.mcap -o joints.csv

    depth-pose export out.mcap -o angles.csv --angles --world floor

    depth-pose export out.mcap -o joints.npz --person body_1

    depth-pose export room.mcap -o room.bvh
    """
    from depth_pose.export import export_skeletons
    from depth_pose.export.tracks import describe_gaps
    from depth_pose.rooms.rig import ROOM_FRAME

    result = export_skeletons(
        skeletons,
        output,
        people=person or (),
        fill=fill,
        world=world,
        recording=recording,
        unit=unit,
        angles=angles,
        topic=topic,
        depth_topic=depth_topic,
    )
    if result.floor is not None:
        floor, how = result.floor, result.floor.source
        _say(
            f"the floor, known from {how}, is {floor.height:.2f} m below the sensor; under the people "
            f"it is known to {100 * floor.deviation:.0f} cm, and to {floor.tilt_deviation_deg:.1f} degrees"
        )
        if recording is not None and how == "feet":
            _say(
                "[yellow]note:[/yellow] too little floor is visible in the images; it was estimated from feet"
            )
        elif how == "feet":
            _say("[yellow]note:[/yellow] that is rough; with --recording IN it is found in the depth images")
    if result.frame_id == ROOM_FRAME:
        _say("the skeletons are in the room's frame, with the floor at height 0")
    for file in result.files:
        _say(f"wrote {escape(printable(file.path))}: {file.frames} frames at {file.rate_hz:.1f} a second")
        for track in file.tracks:
            _say(f"  {escape(printable(_describe(track, file)))}")
            gaps = describe_gaps(track)
            if gaps:
                _say(f"  [yellow]{escape(_treated(file.path.suffix.lower(), fill))}[/yellow] {gaps}")


def _describe(track: Presence, file: Exported) -> str:
    since = (int(track.stamps_ns[0]) - file.start_ns) * 1e-9
    return (
        f"{track.body_id}: {int(track.present.sum())} frames, {track.seconds:.2f} s"
        f" from second {since:.2f}, frame {round(since * file.rate_hz) + 1}, on"
    )


def _treated(kind: str, fill: bool) -> str:
    """Print how gaps were filled."""
    if fill:
        return "bridged"
    return {".bvh": "held", ".csv": "left out", ".json": "left out", ".sto": "left out"}.get(kind, "NaN")


def _say(line: str) -> None:
    console.print(line, highlight=False, soft_wrap=True)
