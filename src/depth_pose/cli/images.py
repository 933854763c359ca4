"""Options of the commands that read folders of images."""

from __future__ import annotations

import typer

IMAGE_INTRINSICS = typer.Option(
    help="Of a folder of depth images: the camera, pixels.", metavar="FX,FY,CX,CY", show_default="camera.json"
)
IMAGE_SCALE = typer.Option(
    min=1e-6,
    max=1e3,
    help="Of a folder of depth images: metres of a pixel's unit.",
    show_default="0.001; 1 for floats",
)
"""Metres; limits set by hand."""
IMAGE_FPS = typer.Option(
    min=1e-3,
    max=1e4,
    help="Of a folder of depth images: frames a second.",
    show_default="30, or the names say it",
)
"""Hertz; limits set by hand."""
