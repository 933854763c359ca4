"""The commands that look at running nodes: ``depth-pose topics``, ``echo``, ``hz``, ``tf`` and ``param``."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from depth_pose.cli.console import console, print_facts, say, warn
from depth_pose.cli.live import call_ros
from depth_pose.core.errors import InputError


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    for command in (topics, echo, hz, tf):
        app.command()(command)
    app.add_typer(param, name="param")


param = typer.Typer(no_args_is_help=True, help="List, read and set parameters of running nodes.")


_EVERY = Annotated[float, typer.Option(min=0.05, help="Seconds between two lines.")]
"""Period of the lines, seconds; at most 20 lines a second."""
_COUNT = Annotated[
    int | None, typer.Option(min=1, help="Stop after this number of lines.", show_default="Ctrl-C")
]
"""Option of both commands."""


def topics() -> None:
    """List the topics: type, publishers and subscribers, as `ros2 topic list -v` does.

    [bold]Examples:[/bold]

    depth-pose topics
    """
    found = call_ros("tools.topics", "list_topics")
    if not found:
        raise InputError("there is no topic: nothing runs in this domain (ROS_DOMAIN_ID)")
    rows = [
        (state.name, f"{', '.join(state.types)}: {state.publishers} publish, {state.subscribers} subscribe")
        for state in found
    ]
    print_facts("topics", rows)


def echo(
    topic: Annotated[str, typer.Argument(help="A topic.")] = "/depth_pose/skeleton",
    count: Annotated[
        int | None, typer.Option(min=1, help="Stop after this number of messages.", show_default="Ctrl-C")
    ] = None,
) -> None:
    """Print the messages of a topic as YAML, as `ros2 topic echo` does; long arrays are cut.

    [bold]Examples:[/bold]

    depth-pose echo

    depth-pose echo /camera/depth/camera_info --count 1
    """
    import yaml

    for message in _first(call_ros("tools.topics", "echo", topic), count):
        text = yaml.safe_dump(message, sort_keys=False, default_flow_style=None, width=100)
        for line in text.splitlines():
            say(line)
        say("---")


def hz(
    topic: Annotated[str, typer.Argument(help="A topic.")] = "/depth_pose/skeletons",
    every: _EVERY = 1.0,
    count: _COUNT = None,
) -> None:
    """Print the message rate of a topic, as `ros2 topic hz` does.

    [bold]Examples:[/bold]

    depth-pose hz

    depth-pose hz /camera/depth/image_raw --count 5
    """
    watched = call_ros("tools.inspect_topics", "watch_rate", topic, every)
    for k, rate in enumerate(_first(watched, count)):
        if rate is None:
            say(f"{topic}: no messages")
            if k == 0:
                warn(filter(None, [call_ros("process.shared_memory", "other_account_advice")]))
            continue
        console.print(
            f"average rate: {rate.hz:.2f}  min: {rate.low_s:.3f} s  max: {rate.high_s:.3f} s  "
            f"std dev: {rate.deviation_s:.4f} s  messages: {rate.count}",
            highlight=False,
            soft_wrap=True,
        )


def tf(
    frame: Annotated[str | None, typer.Argument(help="A frame.", show_default="list them")] = None,
    parent: Annotated[
        str | None, typer.Option("--in", help="Print the transform relative to this frame.")
    ] = None,
    every: _EVERY = 1.0,
    count: _COUNT = None,
) -> None:
    """Print the transform of a /tf frame, as `tf2_echo` does, or list all frames.

    Nodes broadcast frames with the parameter tf or rep155. With tf the followed person's joints are
    left_wrist and so on, everybody's body_1_left_wrist; the floor is floor, and the optical frame is that of
    the depth images. --in takes any of them.

    [bold]Examples:[/bold]

    depth-pose tf

    depth-pose tf left_wrist --in floor

    depth-pose tf body_1_head --in camera_depth_optical_frame
    """
    frames = call_ros("tools.inspect_topics", "list_frames", every)
    if not frames:
        raise InputError(
            "no frame is broadcast: nobody is in view, or the nodes run without the parameter "
            "tf: true, or rep155: true"
        )
    if frame is None:
        print_facts("frames", sorted((child, f"in {above}") for child, above in frames.items()))
        return
    known = {*frames, *frames.values()}
    for name in filter(None, (frame, parent)):
        if name.lstrip("/") not in known:
            raise InputError(f"no frame {name} is broadcast; there are {', '.join(sorted(known))}")
    parent = parent or frames.get(frame.lstrip("/"))
    if parent is None:
        raise InputError(f"{frame} has no frame above it; give one with --in: {', '.join(sorted(frames))}")
    for place in _first(call_ros("tools.inspect_topics", "watch_frame", frame, parent, every), count):
        if place is None:
            say(f"{frame} in {parent}: not known yet")
        else:
            _print_place(place)


def _first(watched: Any, count: int | None) -> Any:
    """Yield values until `count` of them were not None."""
    known = 0
    for told in watched:
        yield told
        known += told is not None
        if known == count:
            return


def _print_place(place: Any) -> None:
    def text(values: Any) -> str:
        return "[" + ", ".join(f"{v:.3f}" for v in values) + "]"

    seconds, rest = divmod(place.stamp_ns, 1_000_000_000)
    console.print(
        f"At time {seconds}.{rest:09d}\n"
        f"- Translation: {text(place.T_parent_frame[:3, 3])}\n"
        f"- Rotation: in Quaternion (xyzw) {text(place.quat_xyzw)}\n"
        f"- Rotation: in RPY (degree) {text(place.rpy_deg)}",
        highlight=False,
        markup=False,
        soft_wrap=True,
    )


_NODE = Annotated[str, typer.Argument(help="A node: denoise, matcher, refine, recovery; or its full name.")]
_PARAMETER = Annotated[str, typer.Argument(help="The parameter's name.")]


@param.command(name="list")
def list_parameters(
    node: Annotated[
        str | None, typer.Argument(help="A node, as of get.", show_default="all nodes of depth_pose")
    ] = None,
) -> None:
    """List parameters with their values.

    [bold]Examples:[/bold]

    depth-pose param list

    depth-pose param list recovery

    depth-pose param list /left/depth_pose/denoise
    """
    for name, values in call_ros("tools.node_parameters", "list_parameters", node).items():
        print_facts(name, [(parameter, str(value)) for parameter, value in values.items()])


@param.command(name="get")
def get_parameter(node: _NODE, parameter: _PARAMETER) -> None:
    """Print the value of a parameter.

    [bold]Examples:[/bold]

    depth-pose param get denoise segment.far
    """
    say(str(call_ros("tools.node_parameters", "get_parameter", node, parameter)))


@param.command(name="set")
def set_parameter(
    node: _NODE, parameter: _PARAMETER, value: Annotated[str, typer.Argument(help="The new value.")]
) -> None:
    """Set a parameter of a running node.

    [bold]Examples:[/bold]

    depth-pose param set denoise segment.far 5

    depth-pose param set denoise zone 1:4.5

    depth-pose param set recovery follow nearest
    """
    now = call_ros("tools.node_parameters", "set_parameter", node, parameter, value)
    say(f"{node} {parameter} = {now}")
