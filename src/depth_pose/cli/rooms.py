"""``depth-pose calibrate``."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from depth_pose.cli import shared
from depth_pose.cli.console import console, loading, print_facts, progress_bar, say, warn
from depth_pose.cli.live import call_ros
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.outputs import check_targets

if TYPE_CHECKING:
    from depth_pose.rooms.calibration_record import Recorded, RecordSetting
    from depth_pose.rooms.calibration_result import Calibration

_MOST_OFFSET_S = 0.02
"""Clock offset (s) above which a warning is printed: more than live fusion tolerates."""


_LIVE_S = 60.0
"""Length of a recording with ``--live`` (s)."""


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(calibrate)


def calibrate(
    recordings: Annotated[
        list[Path],
        typer.Argument(
            help="Depth recordings of the same time, one per camera; with --live: topics of depth images.",
            metavar="A B...",
            show_default=False,
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="The rig file, YAML.", metavar="RIG")],
    picture: Annotated[
        Path | None,
        typer.Option(help="Picture of the room from above.", show_default="RIG with .png", metavar="FILE"),
    ] = None,
    bank: shared.BankFile = None,
    depth_topic: shared.DepthTopic = None,
    seconds: Annotated[
        float | None,
        typer.Option(
            min=5,
            max=3600,
            help="Use only the first seconds; with --live: record for this long.",
            show_default=f"all; {_LIVE_S:.0f} with --live",
        ),
    ] = None,
    live: Annotated[bool, typer.Option("--live", help="A B... are topics: record them first.")] = False,
    workers: Annotated[
        int | None,
        typer.Option(min=0, help="Number of processes; 0: only this one.", show_default="all cores"),
    ] = None,
) -> None:
    """Calibrate several cameras in one room from people who walk about in it.

    No target or measurement is needed: record all cameras at the same time for 20 s to a minute while one
    or more people walk to and fro and across the whole common view. Their skeletons and the floor give
    the first estimate; the surfaces of the empty room that two cameras see refine it. Clocks may differ
    by half a second. Transforms between the cameras on /tf_static are used as they are.

    The rig file holds each camera's pose in the room frame (z up, floor at z = 0, origin below the first
    camera, x along its view) and its clock offset; run --rig and volume run read it.

    [bold]Examples:[/bold]

    depth-pose calibrate left.mcap right.mcap -o rig.yaml

    depth-pose calibrate door.mcap window.mcap -o rig.yaml --picture room.pdf

    depth-pose calibrate --live /left/image_raw /right/image_raw -o rig.yaml
    """
    from depth_pose.evaluate.pictures import check_picture

    drawn = picture or output.with_suffix(".png")
    if output.suffix.lower() not in (".yaml", ".yml"):
        raise ConfigError(f"{output} must be a rig file: its name ends in .yaml")
    if len(recordings) < 2:
        raise ConfigError("give the recordings of at least two cameras")
    check_targets([output], [bank] if live else [*recordings, bank])
    check_picture(drawn, [] if live else recordings)

    from depth_pose.bank import default_bank_path
    from depth_pose.evaluate.room_picture import save_room_picture
    from depth_pose.rooms.calibration import RoomCalibration
    from depth_pose.rooms.calibration_record import RecordSetting
    from depth_pose.rooms.rigfile import save_rig
    from depth_pose.rooms.transform_tree import TransformTree, pose_matrix

    setting = RecordSetting(str(bank or default_bank_path()), depth_topic, seconds)
    if live:
        if depth_topic is not None:
            raise ConfigError("--depth-topic is for recordings; with --live the arguments are topics")
        found = read_live([str(topic) for topic in recordings], setting, workers)
    else:
        names = camera_names([path.resolve().stem for path in recordings])
        found = read_all(recordings, names, [setting] * len(recordings), workers)
    tree = TransformTree()
    for one in found:
        warn(one.warnings)
        for t in one.transforms:
            tree.add(t.parent, t.child, pose_matrix(t.pose))
    with loading("the calibration"):
        calibration = RoomCalibration([one.record for one in found], tree).solve()
    rig = calibration.rig
    save_rig(output, rig.cameras, rig.topics, rig.up, rig.clock_offsets, rig.frame_ids)
    save_room_picture(calibration, drawn)
    _print_result(calibration, output)
    say(f"wrote {output} and {drawn}")


def camera_names(stems: Sequence[str]) -> list[str]:
    """Return a name for each camera: its stem; with a number where two are alike."""
    counts, names = Counter(stems), list[str]()
    for stem in stems:
        number, name = 1, stem
        while name in names or (counts[stem] > 1 and name == stem):
            name, number = f"{stem}_{number}", number + 1
        names.append(name)
    return names


def read_live(topics: Sequence[str], setting: RecordSetting, workers: int | None) -> list[Recorded]:
    """Record depth topics with their cameras, and read what was recorded."""
    seconds = setting.seconds or _LIVE_S
    infos = [f"{topic.rpartition('/')[0]}/camera_info" for topic in topics]
    with tempfile.TemporaryDirectory(prefix="depth_pose_") as folder:
        bag = Path(folder) / "live.mcap"
        console.print(f"recording {seconds:g} s: let people walk about in the view of all cameras")
        counts = call_ros("tools.bag", "record", bag, [*topics, *infos, "/tf_static"], seconds=seconds)
        silent = [topic for topic in (*topics, *infos) if not counts[topic]]
        if silent:
            raise InputError(
                f"nothing came on {', '.join(silent)}: start the cameras' drivers; `ros2 topic list` or "
                "`depth-pose up` lists the available topics"
            )
        names = camera_names([topic.strip("/").partition("/")[0] for topic in topics])
        settings = [replace(setting, depth_topic=topic, seconds=None) for topic in topics]
        return read_all([bag] * len(topics), names, settings, workers)


def read_all(
    recordings: Sequence[Path], names: Sequence[str], settings: Sequence[RecordSetting], workers: int | None
) -> list[Recorded]:
    """Read all recordings, one process each, with a progress bar."""
    from depth_pose.core.workers import run_each
    from depth_pose.rooms.calibration_record import read_record

    tasks = [(str(path), *how) for path, *how in zip(recordings, names, settings, strict=True)]
    shares = [0.0] * len(tasks)
    found: dict[int, Recorded] = {}
    with progress_bar("people and room", 100 * len(tasks)) as update:

        def listen(index: int, share: float) -> None:
            shares[index] = share
            update(round(100 * sum(shares)))

        with closing(run_each(read_record, tasks, workers, listen=listen)) as outcomes:
            for outcome in outcomes:
                if outcome.error is not None:
                    raise outcome.error
                assert outcome.value is not None
                found[outcome.index] = outcome.value
                listen(outcome.index, 1.0)
    return [found[index] for index in range(len(tasks))]


def _print_result(calibration: Calibration, output: Path) -> None:
    facts = []
    for c, record in enumerate(calibration.records):
        x, y, z = calibration.T_room_camera[c, :3, 3]
        place = f"at {x:.2f}, {y:.2f}, {z:.2f} m"
        if c:
            place += (
                f", off by about {1e3 * calibration.deviation_m[c]:.0f} mm and "
                f"{calibration.deviation_deg[c]:.2f} degrees; clock {1e3 * calibration.offsets[c]:+.0f} ms"
            )
        facts.append((record.name, place))
    for pair in calibration.pairs:
        text = (
            f"people for {pair.seconds:.0f} s, {pair.overlap:.0%} of their time; {pair.points} points of the "
            f"empty room; from {pair.source}"
        )
        facts.append((f"{pair.first} and {pair.second}", text))
    facts.append(("joints seen by two", f"{1e3 * calibration.residual:.0f} mm apart, median"))
    print_facts(str(output), facts)
    warn(
        f"the clock of {record.name} is {1e3 * offset:+.0f} ms off that of {calibration.records[0].name}; "
        "the rig file corrects it for these recordings. For live use let the hosts synchronise (NTP, PTP)"
        for record, offset in zip(calibration.records, calibration.offsets, strict=True)
        if abs(offset) > _MOST_OFFSET_S
    )
