"""Options and arguments shared by several commands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from depth_pose.cli.damage import LENIENT_HELP

AnyRecording = Annotated[
    Path, typer.Argument(help="Recording: MCAP, .db3, ROS 1's .bag, a folder of parts or of images.")
]
DepthTopic = Annotated[
    str | None, typer.Option(help="Depth images or point cloud.", show_default="the only one")
]
SkeletonsTopic = Annotated[str, typer.Option(help="The skeletons' topic.")]
BankFile = Annotated[Path | None, typer.Option(help="Exemplar bank.", show_default="the set-up's")]
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
