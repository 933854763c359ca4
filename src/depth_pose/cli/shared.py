"""Options and arguments shared by several commands."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from depth_pose.cli.damage import LENIENT_HELP
from depth_pose.core.errors import ConfigError

if TYPE_CHECKING:
    from depth_pose.rooms.placed_camera import PlacedCamera

AnyRecording = Annotated[
    Path, typer.Argument(help="Recording: MCAP, .db3, ROS 1's .bag, a folder of parts or of images.")
]
DepthTopic = Annotated[
    str | None, typer.Option(help="Depth images or point cloud.", show_default="the only one")
]
SkeletonsTopic = Annotated[str, typer.Option(help="The skeletons' topic.")]
BankFile = Annotated[Path | None, typer.Option(help="Exemplar bank.", show_default="the set-up's")]
RigFile = Annotated[
    Path | None, typer.Option("--rig", help="Rig file of the cameras, for skeletons in the room's frame.")
]
RigCameraName = Annotated[
    str | None,
    typer.Option(
        "--camera",
        help="With --rig: name or number (from 0) of the camera of the depth recording.",
        show_default="the one whose name, or number at its end, the recording has",
    ),
]
Lenient = Annotated[bool, typer.Option("--lenient", help=LENIENT_HELP)]

# Of folders of images.
Intrinsics = Annotated[
    str | None,
    typer.Option(
        help="For a folder of depth images: the camera, pixels.",
        metavar="FX,FY,CX,CY",
        show_default="camera.json",
    ),
]
DepthScale = Annotated[
    float | None,
    typer.Option(
        min=1e-6,
        max=1e3,
        help="Metres per unit of the depth.",
        show_default="0.001; 1 for floats",
    ),
]
"""Metres; limits set by hand."""
Fps = Annotated[
    float | None,
    typer.Option(
        min=1e-3,
        max=1e4,
        help="For a folder of depth images: frames per second.",
        show_default="30, or from the names",
    ),
]
"""Hertz; limits set by hand."""


def placed_camera(rig_file: Path | None, name: str | None, recording: Path) -> PlacedCamera | None:
    """Return the camera of a rig that made a depth recording; None without a rig.

    Raises
    ------
    ConfigError
        As `depth_pose.rooms.placed_camera.choose_camera`, and for a name without a rig.
    InputError
        Where the rig cannot be read.
    """
    if rig_file is None:
        if name is not None:
            raise ConfigError("--camera names a camera of a rig; give its file with --rig")
        return None
    from depth_pose.rooms.placed_camera import choose_camera
    from depth_pose.rooms.rigfile import load_rig

    return choose_camera(load_rig(rig_file), rig_file, recording, name)
