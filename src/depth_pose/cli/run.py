"""``depth-pose run``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from depth_pose.cli.console import console, given, print_facts, progress_bar, read_settings, setting, warn
from depth_pose.core.config import FollowConfig, PersonalConfig, PipelineConfig, RefineConfig, SegmentConfig

if TYPE_CHECKING:
    from depth_pose.body.build_file import KnownBuild


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(run)


def run(
    recording: Annotated[Path, typer.Argument(help="MCAP recording of a depth camera, or a folder of them.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The skeletons' recording.")],
    method: Annotated[str | None, setting(RefineConfig, "method")] = None,
    bank: Annotated[Path | None, typer.Option(help="Exemplar bank.", show_default="the set-up's")] = None,
    depth_topic: Annotated[
        str | None, typer.Option(help="Depth images or point cloud.", show_default="the only one")
    ] = None,
    near: Annotated[float | None, setting(SegmentConfig, "near")] = None,
    far: Annotated[float | None, setting(SegmentConfig, "far")] = None,
    people: Annotated[int | None, setting(SegmentConfig, "most_people", "--people")] = None,
    zone: Annotated[str | None, setting(SegmentConfig, "zone")] = None,
    follow: Annotated[str | None, setting(FollowConfig, "whom", "--follow")] = None,
    build: Annotated[str | None, setting(PersonalConfig, "file", "--build")] = None,
    save_build: Annotated[
        Path | None, typer.Option(help="Write the build of whom most was seen, JSON.", metavar="FILE")
    ] = None,
    raw: Annotated[bool, typer.Option("--raw", help="Do not filter the joints over time.")] = False,
    params: Annotated[
        Path | None,
        typer.Option(help="Settings by step, YAML or JSON, or a ROS parameter file.", metavar="FILE"),
    ] = None,
) -> None:
    """Find everybody's skeleton in every depth frame of a recording.

    /depth_pose/skeletons holds everybody, /depth_pose/skeleton the one who is followed; where nobody is in
    view, the first is empty and the second has no joints. The same recording gives the same file, byte for
    byte.

    [bold]Examples:[/bold]

    depth-pose run in.mcap -o out.mcap

    depth-pose run in.mcap -o out.mcap --depth-topic /camera/aligned_depth_to_color/image_raw

    depth-pose run in.mcap -o out.mcap --near 1 --far 4.5 --method cpd --raw

    depth-pose run in.mcap -o out.mcap --people 2 --follow nearest

    depth-pose run in.mcap -o out.mcap --zone=-1:1,0.5:3.5

    depth-pose run in.mcap -o out.mcap --save-build me.json

    depth-pose run other.mcap -o out.mcap --build me.json
    """
    values = read_settings(params) if params else {}
    for section, chosen in (
        ("segment", given(near=near, far=far, most_people=people, zone=zone)),
        ("refine", given(method=method)),
        ("follow", given(whom=follow)),
        ("build", given(file=build)),
        ("smooth", {"enabled": False} if raw else {}),
    ):
        if chosen:
            values.setdefault(section, {}).update(chosen)
    config = PipelineConfig.from_mapping(values)

    from depth_pose.io.mcap_read import DepthReader

    reader = DepthReader(recording, depth_topic)

    from depth_pose.bank import Bank, default_bank_path
    from depth_pose.offline import process_recording
    from depth_pose.pipeline import PosePipeline

    with console.status("loading the bank and compiling the kernels"):
        pipeline = PosePipeline(Bank.load(bank or default_bank_path()), config)
        pipeline.warm_up()
    with progress_bar(recording.name, len(reader)) as update:
        summary = process_recording(reader, output, pipeline, update)
    warn(summary.warnings)
    if save_build is not None:
        _save_build(save_build, pipeline.refiner.builds.best_known())
    facts = [
        ("topic", reader.topic.name),
        ("frames", str(summary.frames)),
        ("answered", str(summary.answered)),
        ("nobody in view", str(summary.empty)),
        ("most people in a frame", str(summary.most_people)),
    ]
    facts += [(reason, f"{n} ignored") for reason, n in pipeline.extractor.passed_over.items() if n]
    if summary.dropped:
        facts.append(("dropped", str(summary.dropped)))
    sources = ", ".join(f"{n} {name.lower()}" for name, n in summary.sources.items())
    facts += [
        ("skeletons", sources or "none"),
        ("time per frame", f"{summary.median_ms:.1f} ms (95 % below {summary.p95_ms:.1f} ms)"),
    ]
    print_facts(f"{recording} → {output}", facts)


def _save_build(path: Path, known: KnownBuild | None) -> None:
    from depth_pose.body.build_file import save_build

    if known is None:
        warn([f"{path} is not written: nobody was seen well enough to learn their build"])
    else:
        save_build(path, known)
