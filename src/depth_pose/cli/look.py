"""The commands that look at topics: ``depth-pose hz`` and ``depth-pose tf``."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from depth_pose.cli.console import console, print_facts, say
from depth_pose.cli.live import call_ros
from depth_pose.core.errors import InputError


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    for command in (hz, tf):
        app.command()(command)


_EVERY = Annotated[float, typer.Option(min=0.05, help="Seconds between two lines.")]
"""Period of the lines, seconds; at most 20 lines a second. Set by hand."""
_COUNT = Annotated[
    int | None, typer.Option(min=1, help="Stop after this number of lines.", show_default="Ctrl-C")
]
"""Option of both commands."""


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
    for rate in _first(watched, count):
        if rate is None:
            say(f"{topic}: no messages")
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

    Nodes broadcast frames with the parameter tf (joints, the floor) or rep155.

    [bold]Examples:[/bold]

    depth-pose tf

    depth-pose tf body_1_left_wrist --in floor
    """
    if frame is None or parent is None:
        frames = call_ros("tools.inspect_topics", "list_frames", every)
        if not frames:
            raise InputError(
                "no frame is broadcast: nobody is in view, or the nodes run without the parameter "
                "tf: true, or rep155: true"
            )
        if frame is None:
            print_facts("frames", sorted((child, f"in {above}") for child, above in frames.items()))
            return
        parent = frames.get(frame.lstrip("/"))
        if parent is None:
            raise InputError(f"no frame {frame} is broadcast; there are {', '.join(sorted(frames))}")
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
