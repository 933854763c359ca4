"""``depth-pose volume``: pose from a person's volume, for loose clothing."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from depth_pose.cli import STOPPED
from depth_pose.cli.console import (
    check_ending,
    console,
    given,
    loading,
    print_facts,
    progress_bar,
    setting,
    tell_stopped,
)
from depth_pose.cli.damage import warn_of
from depth_pose.core.errors import ConfigError
from depth_pose.core.outputs import check_targets
from depth_pose.core.settings_file import read_settings
from depth_pose.volume.config import LearnConfig, SpaceConfig, TrackConfig, ViewsConfig, VolumeConfig

if TYPE_CHECKING:
    from collections.abc import Sequence

    from depth_pose.motion.clip import Clip
    from depth_pose.volume.learn.performances import Performance
    from depth_pose.volume.model import VolumeModel

app = typer.Typer(
    help="Pose from a person's volume: silhouettes of several cameras, or depth of one or more.",
    no_args_is_help=True,
)

_FPS = 30.0
"""Frames a second at which motions are made or read."""

Params = Annotated[
    Path | None,
    typer.Option(help="Settings by section, YAML or JSON, or a ROS parameter file.", metavar="FILE"),
]


def _settings(params: Path | None, **chosen: dict[str, Any]) -> VolumeConfig:
    """Return the settings of a file, overridden by those of the command line."""
    values = read_settings(params, VolumeConfig) if params else {}
    for section, options in chosen.items():
        values[section] = values.get(section, {}) | options
    return VolumeConfig.from_mapping(values)


def _learn(
    clips: Sequence[Clip],
    about: str,
    kind: str,
    config: VolumeConfig,
    garments: Sequence[str] = (),
    every: int | None = None,
    rig: Path | None = None,
) -> VolumeModel:
    from depth_pose.rooms.rigfile import load_rig
    from depth_pose.volume.learn.learning import learn_model
    from depth_pose.volume.learn.training import EVERY, default_wearers, simulate_views

    bars: dict[str, float] = {}
    with console.status("") as status:

        def tell(what: str, done: int, of: int) -> None:
            bars.setdefault(what, time.monotonic())
            status.update(f"{what}: {done} of {of}, {time.monotonic() - bars[what]:.0f} s")

        views = simulate_views(
            clips,
            default_wearers(*([garments] if garments else [])),
            kind,
            every or EVERY,
            config.space,
            load_rig(rig).cameras if rig else None,
            lambda done, of: tell("simulated frames", done, of),
        )
        return learn_model(views, config.learn, tell, about)


def _captured(path: Path) -> Clip:
    from depth_pose.sim.motion import load_motion

    if path.suffix.lower() != ".bvh":
        raise ConfigError(f"{path} is not a .bvh file")
    return load_motion(str(path), _FPS, 1e6)


def _print_model(path: Path, model: VolumeModel) -> None:
    meta = model.meta
    print_facts(
        str(path),
        [
            ("sees", str(meta["input"]) + (f", {model.views} views" if model.views > 1 else "")),
            ("trained on", str(meta["about"])),
            ("frames", f"{meta['frames']} of {len(meta['performances'])} performances"),
            ("wearers", f"{meta['wearers']}, {', '.join(f'{s:g} m' for s in meta['statures'])}"),
            ("latent dimensions", str(model.latent.shape[1])),
            ("pose dimensions", str(model.pose_basis.shape[1])),
        ],
    )


@app.command()
def train(
    output: Annotated[Path, typer.Option("--output", "-o", help="The model file.")],
    dance: Annotated[str, typer.Option(help="A procedural dance: swing or sweep.")] = "swing",
    motion: Annotated[
        list[Path] | None, typer.Option(help="BVH files instead of a dance; may be repeated.")
    ] = None,
    kind: Annotated[
        str,
        typer.Option("--input", help="silhouettes of cameras all around, or depth of one or more cameras."),
    ] = "silhouettes",
    garment: Annotated[
        list[str] | None,
        typer.Option(
            help="Garment of the wearers (none, skirt, long-skirt, wide-skirt, robe); may be repeated.",
            show_default="skirt, long-skirt, wide-skirt, none",
        ),
    ] = None,
    performances: Annotated[
        int | None, typer.Option(min=1, max=100, help="Performances of the dance.", show_default="10")
    ] = None,
    every: Annotated[
        int | None, typer.Option(min=1, max=100, help="Take every Nth frame.", show_default="10")
    ] = None,
    rig: Annotated[
        Path | None,
        typer.Option(
            help="Cameras to train for (rig file). For depth cameras only their mean height and distance "
            "are used: one model serves any number of cameras, at any pose.",
            show_default="8 under the roof, or a depth camera at 1.3 m",
        ),
    ] = None,
    iterations: Annotated[int | None, setting(LearnConfig, "iterations")] = None,
    latent: Annotated[int | None, setting(LearnConfig, "latent")] = None,
    voxel: Annotated[float | None, setting(SpaceConfig, "voxel")] = None,
    params: Params = None,
    plot: Annotated[
        Path | None, typer.Option(help="Draw the latent space with its variance.", metavar="PNG")
    ] = None,
) -> None:
    """Learn a motion by simulation, as volumes of people in several garments and their poses.

    [bold]Examples:[/bold]

    depth-pose volume train -o swing.npz

    depth-pose volume train --motion a.bvh --motion b.bvh --garment robe -o r.npz

    depth-pose volume train --input depth -o one_camera.npz
    """
    from depth_pose.evaluate.pictures import check_picture
    from depth_pose.volume.learn.training import PERFORMANCES, dance_clips

    check_targets([output, plot], [*(motion or []), rig, params])
    check_ending(output, ".npz", "a model")
    check_picture(plot)
    start = time.monotonic()
    config = _settings(params, learn=given(iterations=iterations, latent=latent), space=given(voxel=voxel))
    clips = [_captured(path) for path in motion or []] or dance_clips(dance, performances or PERFORMANCES)
    about = "motions from files" if motion else f"dance {dance}"
    model = _learn(clips, about, kind, config, garment or (), every, rig)
    model.save(output)
    _print_model(output, model)
    console.print(f"made in {time.monotonic() - start:.0f} s", style="dim", highlight=False)
    if plot is not None:
        from depth_pose.volume.learn.plots import save_latent

        save_latent(model, [], plot, ["latent space"])


@app.command()
def info(file: Annotated[Path, typer.Argument(help="The model file.")]) -> None:
    """Print what a model was trained on.

    [bold]Example:[/bold]

    depth-pose volume info swing.npz
    """
    from depth_pose.volume.model import VolumeModel

    _print_model(file, VolumeModel.load(file))


@app.command()
def run(
    recording: Annotated[Path, typer.Argument(help="Recording of silhouettes or depth images.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The recording of skeletons.")],
    model: Annotated[Path, typer.Option("--model", "-m", help="The model file.")],
    rig: Annotated[Path, typer.Option("--rig", help="Cameras, their calibration and topics.")],
    voxel: Annotated[float | None, setting(SpaceConfig, "voxel")] = None,
    particles: Annotated[int | None, setting(TrackConfig, "particles")] = None,
    likelihood: Annotated[str | None, setting(TrackConfig, "likelihood")] = None,
    stature: Annotated[float | None, setting(TrackConfig, "stature")] = None,
    refine: Annotated[bool | None, setting(TrackConfig, "refine", "--refine/--no-refine")] = None,
    depth_scale: Annotated[float | None, setting(ViewsConfig, "depth_scale")] = None,
    cut_out: Annotated[bool | None, setting(ViewsConfig, "cut_out", "--cut-out/--no-cut-out")] = None,
    params: Params = None,
) -> None:
    """Find the skeleton in every set of views of a recording.

    Images of one time carry (nearly) the same stamp; if a camera misses one, the others are used. The
    same recording gives the same file, byte for byte.

    [bold]Example:[/bold]

    depth-pose volume run dance.mcap --rig rig.yaml --model swing.npz -o out.mcap
    """
    from depth_pose.io.mcap_write import PartlyWritten
    from depth_pose.offline import process_recording
    from depth_pose.rooms.rigfile import load_rig
    from depth_pose.volume.model import VolumeModel
    from depth_pose.volume.pipeline import VolumePipeline
    from depth_pose.volume.recordings import ViewReader

    check_targets([output], [recording, model, rig, params])
    check_ending(output, ".mcap", "a recording")
    config = _settings(
        params, space=given(voxel=voxel), views=given(cut_out=cut_out, depth_scale=depth_scale),
        track=given(particles=particles, likelihood=likelihood, stature=stature, refine=refine),
    )  # fmt: skip
    learned, cameras = VolumeModel.load(model), load_rig(rig)
    reader = ViewReader(recording, cameras, learned.meta["input"], config.views)
    with loading("the model"):
        pipeline = VolumePipeline(learned, cameras, config)
        pipeline.warm_up()
    try:
        with progress_bar(recording.name, None) as update:
            summary = process_recording(reader, output, pipeline, update)
    except PartlyWritten as stopped:
        tell_stopped(stopped)
        raise typer.Exit(STOPPED) from None
    warn_of(summary.warnings, reader.damage)
    print_facts(
        f"{recording} -> {output}",
        [
            ("frames", str(summary.frames)),
            ("answered", str(summary.answered)),
            ("without one of the cameras", str(reader.incomplete)),
            ("time per frame", f"{summary.median_ms:.1f} ms (95 % below {summary.p95_ms:.1f} ms)"),
        ],
    )


@app.command()
def live(
    model: Annotated[Path | None, typer.Option("--model", "-m", help="The model file.")] = None,
    rig: Annotated[Path | None, typer.Option(help="Cameras, their calibration and topics.")] = None,
    params: Annotated[
        Path | None, typer.Option(help="ROS parameter file (key /**:).", metavar="FILE")
    ] = None,
    voxel: Annotated[float | None, setting(SpaceConfig, "voxel")] = None,
    particles: Annotated[int | None, setting(TrackConfig, "particles")] = None,
    stature: Annotated[float | None, setting(TrackConfig, "stature")] = None,
    refine: Annotated[bool | None, setting(TrackConfig, "refine", "--refine/--no-refine")] = None,
    sim_time: Annotated[bool, typer.Option("--sim-time", help="Take the time from /clock.")] = False,
) -> None:
    """Run the volume node: the cameras' topics in, skeletons on /depth_pose/skeleton out.

    `depth-pose pause --node volume` pauses it.

    [bold]Examples:[/bold]

    depth-pose volume live --model swing.npz --rig rig.yaml

    depth-pose volume live --params my_cameras.yaml
    """
    from depth_pose.cli.live import call_ros

    settings: dict[str, Any] = {f"space.{name}": value for name, value in given(voxel=voxel).items()}
    chosen = given(particles=particles, stature=stature, refine=refine)
    settings |= {f"track.{name}": value for name, value in chosen.items()}
    settings |= {name: path.absolute() for name, path in given(model=model, rig=rig).items()}
    if sim_time:
        settings["use_sim_time"] = True
    arguments = ["--ros-args"]
    if params is not None:
        arguments += ["--params-file", str(params)]
    for name, value in settings.items():
        arguments += ["-p", f"{name}:={str(value).lower() if isinstance(value, bool) else value}"]
    raise typer.Exit(call_ros("nodes.volume_node", "main", arguments))


@app.command()
def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="The picture.")] = Path("volume_demo.png"),
    model: Annotated[
        Path | None, typer.Option("--model", "-m", help="A model of the dance.", show_default="trains one")
    ] = None,
    dance: Annotated[str, typer.Option(help="A procedural dance: swing or sweep.")] = "swing",
    kind: Annotated[
        str, typer.Option("--input", help="silhouettes of roof cameras, or depth.")
    ] = "silhouettes",
    cameras: Annotated[
        int | None,
        typer.Option(min=1, max=32, help="Cameras all around.", show_default="8 silhouettes, 1 of depth"),
    ] = None,
    garment: Annotated[str, typer.Option(help="Garment of the dancer.")] = "skirt",
    seconds: Annotated[
        float, typer.Option(min=1, max=120, help="Length of the performance, seconds.")
    ] = 10.0,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of the performance; 1 to 10 are used in training.")
    ] = 21,
    record: Annotated[
        Path | None,
        typer.Option(
            help="Also write the images, and the cameras to a .yaml file beside them.", metavar="MCAP"
        ),
    ] = None,
) -> None:
    """Simulate a dancer seen by eight roof cameras, or by depth cameras, and track them.

    Prints the error beside that of the mean pose and of the best training pose.

    [bold]Examples:[/bold]

    depth-pose volume demo

    depth-pose volume demo --model depth.npz --input depth --cameras 2
    """
    from depth_pose.evaluate.pictures import check_picture
    from depth_pose.volume.learn.plots import save_report
    from depth_pose.volume.learn.report import report_rows, track_performance
    from depth_pose.volume.learn.training import dance_clips
    from depth_pose.volume.model import VolumeModel

    beside = record.with_suffix(".yaml") if record else None
    check_targets([output, record, beside], [model])
    check_picture(output)
    learned = (
        VolumeModel.load(model)
        if model
        else _learn(dance_clips(dance), f"dance {dance}", kind, VolumeConfig())
    )
    if learned.meta["input"] != kind:
        raise ConfigError(f"{model} sees {learned.meta['input']}; say --input {learned.meta['input']}")
    performance = _perform(kind, cameras, dance, garment, seconds, seed, record)
    with progress_bar("tracking", len(performance)) as update:
        report = track_performance(learned, performance, progress=update)
    save_report(report, performance, output, [round(i * (len(performance) - 1) / 6) for i in range(7)])
    head, row = report_rows([report])
    print_facts(str(output), [*zip(head, row, strict=True), ("time per frame", f"{report.ms:.1f} ms")])


def _perform(
    kind: str,
    cameras: int | None,
    dance: str,
    garment: str,
    seconds: float,
    seed: int,
    record: Path | None,
) -> Performance:
    from depth_pose.motion.procedural.dance import perform
    from depth_pose.sim.clothing import find_garment
    from depth_pose.sim.roof_cameras import depth_ring, roof_rig
    from depth_pose.sim.wearers import Wearer, record_views
    from depth_pose.volume.learn.performances import TEST_SHAPES, rig_eyes, watch

    rig = roof_rig(cameras or 8) if kind == "silhouettes" else depth_ring(cameras or 1)
    clip = perform(dance, seed, seconds, _FPS)
    wearer = Wearer(TEST_SHAPES[seed % len(TEST_SHAPES)], find_garment(garment))
    if record is not None:
        with progress_bar(record.name, len(clip)) as update:
            record_views(record, clip, wearer, rig, kind, update)
    with progress_bar("the dancer", len(clip)) as update:
        return watch(clip, wearer, rig_eyes(kind, rig), progress=update)
