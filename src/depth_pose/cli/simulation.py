"""``depth-pose simulate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from depth_pose.cli.console import check_ending, given, loading, print_facts, progress_bar, setting
from depth_pose.core.errors import ConfigError
from depth_pose.core.extras import require
from depth_pose.core.outputs import check_targets
from depth_pose.sim.config import MAX_CAMERAS, Person, Placement, Room

if TYPE_CHECKING:
    from depth_pose.sim.simulate import Stage

_ROOM_FPS = 15.0
"""Frame rate of a simulated room; that of the simulated sensors at their full range."""

_ROOM_WIDTH_PX = 320
"""Default width of a simulated room's images (pixels)."""

_CLOCK_OFFSET_S = 0.02
"""Default maximum offset of the cameras' clocks (s): hosts synchronised by NTP."""


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(simulate)


def simulate(
    output: Annotated[
        Path, typer.Option("--output", "-o", help="The recording; the truth is written beside it.")
    ],
    motion: Annotated[
        str | None,
        typer.Option(help="Name of a motion (a wrong name lists them), or a BVH file.", show_default="play"),
    ] = None,
    sensor: Annotated[
        str | None,
        typer.Option(
            help="tof, structured, kinect_v1, xtion, kinect_v2, azure_kinect, d435, d455, oak_d or zed.",
            show_default="tof; with --room a random one",
        ),
    ] = None,
    room: Annotated[
        bool, typer.Option("--room", help="Several people in a furnished room, all generated from the seed.")
    ] = False,
    home: Annotated[
        bool,
        typer.Option(
            "--home",
            help="A home, with pets, clutter, and clothes and sofas that return little depth; with --room.",
        ),
    ] = False,
    camera_moves: Annotated[
        bool, typer.Option("--camera-moves", help="The camera drives, turns and nods; with --room.")
    ] = False,
    people: Annotated[
        int | None,
        typer.Option(min=0, max=6, help="Number of people; with --room.", show_default="2"),
    ] = None,
    cameras: Annotated[
        int | None,
        typer.Option(
            min=1, max=MAX_CAMERAS, help="Number of cameras around the room; with --room.", show_default="1"
        ),
    ] = None,
    clock_offset: Annotated[
        float | None,
        typer.Option(
            min=0,
            max=10,
            help="Maximum offset of the other cameras' clocks from camera 0's, seconds; with --cameras.",
            show_default="0.02",
        ),
    ] = None,
    width: Annotated[int | None, typer.Option(min=64, max=4096, help="Image width in pixels.")] = None,
    seconds: Annotated[float, typer.Option(min=0.04, max=3600, help="Length, seconds.")] = 10.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of motion, noise and room.")] = 0,
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
    """Simulate a depth sensor that sees a moving person, or people in a room, with true joints.

    Writes NAME.mcap (depth images and their camera) and NAME.npz (the joints). With --room people of random
    builds and clothes walk about, hide and cross each other; camera, sensor and furniture are random too,
    and the same seed gives the same. --sensor chooses the sensor, --home makes the room a home, and with
    --camera-moves the joints are in the camera's frame at that moment.

    With --cameras N unlike sensors with clocks of their own stand around the room: NAME_0.mcap, NAME_1.mcap
    and so on, the true rig in NAME.yaml, and the joints in the room's frame in NAME.npz.

    [bold]Examples:[/bold]

    depth-pose simulate -o bags/sim.mcap

    depth-pose simulate -o kick.mcap --motion kick --azimuth 40 --height 1.6

    depth-pose simulate -o kinect.mcap --sensor structured --width 320

    depth-pose simulate -o child.mcap --motion wave --stature 1.2 --head-size 1.25

    depth-pose simulate -o room.mcap --room --people 3 --seed 7

    depth-pose simulate -o home.mcap --room --home --sensor oak_d --camera-moves

    depth-pose simulate -o pair.mcap --room --people 2 --cameras 2 --seconds 60
    """
    check_ending(output, ".mcap", "a recording")
    chosen = given(
        stature=stature,
        girth=girth,
        shoulder_width=shoulder_width,
        hip_width=hip_width,
        leg_length=leg_length,
        arm_length=arm_length,
        trunk_length=trunk_length,
        head_size=head_size,
    )
    placed = given(distance=distance, height=height, azimuth=azimuth, pitch=pitch, roll=roll)
    shell = given(floor=floor, wall=wall)
    if not room and people is not None:
        raise ConfigError("--people needs --room; without it there is one person")
    if not room and cameras is not None:
        raise ConfigError("--cameras needs --room; without it there is one sensor")
    if not room and (home or camera_moves):
        raise ConfigError(f"--{'home' if home else 'camera-moves'} needs --room")
    if clock_offset is not None and (cameras or 1) == 1:
        raise ConfigError("--clock-offset needs --cameras 2 or more; a single clock has no offset")
    require("open3d", "a simulated sensor")
    if room:
        unused = [*given(motion=motion), *chosen, *placed, *shell]
        if unused:
            raise ConfigError(f"--room draws all from --seed; leave out --{unused[0].replace('_', '-')}")
        shown = (2 if people is None else people, width or _ROOM_WIDTH_PX, seconds, seed)
        if sensor is not None:
            _check_sensor(sensor)
        if cameras is not None and cameras > 1:
            alone = [
                *given(sensor=sensor),
                *(["home"] if home else []),
                *(["camera_moves"] if camera_moves else []),
            ]
            if alone:
                name = alone[0].replace("_", "-")
                raise ConfigError(f"--{name} is for one camera; leave out --cameras, or --{name}")
            offset = _CLOCK_OFFSET_S if clock_offset is None else clock_offset
            _simulate_cameras(output, cameras, offset, *shown)
        else:
            check_targets([output, output.with_suffix(".npz")])
            _simulate_room(output, *shown, model=sensor, home=home, moves=camera_moves)
        return
    is_file = motion is not None and motion.lower().endswith(".bvh")
    check_targets([output, output.with_suffix(".npz")], [motion if is_file else None])
    stage = _stage(sensor or "tof", width, Placement(**placed), Room(**shell))
    _simulate_person(output, Person(**chosen), stage, motion or "play", seconds, seed)


def _check_sensor(sensor: str) -> None:
    from depth_pose.sim.sensor import SENSORS

    if sensor not in SENSORS:
        raise ConfigError(f"there is no sensor {sensor!r}; it is one of {', '.join(SENSORS)}")


def _stage(sensor: str, width: int | None, placement: Placement, room: Room) -> Stage:
    from depth_pose.sim.sensor import SENSORS
    from depth_pose.sim.simulate import Stage

    _check_sensor(sensor)
    return Stage(SENSORS[sensor] if width is None else SENSORS[sensor].with_width(width), placement, room)


def _simulate_person(
    output: Path, person: Person, stage: Stage, motion: str, seconds: float, seed: int
) -> None:
    from depth_pose.sim.motion import load_motion
    from depth_pose.sim.simulate import simulate as record

    clip = load_motion(motion, stage.sensor.fps, seconds, seed)
    with progress_bar(f"{motion} before the sensor", len(clip)) as update:
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


def _simulate_room(
    output: Path,
    people: int,
    width: int,
    seconds: float,
    seed: int,
    *,
    model: str | None,
    home: bool,
    moves: bool,
) -> None:
    import numpy as np

    from depth_pose.sim.clips import sample_clip, write_clip

    frames = max(1, round(seconds * _ROOM_FPS))
    with progress_bar("people in a room", frames) as update:
        rng = np.random.default_rng(seed)
        clip = sample_clip(rng, frames, _ROOM_FPS, people, width, update, model=model, home=home, moves=moves)
    write_clip(output, clip)
    facts = [
        ("people", str(clip.joints.shape[1])),
        ("frames", f"{frames} at {_ROOM_FPS:g} per second"),
        ("images", f"{clip.camera.width} x {clip.camera.height}"),
        ("truth", str(output.with_suffix(".npz"))),
    ]
    if clip.visible.size:
        facts.insert(1, ("visible of a person", f"{clip.visible.mean():.0%} on average"))
    print_facts(str(output), facts)


def _simulate_cameras(
    output: Path, cameras: int, clock_offset: float, people: int, width: int, seconds: float, seed: int
) -> None:
    import numpy as np

    from depth_pose.sim.room_recordings import record_show, recordings_of, sample_show

    truth, rig = output.with_suffix(".npz"), output.with_suffix(".yaml")
    recordings = recordings_of(output, cameras)
    check_targets([*recordings, truth, rig])
    with loading("people, room and cameras"):
        show = sample_show(np.random.default_rng(seed), cameras, seconds, people, width, clock_offset)
    with progress_bar("people in a room", show.frames) as update:
        visible = record_show(output, show, update)
    facts = [("people", str(len(show.cast)))]
    if show.cast:
        facts.append(("visible of a person", f"{visible:.0%} on average, to the best camera"))
    for file, c in zip(recordings, show.cameras, strict=True):
        kind = f"{c.sensor.family}, {c.view.camera.width} x {c.view.camera.height}, {c.fps:g} per second"
        clock = f"clock {1e3 * c.clock_offset:+.1f} ms {1e6 * c.clock_drift:+.1f} ppm"
        facts.append((file.name, f"{kind}, {c.view.position[1]:.2f} m high, {clock}"))
    print_facts(str(output), [*facts, ("rig", str(rig)), ("truth", str(truth))])
