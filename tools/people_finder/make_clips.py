"""Make simulated videos of several people in a room, to measure who finds and follows them.

    python tools/people_finder/make_clips.py -o clips --count 6 --people 3 --seed 1

Writes ``room_SEED_NUMBER.mcap`` and the truth, ``.npz``, beside it (`depth_pose.sim.clips`).
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.progress import Progress
from threadpoolctl import threadpool_limits

from depth_pose.sim.clips import sample_clip, write_clip

app = typer.Typer(add_completion=False)


@app.command()
def main(
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the videos")],
    count: Annotated[int, typer.Option(min=1, help="How many videos")] = 6,
    people: Annotated[int, typer.Option(min=0, max=6, help="How many people take part")] = 3,
    frames: Annotated[int, typer.Option(min=1, help="Frames of a video")] = 200,
    fps: Annotated[float, typer.Option(min=1.0, help="Frames a second")] = 15.0,
    width: Annotated[int, typer.Option(min=80, help="Columns of a 4:3 image")] = 320,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all videos")] = 1,
) -> None:
    """Make videos; the same seed gives the same ones."""
    out.mkdir(parents=True, exist_ok=True)
    with Progress() as progress, threadpool_limits(1):
        task = progress.add_task("frames", total=count * frames)
        for i in range(count):
            rng = np.random.default_rng(np.random.SeedSequence([seed, i]))
            clip = sample_clip(rng, frames, fps, people, width, lambda _: progress.advance(task))
            write_clip(out / f"room_{seed}_{i}.mcap", clip)


if __name__ == "__main__":
    app()
