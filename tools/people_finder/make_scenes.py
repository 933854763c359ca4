"""Make shards of simulated rooms with people, to train and to check the people finder.

    python tools/people_finder/make_scenes.py -o scenes/train --count 24000 --seed 1
    python tools/people_finder/make_scenes.py -o scenes/val --count 1000 --seed 900001

Scene number i of a seed is always the same, in whatever order scenes are made. A shard ``scenes_FIRST.npz``
holds `SHARD` scenes on a grid of 240 rows by 320 columns, on which the image begins at the top left:

========== ====================== =====================================================================
depth      (N, 240, 320) uint16   millimetres; 0 where nothing returned
background (N, 240, 320) uint16   likewise, of the room without people and pets
person     (N, 240, 320) uint8    number of the person from 1, 0 for nobody; of the image without noise, so
                                  also where a person returns no depth
kind       (N, 240, 320) uint8    `depth_pose.sim.shapes.Kind`; likewise
K          (N, 4) float32         fx, fy, cx, cy, pixels of the grid
valid_size (N, 2) int16           rows and columns that the image fills; the rest of the grid is 0
joints     (N, 6, 19, 3) float32  metres, optical frame; NaN where there is no such person
visible    (N, 6) float32         share of a person's silhouette that the image shows; 0 for no person
returned   (N, 6) float32         share of what the image shows of a person that has depth
seen       (N, 6, 19) bool        whether a joint is in the image and hidden by nothing but the person
up         (N, 3) float32         away from the floor, optical frame
sensor     (N,) str               family of the sensor
fabrics    (N, 6, 4) str          materials of hair, top, trousers and shoes; empty where unknown
index      (N,) int64             number of the scene
========== ====================== =====================================================================
"""

from __future__ import annotations

import multiprocessing
import os
import zipfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from threadpoolctl import threadpool_limits

from depth_pose.sim.home_scenes import sample_home
from depth_pose.sim.home_sensors import sample_home_sensor
from depth_pose.sim.materials import WORN
from depth_pose.sim.scenes import MOST_PEOPLE, Scene, sample_scene

SHARD = 250
"""Scenes in a file."""

ROWS, COLUMNS = 240, 320
"""Largest image of a scene, pixels."""

app = typer.Typer(add_completion=False)


class Style(StrEnum):
    """Kinds of scenes; the value is the first part of their file names."""

    MIXED = "scenes"
    ROOMS = "rooms"
    HOMES = "homes"
    STUDIOS = "studios"
    LOOKALIKES = "lookalikes"


def make_scene(seed: int, index: int, style: Style = Style.MIXED, mounting: str | None = None) -> Scene:
    """Make scene number `index` of a seed; of mixed ones and of lookalikes every second is a home."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, index]))
    if style is Style.HOMES or (style in (Style.MIXED, Style.LOOKALIKES) and index % 2):
        nobody = 0 if style is Style.LOOKALIKES else None
        return sample_home(rng, width=COLUMNS, people=nobody, mounting=mounting, with_background=True)
    sensor = sample_home_sensor(rng)
    common = {"width": COLUMNS, "mounting": mounting, "sensor": sensor, "with_background": True}
    if style is Style.LOOKALIKES:
        return sample_scene(rng, people=0, studio=False, lookalikes=True, **common)
    return sample_scene(rng, studio=True if style is Style.STUDIOS else None, **common)


def make_shard(folder: Path, seed: int, style: Style, mounting: str | None, first: int, count: int) -> int:
    """Make a file of scenes, unless it exists; return the number of scenes."""
    path = folder / f"{style.value}_{first:07d}.npz"
    if path.exists():
        return count
    with threadpool_limits(1):  # more threads only wait for each other on images this small
        arrays = _stack([make_scene(seed, i, style, mounting) for i in range(first, first + count)])
    arrays["index"] = np.arange(first, first + count)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    _save(part, arrays)
    os.replace(part, path)
    return count


def _stack(scenes: list[Scene]) -> dict[str, NDArray[Any]]:
    n = len(scenes)
    arrays: dict[str, NDArray[Any]] = {
        "depth": np.zeros((n, ROWS, COLUMNS), np.uint16),
        "background": np.zeros((n, ROWS, COLUMNS), np.uint16),
        "person": np.zeros((n, ROWS, COLUMNS), np.uint8),
        "kind": np.zeros((n, ROWS, COLUMNS), np.uint8),
        "K": np.zeros((n, 4), np.float32),
        "valid_size": np.zeros((n, 2), np.int16),
        "joints": np.full((n, MOST_PEOPLE, 19, 3), np.nan, np.float32),
        "visible": np.zeros((n, MOST_PEOPLE), np.float32),
        "seen": np.zeros((n, MOST_PEOPLE, 19), bool),
        "returned": np.zeros((n, MOST_PEOPLE), np.float32),
        "up": np.zeros((n, 3), np.float32),
        "sensor": np.array([scene.sensor for scene in scenes]),
        "fabrics": np.zeros((n, MOST_PEOPLE, len(WORN)), "U16"),
    }
    for i, scene in enumerate(scenes):
        rows, columns = scene.depth.shape
        people, c = len(scene.joints), scene.camera
        arrays["depth"][i, :rows, :columns] = np.rint(scene.depth * 1000.0)
        if scene.background is not None:
            arrays["background"][i, :rows, :columns] = np.rint(scene.background * 1000.0)
        arrays["person"][i, :rows, :columns] = scene.person
        arrays["kind"][i, :rows, :columns] = scene.kind
        arrays["K"][i] = c.fx, c.fy, c.cx, c.cy
        arrays["valid_size"][i] = rows, columns
        for name in ("joints", "visible", "seen", "returned"):
            arrays[name][i, :people] = getattr(scene, name)
        for k, fabrics in enumerate(scene.fabrics):
            arrays["fabrics"][i, k, : len(fabrics)] = fabrics
        arrays["up"][i] = scene.up
    return arrays


def _save(path: Path, arrays: dict[str, NDArray[Any]]) -> None:
    """Write an .npz at the lowest compression level, which is nearly as small and far faster."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as stream:
                np.lib.format.write_array(stream, array, allow_pickle=False)


@app.command()
def main(
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the shards")],
    count: Annotated[int, typer.Option(min=1, help="Number of scenes")] = 24_000,
    first: Annotated[int, typer.Option(min=0, help="Number of the first scene")] = 0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all scenes")] = 1,
    workers: Annotated[int, typer.Option(min=1, help="Processes")] = 1,
    style: Annotated[
        Style,
        typer.Option(
            help="Scenes: half homes, half rooms; studios: people before a plain wall; lookalikes: half "
            "homes, half rooms with coats, and nobody"
        ),
    ] = Style.MIXED,
    mounting: Annotated[
        str | None,
        typer.Option(help="Mounting of every camera (common, ceiling, low, rolled); drawn if not given"),
    ] = None,
) -> None:
    """Make scenes; existing shards are kept, so that an interrupted run can be continued."""
    out.mkdir(parents=True, exist_ok=True)
    starts = range(first, first + count, SHARD)
    sizes = [min(SHARD, first + count - start) for start in starts]
    columns = (TextColumn("scenes"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns) as progress:
        task = progress.add_task("scenes", total=count)
        for done in _made(out, seed, style, mounting, list(zip(starts, sizes, strict=True)), workers):
            progress.advance(task, done)


def _made(
    folder: Path,
    seed: int,
    style: Style,
    mounting: str | None,
    shards: list[tuple[int, int]],
    workers: int,
) -> Iterator[int]:
    """Make shards in several processes; yield the size of each when it is done."""
    if workers == 1:
        yield from (make_shard(folder, seed, style, mounting, *shard) for shard in shards)
        return
    with pool(workers) as processes:
        for job in as_completed(
            [processes.submit(make_shard, folder, seed, style, mounting, *shard) for shard in shards]
        ):
            yield job.result()


@contextmanager
def pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Provide a pool of processes that ends with the block, also if the block fails."""
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as processes:
        try:
            yield processes
        except BaseException:
            processes.shutdown(wait=False, cancel_futures=True)
            raise


if __name__ == "__main__":
    app()
