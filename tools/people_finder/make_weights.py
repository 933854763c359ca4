"""Make the people finder's weights from scratch: scenes, training, verifier, joint nets, their deviations.

    pip install -e '.[train]'
    python tools/people_finder/make_weights.py build/people_finder

Existing files are kept, so that an interrupted run can be continued. The result is in FOLDER/integers (with
floats in FOLDER/weights); copy it to src/depth_pose/detect/weights to release it. It takes about
twelve hours on 2 cores.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer
from make_scenes import Style
from rich.console import Console

_HERE = Path(__file__).resolve().parent
_TRAIN_SEED, _CHECK_SEED = 1, 900_001
_STUDIO_TRAIN_SEED, _STUDIO_CHECK_SEED = 2, 900_002
_ALIKE_TRAIN_SEED, _ALIKE_CHECK_SEED = 3, 900_003
"""Seeds of all these scenes: weights are never checked on what they were trained on."""
_ALIKE, _ALIKE_CHECKS = 7_500, 750
"""Number of scenes with lookalikes, for training and for checking. Set by hand."""
_IMAGES, _BATCH, _RATE = 240_000, 16, 2e-3
"""The finder's training: images in all, images per step, and the highest learning rate. Set by hand."""
_CROPS, _FALL = 2_300_000, 300_000
"""The joint net's training: crops at the highest rate, and while it falls. Set by hand."""
_FRESH = 0.6
"""New close-ups for each crop that is no sighting, each of another person: a million in all. Set by hand."""
_FINE_CROPS = 200_000
"""Crops of the quick net's training. Set by hand."""
_COARSE = ("git", "show", "fe355e5:src/depth_pose/people/weights/joint_finder.onnx")
"""Its coarse net is the one released before, with floats."""

app = typer.Typer(add_completion=False)


@app.command()
def main(
    folder: Annotated[Path, typer.Argument(help="Folder for scenes, checkpoints and weights (2 GB)")],
    scenes: Annotated[int, typer.Option(help="Scenes to train on")] = 18_500,
    checks: Annotated[int, typer.Option(help="Other scenes, for the verifier")] = 4_000,
    workers: Annotated[int, typer.Option(help="Processes")] = 2,
    seed: Annotated[int, typer.Option(help="Start of the training's random numbers")] = 1,
) -> None:
    """Make scenes, train the finder, fit the verifier, train the joint net."""
    train, check = folder / "train", folder / "val"
    alike, alike_check = folder / "lookalikes" / "train", folder / "lookalikes" / "val"
    for place, style, count, made_from in (
        (train, Style.MIXED, scenes, _TRAIN_SEED),
        (check, Style.MIXED, checks, _CHECK_SEED),
        (train, Style.STUDIOS, scenes // 12, _STUDIO_TRAIN_SEED),
        (check, Style.STUDIOS, checks // 4, _STUDIO_CHECK_SEED),
        (alike, Style.LOOKALIKES, _ALIKE, _ALIKE_TRAIN_SEED),
        (alike_check, Style.LOOKALIKES, _ALIKE_CHECKS, _ALIKE_CHECK_SEED),
    ):
        how = ("--style", style.value, "--seed", made_from, "--workers", workers)
        call("make_scenes.py", "-o", place, "--count", count, *how)
    people, at_once = folder / "people", ("--workers", workers)
    if not (people / "last.pt").exists():
        cycle = ("--images", _IMAGES, "--batch", _BATCH, "--rate", _RATE)
        call("train.py", train, people, *cycle, "--seed", seed, *at_once)
    note = f"{scenes} scenes, {_IMAGES} images, seed {seed}, {workers} at once"
    call("fit_verifier.py", people / "last.pt", check, folder / "weights", "--note", note)
    found, found_apart = folder / "sightings_train.npz", folder / "sightings_val.npz"
    for file, places in ((found, (train, alike)), (found_apart, (check, alike_check))):
        if not file.exists():
            call("find_sightings.py", folder / "weights", file, *places, *at_once)
    joints, coarse = folder / "joints", folder / "coarse.onnx"
    if not coarse.exists():
        coarse.write_bytes(subprocess.run(_COARSE, check=True, capture_output=True, cwd=_HERE).stdout)
    if not (joints / "last.pt").exists():
        length = ("--crops", _CROPS, "--decay", _FALL, "--fresh", _FRESH, "--views", 1, "--seed", seed)
        call("train_joints.py", joints, "--coarse", coarse, "--sightings", found, *length)
    note = f"{_CROPS} and {_FALL} crops, seed {seed}"
    call("export_joints.py", joints / "last.pt", found_apart, folder / "weights", "--note", note)
    call("quantise.py", folder / "weights", folder / "integers")
    call("fit_deviations.py", folder / "integers")
    fine, quick = folder / "fine.pt", folder / "quick"
    if not fine.exists():
        call("leave_out_coarse.py", joints / "last.pt", fine, "--sightings", found, "--crops", _FINE_CROPS)
    shutil.copytree(folder / "weights", quick / "weights", dirs_exist_ok=True)  # the finder, too
    note = f"{_FINE_CROPS} crops, taught by both nets"
    call("export_joints.py", fine, found_apart, quick / "weights", "--alone", "--note", note)
    call("quantise.py", quick / "weights", quick / "integers")
    call("fit_deviations.py", quick / "integers")
    for kind in ("onnx", "json"):
        made, named = quick / "integers" / f"joint_finder.{kind}", f"quick_joint_finder.{kind}"
        shutil.copyfile(made, folder / "integers" / named)


def call(script: str, *arguments: object) -> None:
    """Run one of the scripts beside this one; its failure ends the run."""
    Console().rule(script)
    subprocess.run([sys.executable, str(_HERE / script), *map(str, arguments)], check=True)


if __name__ == "__main__":
    app()
