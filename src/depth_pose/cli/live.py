"""The commands that need ROS 2: ``depth-pose up``, ``pause``, ``resume``, ``play``, ``record``, ``demo``."""

from __future__ import annotations

import importlib
import math
import os
from pathlib import Path
from typing import Annotated, Any

import typer

from depth_pose.cli import shared
from depth_pose.cli.console import check_ending, console, print_facts, say, setting, warn
from depth_pose.cli.damage import be_lenient
from depth_pose.core.config import FollowConfig, RefineConfig, SegmentConfig
from depth_pose.core.errors import ConfigError, DepthPoseError
from depth_pose.core.outputs import check_targets
from depth_pose.io.damage import tell_damage
from depth_pose.io.image_options import ImageOptions

_ROS_PACKAGES = ("rclpy", "builtin_interfaces", "rosidl_runtime_py", "rpyutils")

_WITHOUT_OUR_MESSAGES = (
    "nodes.lifecycle",
    "tools.bag",
    "tools.inspect_topics",
    "tools.node_parameters",
    "tools.topics",
    "transport.find_depth",
)
"""Modules that work where `depth_pose_msgs` is not built, as on a robot with another ROS."""


_Namespace = Annotated[str, typer.Option(help="Namespace of the nodes.")]
_Nodes = Annotated[
    list[str] | None,
    typer.Option(help="Only denoise, matcher, refine, recovery, volume or fusion; may be repeated."),
]


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    for command in (up, pause, resume, play, record, demo):
        app.command()(command)


def call_ros(module: str, function: str, *arguments: Any, **options: Any) -> Any:
    """Call a function of a module that needs ROS."""
    os.umask(0o077)  # recordings of people are readable by this account only
    try:
        importlib.import_module("depth_pose.ros.process.logs").ensure_log_folder()
        importlib.import_module("rclpy")  # the nodes' processes would end with tracebacks
        if module not in _WITHOUT_OUR_MESSAGES:
            importlib.import_module("depth_pose_msgs.msg")
        found = importlib.import_module(f"depth_pose.ros.{module}")
        return getattr(found, function)(*arguments, **options)
    except ImportError as error:
        missing = (error.name or "").partition(".")[0]
        if missing == "depth_pose_msgs":
            raise DepthPoseError(
                "the messages depth_pose_msgs are not built for this Python; run: bash "
                "launch_scripts/setup.sh in a clone"
            ) from error
        if missing in _ROS_PACKAGES or missing.endswith("_msgs"):
            raise DepthPoseError(
                f"ROS 2 is not installed in this Python ({missing} is missing); run: bash "
                "launch_scripts/setup.sh in a clone, or source a ROS 2 Jazzy installation"
            ) from error
        raise


def up(
    sensor: Annotated[
        str | None, typer.Option(help="Topics of a known driver (a wrong name lists them).")
    ] = None,
    auto: Annotated[
        bool, typer.Option("--auto", help="Use the only depth topic there is, of any name and type.")
    ] = False,
    params: Annotated[
        Path | None, typer.Option(help="ROS parameter file (key /**:) for all nodes.", metavar="FILE")
    ] = None,
    bank: shared.BankFile = None,
    method: Annotated[str | None, setting(RefineConfig, "method")] = None,
    near: Annotated[float | None, setting(SegmentConfig, "near")] = None,
    far: Annotated[float | None, setting(SegmentConfig, "far")] = None,
    people: Annotated[int | None, setting(SegmentConfig, "most_people", "--people")] = None,
    speed: Annotated[str | None, setting(SegmentConfig, "speed")] = None,
    zone: Annotated[str | None, setting(SegmentConfig, "zone")] = None,
    follow: Annotated[str | None, setting(FollowConfig, "whom", "--follow")] = None,
    sim_time: Annotated[bool, typer.Option("--sim-time", help="Take the time from /clock.")] = False,
    namespace: Annotated[
        str | None,
        typer.Option(
            help="For one of several cameras: all topics below /NAME/depth_pose.",
            metavar="NAME",
            show_default="/depth_pose",
        ),
    ] = None,
    remap: Annotated[
        list[str] | None,
        typer.Option("--remap", "-r", help="ROS remapping rule FROM:=TO; may be repeated.", metavar="RULE"),
    ] = None,
    local: Annotated[
        bool,
        typer.Option("--local", help="Communicate on this machine only: loopback sockets, no multicast."),
    ] = False,
) -> None:
    """Run the four nodes: a depth sensor's topics in, everybody on /depth_pose/skeletons out.

    /depth_pose/skeleton is the followed person.

    [bold]Examples:[/bold]

    depth-pose up

    depth-pose up --sensor realsense --far 5

    depth-pose up --auto

    depth-pose up --zone 1:4.5 --follow nearest

    depth-pose up --params my.yaml --bank my_bank.npz

    depth-pose up --namespace left --params left.yaml
    """
    if auto and sensor is not None:
        raise ConfigError("give either --auto, which finds the topics, or --sensor, which names them")
    parameters: dict[str, Any] = {
        name: value
        for name, value in (
            ("refine.method", method),
            ("segment.near", near),
            ("segment.far", far),
            ("segment.most_people", people),
            ("segment.speed", speed),
            ("zone", zone),
            ("follow", follow),
        )
        if value is not None
    }
    if sim_time:
        parameters["use_sim_time"] = True
    if auto:
        source = call_ros("transport.find_depth", "find_depth", local)
        say(f"depth comes from {source}")
        parameters |= source.parameters
    rules = [f"__ns:=/{namespace.strip('/')}/depth_pose"] if namespace is not None else []
    options = {"parameters": parameters, "remap": [*rules, *(remap or ())], "local": local}
    code = call_ros("process.supervisor", "up", params, sensor, bank, **options)
    raise typer.Exit(code)


def pause(
    namespace: _Namespace = "depth_pose",
    node: _Nodes = None,
) -> None:
    """Pause the running nodes: they process no frames but keep bank and kernels loaded.

    They are lifecycle nodes: `ros2 lifecycle set /depth_pose/denoise deactivate` pauses one.

    [bold]Examples:[/bold]

    depth-pose pause

    depth-pose pause --node volume
    """
    _tell_states(call_ros("nodes.lifecycle", "set_active", False, node or None, namespace=namespace))


def resume(
    namespace: _Namespace = "depth_pose",
    node: _Nodes = None,
) -> None:
    """Resume nodes that were paused, or started with the parameter autostart set to false.

    [bold]Examples:[/bold]

    depth-pose resume
    """
    _tell_states(call_ros("nodes.lifecycle", "set_active", True, node or None, namespace=namespace))


def _tell_states(states: dict[str, str]) -> None:
    print_facts("nodes", sorted(states.items()))


def play(
    bag: shared.AnyRecording,
    rate: Annotated[float, typer.Option(min=0.01, max=100, help="Speed factor.")] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="Start again at the end.")] = False,
    clock: Annotated[bool, typer.Option(help="Publish /clock.")] = True,
    topic: Annotated[list[str] | None, typer.Option(help="Play this topic; may be repeated.")] = None,
    remap: Annotated[
        list[str] | None, typer.Option(help="Rename a topic; may be repeated.", metavar="OLD:=NEW")
    ] = None,
    delay: Annotated[float, typer.Option(min=0, help="Seconds to wait before the first message.")] = 0.0,
    wait_for: Annotated[
        int, typer.Option(min=0, help="Wait for this number of subscribers.", metavar="N")
    ] = 0,
    intrinsics: shared.Intrinsics = None,
    depth_scale: shared.DepthScale = None,
    fps: shared.Fps = None,
    lenient: shared.Lenient = False,
) -> None:
    """Publish a recording on its topics, with /clock.

    Topics that were latched when recorded are latched again. The first message waits until running nodes have
    found the topics, about a second.

    [bold]Examples:[/bold]

    depth-pose play in.mcap

    depth-pose play in.mcap --rate 0.5 --loop

    depth-pose play bag/ --remap /kinect/depth:=/camera/depth/image_raw
    """
    be_lenient(lenient)
    options: dict[str, Any] = {"rate": rate, "loop": loop, "clock": clock, "topics": topic or None}
    options |= {"remap": _renamed(remap or []), "delay_s": delay, "wait_for": wait_for}
    options |= {"wait_s": math.inf if wait_for else 10.0}
    options["images"] = ImageOptions.parse(intrinsics, depth_scale, fps)
    played = call_ros("tools.bag", "play", bag, **options)
    rows = [(name, f"{count} messages") for name, count in sorted(played.messages.items())]
    rows += [(name, f"not played: {reason}") for name, reason in sorted(played.skipped.items())]
    print_facts(f"{bag}: {played.wall_s:.2f} s", rows)
    warn(played.gaps)
    tell_damage(played.damage)


def _renamed(rules: list[str]) -> dict[str, str]:
    """Parse remapping rules ``/old:=/new``."""
    named = {}
    for rule in rules:
        old, is_rule, new = rule.partition(":=")
        if not (old and is_rule and new):
            raise ConfigError(f"--remap is {rule!r}; it is OLD:=NEW")
        named[old] = new
    return named


def record(
    output: Annotated[Path, typer.Option("--output", "-o", help="The MCAP file.")],
    topics: Annotated[list[str] | None, typer.Argument(help="Topics.", show_default="all")] = None,
    seconds: Annotated[
        float | None, typer.Option(min=0.1, help="Stop after this many seconds.", show_default="Ctrl-C")
    ] = None,
) -> None:
    """Record topics.

    [bold]Examples:[/bold]

    depth-pose record -o out.mcap /depth_pose/skeletons

    depth-pose record -o all.mcap --seconds 30
    """
    check_targets([output])
    check_ending(output, ".mcap", "a recording")
    begun = "recording, Ctrl-C ends" if seconds is None else f"recording {seconds:g} s"
    options = {"seconds": seconds, "on_start": lambda: console.print(begun)}
    counts = call_ros("tools.bag", "record", output, topics or None, **options)
    if not counts:
        what = f"no message arrived that could be recorded; {output} is not written"
        raise DepthPoseError(call_ros("process.shared_memory", "with_account_advice", what))
    print_facts(str(output), [(name, f"{count} messages") for name, count in sorted(counts.items())])


def demo(
    recording: Annotated[
        Path | None, typer.Argument(help="Your own recording.", show_default="a simulated one")
    ] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Output folder.")] = Path("results"),
) -> None:
    """Replay a recording through the live nodes, record the skeletons, and draw them.

    [bold]Examples:[/bold]

    depth-pose demo

    depth-pose demo in.mcap
    """
    code = call_ros("tools.demo", "run_demo", recording, output)
    raise typer.Exit(code or 0)
