"""``depth-pose bank``: build exemplar banks, inspect them, and show what they match."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from depth_pose.cli import shared
from depth_pose.cli.console import check_ending, console, errors, print_facts, progress_bar, say
from depth_pose.core.errors import ConfigError
from depth_pose.core.extras import require
from depth_pose.core.outputs import check_targets
from depth_pose.core.printable import printable

if TYPE_CHECKING:
    from depth_pose.bank import Bank
    from depth_pose.bank.build import BuildConfig
    from depth_pose.bank.sources import PoseSources
    from depth_pose.motion.motion_files import FileReport

app = typer.Typer(help="Exemplar banks: the poses that inputs are compared with.", no_args_is_help=True)

_MOST_FAMILIES = 12
"""Number of motion families listed; the others are summed. For readability."""


@app.command()
def build(
    output: Annotated[Path, typer.Option("--output", "-o", help="The bank file.", show_default=False)],
    mocap: Annotated[
        Path | None,
        typer.Option(
            help="Use the poses of this folder's BVH and ASF/AMC files instead of the embedded ones.",
            metavar="DIR",
        ),
    ] = None,
    with_embedded: Annotated[
        bool, typer.Option("--with-embedded", help="With --mocap: add the embedded poses.")
    ] = False,
    body: Annotated[
        str, typer.Option(help="The body: embedded, anny, or a .npz, .glb or .gltf file.")
    ] = "embedded",
    poses: Annotated[
        int | None,
        typer.Option(
            min=10,
            max=1_000_000,
            help="Number of embedded poses; maximum of motion capture, chosen for coverage.",
            show_default="10000; all",
        ),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of the embedded poses.", show_default="1")
    ] = None,
    views: Annotated[
        str | None,
        typer.Option(
            help="partial: visible points from all around; paper: principal axes of the whole body.",
            show_default="partial",
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=0, help="Number of processes; 0: only this one.", show_default="all cores"),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(help="Render on the Dask cluster with this scheduler.", metavar="ADDRESS"),
    ] = None,
) -> None:
    """Build an exemplar bank.

    [bold]Examples:[/bold]

    depth-pose bank build -o new.npz

    depth-pose bank build --mocap captures/ --with-embedded -o my_bank.npz

    depth-pose bank build --mocap captures/ --scheduler tcp://head:8786 -o my.npz

    depth-pose run in.mcap -o out.mcap --bank my_bank.npz
    """
    from depth_pose.bank import build_bank
    from depth_pose.bank.bodies import find_body_or_bank
    from depth_pose.bank.build import BuildConfig

    if with_embedded and mocap is None:
        raise ConfigError("--with-embedded needs --mocap")
    is_file = body not in ("embedded", "anny")
    check_targets([output], [mocap, body if is_file else None])
    check_ending(output, ".npz", "a bank")
    chosen: dict[str, Any] = {"poses": poses, "seed": seed, "views": views}
    config = BuildConfig(**{name: value for name, value in chosen.items() if value is not None})
    start = time.monotonic()
    made = find_body_or_bank(body)
    require("open3d", "a bank's views")
    sources = _gather(config, poses, mocap, with_embedded or mocap is None)
    source = {**sources.header, "body": body if body in ("embedded", "anny") else made.name}
    with progress_bar("rendering views", len(sources.poses)) as update:
        bank = build_bank(
            made, sources.poses.rotations, config, source, lambda done, _: update(done), workers, scheduler
        )
    bank.save(output)
    _print_files(sources.reports)
    _print_bank(output, bank)
    console.print(f"built in {time.monotonic() - start:.0f} s", style="dim", highlight=False)


def _gather(config: BuildConfig, poses: int | None, mocap: Path | None, embedded: bool) -> PoseSources:
    """Collect the poses, with a progress bar."""
    from depth_pose.bank.sources import gather_poses

    with progress_bar("gathering poses", 100) as update:
        return gather_poses(
            poses, config.seed, mocap, embedded, config.poses, lambda share: update(int(100 * share))
        )


@app.command()
def info(
    file: Annotated[
        Path | None, typer.Argument(help="The bank file.", show_default="the default bank")
    ] = None,
    sheet: Annotated[
        Path | None, typer.Option(help="Draw a contact sheet of its exemplars.", metavar="PNG")
    ] = None,
    count: Annotated[int, typer.Option(min=1, max=400, help="Number of exemplars on the sheet.")] = 48,
) -> None:
    """Check a bank file and print its content.

    [bold]Examples:[/bold]

    depth-pose bank info

    depth-pose bank info my_bank.npz --sheet exemplars.png
    """
    from depth_pose.bank import Bank, default_bank_path
    from depth_pose.evaluate.pictures import check_picture

    path = file or default_bank_path()
    check_picture(sheet, [path])
    bank = Bank.load(path)
    _print_bank(path, bank)
    if sheet is not None:
        from depth_pose.evaluate.bank_sheet import save_contact_sheet

        save_contact_sheet(bank, sheet, count)
        say(f"wrote {sheet}")


@app.command()
def check(
    recording: Annotated[Path, typer.Argument(help="A depth recording.", metavar="BAG")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The picture.", metavar="PNG")],
    bank: Annotated[Path | None, typer.Option(help="The bank file.", show_default="the default bank")] = None,
    frames: Annotated[
        int, typer.Option(min=1, max=50, help="Number of frames, spread over the recording.")
    ] = 6,
    candidates: Annotated[int, typer.Option(min=1, max=10, help="Matches shown beside each frame.")] = 3,
    depth_topic: shared.DepthTopic = None,
) -> None:
    """Draw inputs beside their best matches in a bank.

    A match's score is the disagreement of rendered and observed depth, 0 to 1: lower is better.

    [bold]Examples:[/bold]

    depth-pose bank check in.mcap -o matches.png

    depth-pose bank check in.mcap -o matches.png --bank my_bank.npz --frames 10
    """
    from depth_pose.bank import Bank, default_bank_path
    from depth_pose.evaluate.bank_check import match_frames, save_check
    from depth_pose.evaluate.pictures import check_picture

    check_picture(output, [recording, bank or default_bank_path()])
    loaded = Bank.load(bank or default_bank_path())
    with progress_bar("matching", frames) as update:
        matched = match_frames(loaded, recording, frames, candidates, depth_topic, update)
    save_check(matched, loaded, output, recording.stem)
    for line in matched.lines():
        say(line)
    say(f"wrote {output}")


def _print_files(reports: tuple[FileReport, ...]) -> None:
    """Print what each motion file contributed; refused files are highlighted."""
    for report in reports:
        style = "yellow" if report.refused else "dim"
        errors.print(printable(report), style=style, highlight=False, markup=False)


def _print_bank(path: Path, bank: Bank) -> None:
    source: dict[str, Any] = dict(bank.source)
    dimensions = str(len(bank.components))
    explained = source.pop("explained_variance", None)
    if explained is not None:
        dimensions += f", {100 * explained:.1f} % of the variance"
    families = source.pop("families", None)
    facts = [
        ("id", bank.bank_id),
        ("poses", str(bank.poses)),
        ("views", f"{bank.views} of each, {source.pop('views', 'partial')}"),
        ("dimensions", dimensions),
        ("body", f"{bank.body.name}, {bank.body.stature:.2f} m, {len(bank.body.vertices)} vertices"),
        ("size", f"{path.stat().st_size / 1e6:.1f} MB"),
    ]
    facts += [(f"source: {name}", str(value)) for name, value in source.items()]
    if isinstance(families, dict):
        facts.append(("families", _list_families(families)))
    print_facts(str(path), facts)


def _list_families(families: dict[str, int]) -> str:
    """Format the sizes of families, largest first."""
    largest = sorted(families.items(), key=lambda item: -item[1])
    text = ", ".join(f"{name} {count}" for name, count in largest[:_MOST_FAMILIES])
    rest = sum(count for _, count in largest[_MOST_FAMILIES:])
    return text + (f", {len(largest) - _MOST_FAMILIES} others {rest}" if rest else "")
