"""``depth-pose fuse``: the skeletons of several live cameras, merged."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from depth_pose.cli.live import call_ros
from depth_pose.core.errors import ConfigError


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(fuse)


def fuse(
    rig: Annotated[
        Path | None,
        typer.Option(help="Names and poses of the cameras (rig file).", show_default="poses from /tf_static"),
    ] = None,
    topic: Annotated[
        list[str] | None,
        typer.Option(
            help="Skeletons of a camera, in the rig's order; may be repeated.",
            show_default="/CAMERA/depth_pose/skeletons",
        ),
    ] = None,
    room_frame: Annotated[str, typer.Option(help="Frame of the merged skeletons.")] = "room",
    tf: Annotated[bool, typer.Option("--tf", help="Broadcast every joint on /tf.")] = False,
    rep155: Annotated[
        bool, typer.Option("--rep155", help="Publish all people by REP-155: /humans/bodies/...")
    ] = False,
    params: Annotated[
        Path | None, typer.Option(help="ROS parameter file (key /**:).", metavar="FILE")
    ] = None,
    sim_time: Annotated[bool, typer.Option("--sim-time", help="Take the time from /clock.")] = False,
    local: Annotated[
        bool,
        typer.Option("--local", help="Communicate on this machine only: loopback sockets, no multicast."),
    ] = False,
) -> None:
    """Merge the skeletons of several cameras: everybody in the room on /depth_pose/room/skeletons.

    Each camera has a suite of its own, on this machine or another; the rig file holds its pose. A camera that
    stops, lags or was moved is excluded until it agrees with the others again.

    [bold]Examples:[/bold]

    depth-pose up --namespace cam_a --params cam_a.yaml   (one for each camera)

    depth-pose fuse --rig rig.yaml

    depth-pose fuse --topic /left/skeletons --topic /right/skeletons --tf
    """
    if rig is None and not topic and params is None:
        raise ConfigError("give --rig (a rig file), or --topic for each camera with poses on /tf_static")
    parameters: dict[str, Any] = {"room_frame": room_frame}
    parameters |= {"rig": str(rig.absolute())} if rig is not None else {}
    parameters |= {"topics": topic} if topic else {}
    chosen = {"tf": tf, "rep155": rep155, "use_sim_time": sim_time}
    parameters |= {name: True for name, is_chosen in chosen.items() if is_chosen}
    options = {"parameters": parameters, "local": local, "nodes": ("fusion",), "skeletons": "room/skeletons"}
    raise typer.Exit(call_ros("process.supervisor", "up", params, **options))
