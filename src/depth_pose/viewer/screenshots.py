"""Screenshots of the browser: PNG, or animated GIF."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.outputs import new_file

Picture = NDArray[np.uint8]

_COLOURS = 128
"""Frame rate of a GIF."""


def free_name(folder: Path, ending: str) -> Path:
    """Return the first free name of ``view_001.png``, ``view_002.png``, ..."""
    number = 1
    while (path := folder / f"view_{number:03}{ending}").exists():
        number += 1
    return path


def save_png(path: Path, picture: Picture) -> None:
    """Write one picture (H, W, 3)."""
    from PIL import Image

    with new_file(path) as stream:
        Image.fromarray(np.ascontiguousarray(picture[..., :3])).save(stream, format="PNG", optimize=True)


def save_gif(path: Path, pictures: Sequence[Picture], frame_s: float) -> None:
    """Write pictures (H, W, 3) as a looping GIF, with one table of colours to avoid flicker."""
    from PIL import Image

    images = [Image.fromarray(np.ascontiguousarray(p[..., :3])) for p in pictures]
    few = images[:: max(1, len(images) // 8)]
    sample = Image.new("RGB", (few[0].width, few[0].height * len(few)))
    for i, image in enumerate(few):
        sample.paste(image, (0, i * image.height))
    table = sample.quantize(_COLOURS, method=Image.Quantize.MEDIANCUT)
    drawn = [image.quantize(palette=table, dither=Image.Dither.NONE) for image in images]
    with new_file(path) as stream:
        drawn[0].save(
            stream,
            format="GIF",
            save_all=True,
            append_images=drawn[1:],
            duration=max(20, round(frame_s * 1000)),
            loop=0,
            optimize=False,
        )
