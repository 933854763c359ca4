"""``depth-pose simulate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from depth_pose.cli.console import given, print_facts, progress_bar, setting
from depth_pose.sim.config import Person, Placement, Room

_PERSON, _CAMERA = "The person", "The camera and the room"


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(simulate)


def simulate(
    output: Annotated[Path, typer.Option("--output", "-o", help="The recording; the truth goes beside it.")],
    motion: Annotated[
        str, typer.Option(help="A motion's name (a wrong one lists them), or a BVH file.")
    ] = "play",
    sensor: Annotated[str, typer.Option(help="tof or structured.")] = "tof",
    width: Annotated[
        int | None, typer.Option(min=64, max=4096, help="Width of the images in pixels; the sensor's own.")
    ] = None,
    seconds: Annotated[float, typer.Option(min=0.04, max=3600.0, help="Length.")] = 10.0,
    seed: Annotated[int, typer.Option(min=0, help="Of motion and noise.")] = 0,
    stature: Annotated[float | None, setting(Person, "stature")] = None,
    girth: Annotated[float | None, setting(Person, "girth")] = None,
    shoulder_width: Annotated[float | None, setting(Person, "shoulder_width")] = None,
    hip_width: Annotated[float | None, setting(Person, "hip_width")] = None,
    leg_length: Annotated[float | None, setting(Person, "leg_length")] = None,
    arm_length: Annotated[float | None, setting(Person, "arm_length")] = None,
    trunk_length: Annotated[float | None, setting(Person, "trunk_length")] = None,
    head_size: Annotated[float | None, setting(Person, "head_size")] = None,
    distance: Annotated[float | None, setting(Placement, "distance")] = None,
    height: Annotated[float | None, setting(Placement, "height")] = None,
    azimuth: Annotated[float | None, setting(Placement, "azimuth")] = None,
    pitch: Annotated[float | None, setting(Placement, "pitch")] = None,
    roll: Annotated[float | None, setting(Placement, "roll")] = None,
    floor: Annotated[bool | None, setting(Room, "floor", "--floor/--no-floor")] = None,
    wall: Annotated[float | None, setting(Room, "wall")] = None,
) -> None:
    """Record a virtual depth sensor that watches a moving person, with the joints known.

    Writes NAME.mcap (depth images and their camera) and NAME.npz (the joints).

    [bold]Examples:[/bold]

    depth-pose simulate -o bags/sim.mcap

    depth-pose simulate -o kick.mcap --motion kick --sensor structured --azimuth 40 --pitch 12 --height 1.6

    depth-pose simulate -o kinect.mcap --sensor structured --width 320

    depth-pose simulate -o child.mcap --motion wave --stature 1.2 --head-size 1.25 --seed 3
    """
    from depth_pose.core.errors import ConfigError
    from depth_pose.sim.motion import load_motion
    from depth_pose.sim.sensor import SENSORS
    from depth_pose.sim.simulate import Stage
    from depth_pose.sim.simulate import simulate as record

    if sensor not in SENSORS:
        raise ConfigError(f"there is no sensor {sensor!r}; it is one of {', '.join(SENSORS)}")
    person = Person(
        **given(
            stature=stature,
            girth=girth,
            shoulder_width=shoulder_width,
            hip_width=hip_width,
            leg_length=leg_length,
            arm_length=arm_length,
            trunk_length=trunk_length,
            head_size=head_size,
        )
    )
    placement = Placement(**given(distance=distance, height=height, azimuth=azimuth, pitch=pitch, roll=roll))
    model = SENSORS[sensor] if width is None else SENSORS[sensor].with_width(width)
    stage = Stage(model, placement, Room(**given(floor=floor, wall=wall)))
    clip = load_motion(motion, stage.sensor.fps, seconds, seed)
    with progress_bar(f"{sensor} sensor, {motion}", len(clip)) as update:
        truth = record(output, person.body(), clip, stage, seed, lambda done, _: update(done))
    camera = stage.sensor.camera
    print_facts(
        str(output),
        [
            ("motion", clip.name),
            ("frames", f"{len(truth.stamps_ns)} at {stage.sensor.fps:g} per second"),
            ("images", f"{camera.width} x {camera.height}"),
            ("joints seen", f"{truth.seen.mean():.1%}"),
            ("truth", str(output.with_suffix(".npz"))),
        ],
    )
