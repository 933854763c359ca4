"""``depth-pose run``."""

from __future__ import annotations

import os
from glob import has_magic
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from depth_pose.cli import STOPPED, shared
from depth_pose.cli.archive_run import run_archive
from depth_pose.cli.console import (
    check_ending,
    given,
    loading,
    print_facts,
    progress_bar,
    say,
    setting,
    tell_stopped,
    warn,
)
from depth_pose.cli.damage import be_lenient, warn_of
from depth_pose.cli.live_options import LiveOptions
from depth_pose.cli.room_run import check_room_options, run_room
from depth_pose.core.config import FollowConfig, PersonalConfig, PipelineConfig, RefineConfig, SegmentConfig
from depth_pose.core.errors import ConfigError
from depth_pose.core.outputs import check_targets
from depth_pose.core.settings_file import read_settings
from depth_pose.core.threads import MOST_THREADS
from depth_pose.io.image_options import ImageOptions

if TYPE_CHECKING:
    from depth_pose.body.build_file import KnownBuild


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(run)


def run(
    recordings: Annotated[
        list[str],
        typer.Argument(
            help="Depth recordings (MCAP, .db3, ROS 1 .bag, folders of images): files, folders, "
            "patterns, folders of the parts of one recording.",
            metavar="IN",
            show_default=False,
        ),
    ],
    output: Annotated[
        str,
        typer.Option(
            "--output",
            "-o",
            help="The recording of skeletons; for several inputs or a folder of recordings, their folder. "
            "A name that ends in / is a folder.",
            metavar="OUT",
        ),
    ],
    method: Annotated[str | None, setting(RefineConfig, "method")] = None,
    bank: shared.BankFile = None,
    depth_topic: shared.DepthTopic = None,
    intrinsics: shared.Intrinsics = None,
    depth_scale: shared.DepthScale = None,
    fps: shared.Fps = None,
    near: Annotated[float | None, setting(SegmentConfig, "near")] = None,
    far: Annotated[float | None, setting(SegmentConfig, "far")] = None,
    people: Annotated[int | None, setting(SegmentConfig, "most_people", "--people")] = None,
    zone: Annotated[str | None, setting(SegmentConfig, "zone")] = None,
    speed: Annotated[str | None, setting(SegmentConfig, "speed")] = None,
    follow: Annotated[str | None, setting(FollowConfig, "whom", "--follow")] = None,
    build: Annotated[str | None, setting(PersonalConfig, "file", "--build")] = None,
    save_build: Annotated[
        Path | None, typer.Option(help="Write the build of the person seen most, JSON.", metavar="FILE")
    ] = None,
    rig: Annotated[
        Path | None,
        typer.Option(
            help="Rig file of several cameras in one room (written by calibrate): one recording per camera, "
            "in its order; all go to one file in the room's frame.",
            metavar="FILE",
        ),
    ] = None,
    markers: Annotated[
        bool, typer.Option("--markers", help="Also write standard markers, for Foxglove and RViz.")
    ] = False,
    passes: Annotated[
        int,
        typer.Option(
            min=1,
            max=2,
            help="2: process each recording a second time, backwards, with the builds learned from all of "
            "it and mirrored views of each person, and combine both answers: more accurate, twice the time.",
        ),
    ] = 1,
    raw: Annotated[bool, typer.Option("--raw", help="Do not smooth the joints.")] = False,
    params: Annotated[
        Path | None,
        typer.Option(help="Settings by step, YAML or JSON, or a ROS parameter file.", metavar="FILE"),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="For several recordings: number of processes; 0: only this one.",
            show_default="all cores",
        ),
    ] = None,
    cluster: Annotated[
        str | None,
        typer.Option(
            help="For several recordings: use the Dask cluster with this scheduler.", metavar="ADDRESS"
        ),
    ] = None,
    threads: Annotated[
        int,
        typer.Option(
            min=1,
            max=MOST_THREADS,
            help="For one recording: number of threads; with 2 the next frame's people are found meanwhile. "
            "The result is the same.",
        ),
    ] = 1,
    osc: Annotated[
        str | None,
        typer.Option(help="Also send the skeletons by OSC, as they are found.", metavar="[HOST:]PORT"),
    ] = None,
    websocket: Annotated[
        str | None,
        typer.Option(
            help="Also serve the skeletons as JSON to WebSocket clients; without HOST only on this machine.",
            metavar="[HOST:]PORT",
        ),
    ] = None,
    real_time: Annotated[
        bool, typer.Option("--real-time", help="Process the frames no sooner than a sensor would send them.")
    ] = False,
    lenient: shared.Lenient = False,
) -> None:
    """Find the skeletons of everybody in every depth frame of one recording or many.

    /depth_pose/skeletons holds everybody, /depth_pose/skeleton the followed person; when nobody is in view
    the first is empty and the second has no joints. The same recording gives the same file, byte for byte.

    A skeleton is REFINED, fitted to its frame, or RECOVERED, carried over from the frame before because the
    fit failed; its confidence is lower.

    For several recordings, a folder of recordings, or an output that is a folder, the skeletons of each go to
    FOLDER/NAME.mcap. Finished recordings are skipped, so the same command continues where it was stopped.
    FOLDER/report.csv has a line for each; the exit code is 1 if one failed, 3 if one is damaged.

    [bold]Examples:[/bold]

    depth-pose run in.mcap -o out.mcap

    depth-pose run in.mcap -o out.mcap --depth-topic /camera/depth/image_raw

    depth-pose run images/ -o out.mcap --intrinsics 525,525,319.5,239.5 --fps 30

    depth-pose run in.mcap -o out.mcap --near 1 --far 4.5 --method cpd --raw

    depth-pose run in.mcap -o out.mcap --people 2 --follow nearest

    depth-pose run in.mcap -o out.mcap --zone=-1:1,0.5:3.5

    depth-pose run in.mcap -o out.mcap --save-build me.json

    depth-pose run other.mcap -o out.mcap --build me.json

    depth-pose run in.mcap -o out.mcap --passes 2

    depth-pose run in.mcap -o out.mcap --speed high

    depth-pose run in.mcap -o out.mcap --markers

    depth-pose run in.mcap -o out.mcap --real-time --osc pc:9000 --websocket 8765

    depth-pose run --rig rig.yaml left.mcap right.mcap -o room.mcap

    depth-pose run recordings/ -o skeletons/ --workers 8

    depth-pose run https://lab.example/ward/ -o skeletons/

    depth-pose run 'ward/**/*.mcap' -o skeletons/ --cluster tcp://head:8786
    """
    be_lenient(lenient)
    values = read_settings(params) if params else {}
    for section, chosen in (
        ("segment", given(near=near, far=far, most_people=people, zone=zone, speed=speed)),
        ("refine", given(method=method)),
        ("follow", given(whom=follow)),
        ("build", given(file=build)),
        ("smooth", {"enabled": False} if raw else {}),
    ):
        if chosen:
            values.setdefault(section, {}).update(chosen)
    if passes > 1:
        values.setdefault("segment", {}).setdefault("mirror", True)
    config = PipelineConfig.from_mapping(values)
    images = ImageOptions.parse(intrinsics, depth_scale, fps)
    target = Path(output)
    live = LiveOptions.parse(osc, websocket, real_time)
    if live.is_used and (rig is not None or passes > 1):
        raise ConfigError(f"{live.flags} cannot be combined with {'--rig' if rig else '--passes 2'}")
    if rig is not None:
        check_room_options(
            save_build=save_build,
            cluster=cluster,
            passes=passes if passes > 1 else None,
            threads=threads if threads > 1 else None,
        )
        run_room(
            [Path(r) for r in recordings], rig, target, bank, depth_topic, images, config, workers, markers
        )
    elif not output.endswith(("/", os.sep)) and _is_one(recordings, target):
        if cluster is not None:
            raise ConfigError(
                "--cluster is for several recordings; for one, let -o be a folder (its name ends in /)"
            )
        check_targets([target, save_build], [recordings[0], bank, params, config.build.file or None])
        check_ending(target, ".mcap", "a recording (depth-pose export makes other files of it) or end in /")
        check_ending(save_build, ".json", "a build")
        _run_one(
            Path(recordings[0]),
            target,
            bank,
            depth_topic,
            images,
            config,
            save_build,
            markers,
            passes,
            threads,
            live,
        )
    else:
        if threads > 1:
            raise ConfigError(
                "--threads is for one recording that goes to one file; several have --workers processes"
            )
        if live.is_used:
            raise ConfigError(f"{live.flags}: only for one recording that goes to one file")
        if markers:
            raise ConfigError("--markers is for one recording that goes to one file")
        if save_build is not None:
            raise ConfigError("--save-build is for one recording that goes to one file")
        if config.build.file:
            values["build"]["file"] = str(Path(config.build.file).resolve())
            config = PipelineConfig.from_mapping(values)
        run_archive(recordings, target, bank, depth_topic, images, config, workers, cluster, passes)


def _is_one(recordings: list[str], output: Path) -> bool:
    """Whether one recording goes to one file."""
    from depth_pose.archive.inputs import is_one_recording
    from depth_pose.archive.remote import is_remote

    if len(recordings) > 1 or output.is_dir() or is_remote(recordings[0]):
        return False
    path = Path(recordings[0])
    if not path.exists():
        return not has_magic(recordings[0])
    return is_one_recording(path)


def _run_one(
    recording: Path,
    output: Path,
    bank: Path | None,
    depth_topic: str | None,
    images: ImageOptions,
    config: PipelineConfig,
    save_build: Path | None,
    markers: bool,
    passes: int,
    threads: int,
    live: LiveOptions,
) -> None:
    """Run one recording to one file."""
    from depth_pose.io.mcap_read import DepthReader
    from depth_pose.io.mcap_write import PartlyWritten

    reader = DepthReader(recording, depth_topic, images, tell=False)

    from depth_pose.bank import Bank, default_bank_path
    from depth_pose.offline import Paced, process_recording
    from depth_pose.passes import SecondPass
    from depth_pose.pipeline import PosePipeline

    bank = bank or default_bank_path()
    with loading("the bank"):
        # frames that come at their time are not read ahead: their people are fitted in threads instead
        pipeline = PosePipeline(Bank.load(bank), config, threads=threads if live.real_time else 1)
        pipeline.warm_up()
    try:
        with live.sending() as tell, progress_bar(recording.name, passes * len(reader)) as update:
            second = SecondPass(pipeline) if passes > 1 else None
            frames = Paced(reader) if live.real_time else reader
            summary = process_recording(
                frames,
                output,
                pipeline,
                update,
                markers=markers,
                second=second,
                tell=tell,
                is_ahead=threads > 1 and not live.real_time,
            )
    except PartlyWritten as stopped:
        tell_stopped(stopped)
        raise typer.Exit(STOPPED) from None
    warn_of(summary.warnings, reader.damage)
    if save_build is not None:
        _save_build(save_build, pipeline.refiner.builds.best_known())
    facts = [
        ("topic", reader.topic.name),
        ("frames", str(summary.frames)),
        ("answered", str(summary.answered)),
        ("nobody in view", str(summary.empty - pipeline.unanswered)),
        ("most people in a frame", str(summary.most_people)),
    ]
    if pipeline.unanswered:
        facts.append(("found, not answered", f"{pipeline.unanswered} frames: no plausible pose"))
    if pipeline.recoverer.doubtful:
        facts.append(("found, pose doubtful", f"{pipeline.recoverer.doubtful} detections that no body fits"))
    facts += [(reason, f"{n} ignored") for reason, n in pipeline.perception.rejected_counts.items() if n]
    if summary.dropped:
        facts.append(("dropped", str(summary.dropped)))
    if summary.gain is not None:
        facts.append(("second pass", str(summary.gain)))
    sources = ", ".join(f"{n} {name.lower()}" for name, n in summary.sources.items())
    facts += [
        ("skeletons", sources or "none"),
        ("time per frame", f"{summary.median_ms:.1f} ms (95 % below {summary.p95_ms:.1f} ms)"),
    ]
    print_facts(f"{recording} -> {output}", facts)


def _save_build(path: Path, known: KnownBuild | None) -> None:
    from depth_pose.body.build_file import save_build

    if known is None:
        warn([f"{path} is not written: nobody was seen well enough to estimate a build"])
    else:
        save_build(path, known)
        say(f"wrote {path}")
