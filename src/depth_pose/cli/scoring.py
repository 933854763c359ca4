"""``depth-pose eval`` and ``depth-pose overlay``."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from depth_pose.cli import shared
from depth_pose.cli.console import console, print_facts, say
from depth_pose.io.schemas import PEOPLE_TOPIC, SKELETON_TOPIC

if TYPE_CHECKING:
    from rich.table import Table

    from depth_pose.evaluate.score import Score


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    app.command(name="eval")(evaluate)
    app.command()(overlay)


def evaluate(
    truth: Annotated[
        Path,
        typer.Argument(help="True joints: a .npz of `simulate`, a folder of them, or a .json of pixels."),
    ],
    predicted: Annotated[Path, typer.Argument(help="Recording of skeletons, or a folder with NAME.mcap.")],
    topic: Annotated[
        str | None,
        typer.Option(
            help="The skeletons' topic.",
            show_default=f"{PEOPLE_TOPIC} if the truth has several people, else {SKELETON_TOPIC}",
        ),
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Picture of the error per joint (PNG).")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print all numbers as JSON.")] = False,
    recording: Annotated[
        Path | None, typer.Option(help="The depth recording, needed with a .json of pixels.")
    ] = None,
    depth_topic: Annotated[
        str | None, typer.Option(help="With --recording: its depth topic.", show_default="the only one")
    ] = None,
) -> None:
    """Score skeletons against true joints.

    For one person: coverage is the share of frames with a skeleton; mean, median and 95 % are distances
    from the known joints; offset-free subtracts each joint's mean offset, since bodies differ in
    where a joint is; PCK 10 cm is the share of joints within 10 cm.

    For several people: the share of people (of whom at least .3 is visible) that are found (recall), the
    share of skeletons that belong to a person (precision), those that do not (false), how often ids
    change (switches), the share under one id (IDF1), and the error of the people found. For skeletons in
    a room's frame (`run --rig`) the truth is that of `simulate --room --cameras`.

    [bold]Examples:[/bold]

    depth-pose eval truth/ skeletons/ --plot errors.png

    depth-pose eval clip.npz out.mcap --json

    depth-pose eval room.npz room_skeletons.mcap

    depth-pose eval joints_2d.json out.mcap --recording in.mcap
    """
    from depth_pose.evaluate.pictures import check_picture

    check_picture(plot, [truth, predicted, recording])
    if truth.suffix == ".json":
        if plot:
            raise typer.BadParameter("--plot needs 3D truth; this truth is in pixels")
        _evaluate_2d(truth, predicted, recording, topic or SKELETON_TOPIC, depth_topic, as_json)
        return
    from depth_pose.evaluate.truth import tells_of_people

    if tells_of_people(truth):
        if plot:
            raise typer.BadParameter("--plot is for one person; this truth has several")
        _evaluate_people(truth, predicted, topic or PEOPLE_TOPIC, as_json)
        return
    from depth_pose.evaluate.score import score

    result = score(truth, predicted, topic or SKELETON_TOPIC)
    if as_json:
        _print_json(result)
    else:
        _print_score(result)
    if plot:
        from depth_pose.evaluate.joint_error_plot import save_joint_errors

        save_joint_errors(result, plot, truth.stem)


def _evaluate_2d(
    reference: Path,
    predicted: Path,
    recording: Path | None,
    topic: str,
    depth_topic: str | None,
    as_json: bool,
) -> None:
    from depth_pose.evaluate.score2d import score_2d

    if recording is None:
        raise typer.BadParameter("a .json of pixels needs the depth recording too: --recording FILE")
    result = score_2d(recording, predicted, reference, topic, depth_topic)
    if as_json:
        _print_json(result)
        return
    worst = min(result.per_joint.items(), key=lambda item: item[1])
    print_facts(
        f"{predicted} against {reference}",
        [
            ("frames answered", f"{result.answered} of {result.frames}"),
            ("visible joints", str(result.joints)),
            ("within 0.10 of the height", f"{result.within_10:.1%}"),
            ("within 0.05 of the height", f"{result.within_05:.1%}"),
            ("median distance", f"{result.median:.3f} of the height"),
            ("worst joint", f"{worst[0]}, {worst[1]:.1%} within 0.10"),
        ],
    )


def _evaluate_people(truth: Path, predicted: Path, topic: str, as_json: bool) -> None:
    from depth_pose.evaluate.score_people import score_people

    scores = score_people(truth, predicted, topic)
    if as_json:
        _print_json(scores)
        return
    counts = ("frames", "asked", "recall", "preci-\nsion", "false", "swit-\nches", "IDF1")
    table = _table("people", "sequence", (*counts, "mean\nmm", "PCK\n10 cm"))
    for name, s in [*scores.sequences.items(), ("all", scores.total)]:
        found = (str(s.frames), str(s.asked), _share(s.recall), _share(s.precision), str(s.false))
        table.add_row(name, *found, str(s.switches), _share(s.idf1), _mm(s.mean_error_mm), _share(s.pck10))
    console.print(table)


def _table(title: str, first: str, columns: Iterable[str]) -> Table:
    """Build a table of numbers of at most 80 columns; long names wrap."""
    from rich import box
    from rich.table import Table

    table = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD)
    table.padding, table.pad_edge = (0, 1, 0, 0), False
    table.add_column(first, overflow="fold")
    for name in columns:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def _share(value: float) -> str:
    return "-" if value != value else f"{value:.3f}"


def _print_json(result: Any) -> None:
    from dataclasses import asdict

    def finite(value: Any) -> Any:
        if isinstance(value, dict):
            return {str(k): finite(v) for k, v in value.items()}
        if isinstance(value, (list, tuple)):
            return [finite(v) for v in value]
        return None if isinstance(value, float) and value != value else value

    typer.echo(json.dumps(finite(asdict(result)), indent=2))


def _print_score(score: Score) -> None:
    columns = ("frames", "coverage", "mean mm", "median mm", "95 % mm", "PCK 10 cm")
    sequences = _table("sequences", "sequence", columns)
    for name, s in score.sequences.items():
        values = (
            f"{s.coverage:.3f}",
            _mm(s.mean_error_mm),
            _mm(s.median_mm),
            _mm(s.p95_mm),
            f"{s.pck10:.3f}",
        )
        sequences.add_row(name, str(s.frames), *values)
    joints = _table("joints", "joint", ("mean mm", "offset-free mm", "PCK 10 cm"))
    for name, j in score.joints.items():
        joints.add_row(name, _mm(j.mean_error_mm), _mm(j.offset_free_mm), f"{j.pck10:.3f}")
    thresholds = [f"{threshold * 100:.0f} cm" for threshold in score.pck]
    shares = _table("PCK: share of joints", "within", thresholds)
    shares.add_row("share", *(f"{share:.3f}" for share in score.pck.values()))
    for table in (sequences, joints, shares):
        console.print(table)
    print_facts(
        "all",
        [
            ("frames", f"{score.frames}, of which answered {score.coverage:.1%}"),
            ("mean error", f"{_mm(score.mean_error_mm)} mm"),
            ("mean of the sequences", f"{_mm(score.per_sequence_mean_mm)} mm"),
            ("offset-free", f"{_mm(score.offset_free_mm)} mm"),
            ("of joints that are", f"seen {_mm(score.seen_mm)} mm, hidden {_mm(score.hidden_mm)} mm"),
            ("PCK 10 cm", f"{score.pck10:.4f}"),
        ],
    )


def _mm(value: float) -> str:
    return "-" if value != value else f"{value:.1f}"


def overlay(
    recording: Annotated[Path, typer.Argument(help="Depth recording, in any format that `run` reads.")],
    skeletons: Annotated[Path, typer.Argument(help="Recording of its skeletons.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The picture: PNG, or animated GIF.")],
    frames: Annotated[int, typer.Option(min=1, max=60, help="Number of frames in a PNG.")] = 6,
    seconds: Annotated[float, typer.Option(min=0.1, max=60, help="Length of a GIF, seconds.")] = 6.0,
    truth: Annotated[Path | None, typer.Option(help="Truth file (.npz) to draw as well.")] = None,
    depth_topic: shared.DepthTopic = None,
    topic: shared.SkeletonsTopic = PEOPLE_TOPIC,
    rig: shared.RigFile = None,
    camera: shared.RigCameraName = None,
) -> None:
    """Draw skeletons over depth images, as a picture or an animation.

    The title of a frame shows its time, the skeleton's source and confidence, and with --truth the mean
    error. Skeletons in a room's frame (`run --rig`) are drawn into the images of one of its cameras, with
    --rig.

    [bold]Examples:[/bold]

    depth-pose overlay in.mcap out.mcap -o picture.png

    depth-pose overlay sim.mcap out.mcap -o look.png --truth sim.npz --frames 12

    depth-pose overlay in.mcap out.mcap -o moving.gif --seconds 4

    depth-pose overlay B.mcap room.mcap -o seen_by_b.png --rig rig.yaml --camera B
    """
    placed = shared.placed_camera(rig, camera, recording)
    by = "" if placed is None else f", as {placed.camera.name} sees it"
    if output.suffix.lower() == ".gif":
        if truth is not None:
            raise typer.BadParameter("--truth is for a PNG; a GIF shows the skeletons only")
        from depth_pose.core.outputs import check_targets
        from depth_pose.evaluate.animation import save_animation

        check_targets([output], [recording, skeletons, rig])
        save_animation(
            *(recording, skeletons, output, seconds),
            depth_topic=depth_topic,
            skeleton_topic=topic,
            camera=placed,
        )
        say(f"wrote {output}{by}")
        return
    from depth_pose.evaluate.overlay import save_overlay
    from depth_pose.evaluate.pictures import check_picture

    check_picture(output, [recording, skeletons, truth, rig])
    save_overlay(
        *(recording, skeletons, output, frames, truth),
        depth_topic=depth_topic,
        skeleton_topic=topic,
        camera=placed,
    )
    say(f"wrote {output}{by}")
