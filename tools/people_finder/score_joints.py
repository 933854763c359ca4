"""Score the joint net's joints alone, as the pipeline gets them, on recordings with a reference.

    python tools/people_finder/score_joints.py DATA --weights build/people_finder/integers

DATA is a folder of folders of recordings: NAME.mcap with NAME.npz (joints, metres) or NAME.json (boxes and
joints in pixels, of real sequences), or ``real_kinect2``, whose joints lie in one file.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.config import DenoiseConfig, MountConfig, SegmentConfig
from depth_pose.core.skeleton import JOINT_INDEX, JOINTS
from depth_pose.detect.learned_segmenter import LearnedSegmenter
from depth_pose.io.mcap_read import read_frames
from depth_pose.perception import Perception

Array = NDArray[np.float64]

SETS = (
    "dev", "dev_bodies", "dev_more", "dev_postures", "dev_postures2",
    "real_office", "real_corridor", "real_sofa", "real_kinect2",
)  # fmt: skip
_GROUPS = ("head", "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "foot")
_FAR_M = 0.6
"""A person whose torso is farther than this from the truth is another one, metres."""
_TORSO = [JOINT_INDEX[f"{side}_{n}"] for side in ("left", "right") for n in ("shoulder", "hip")]
_ADULT_M = 1.7

app = typer.Typer(add_completion=False)


@dataclass(frozen=True)
class Looked:
    """One person in one frame: joints and their deviations, and the truth.

    ``off`` (J, 3): metres, for clips; ``share`` (n,): of the height in the image, for real sequences.
    """

    off: Array
    sigma: Array
    share: Array


def _frames(path: Path, weights: Path | None, step: int) -> Iterator[tuple[Any, list[Any]]]:
    perception = Perception(SegmentConfig(), DenoiseConfig(), MountConfig())
    if weights is not None:
        perception.segmenter = LearnedSegmenter(SegmentConfig(), weights)
    for k, frame in enumerate(read_frames(path)):
        if k % step == 0:
            people = perception.perceive(frame).persons
            yield frame, [p.measured for p in people if p.measured is not None]


def score_clip(path: Path, weights: Path | None, step: int) -> Iterator[Looked | None]:
    """Compare with joints in metres; None where no person is near the truth."""
    data = np.load(path.with_suffix(".npz"))
    for frame, found in _frames(path, weights, step):
        truth = data["joints"][int(np.argmin(np.abs(data["stamps_ns"] - frame.stamp_ns)))].astype(float)
        away = [np.linalg.norm((p.places[_TORSO] - truth[_TORSO]).mean(axis=0)) for p in found]
        if not away or min(away) > _FAR_M:
            yield None
            continue
        person = found[int(np.argmin(away))]
        yield Looked(person.places - truth, person.sigma.astype(float), np.zeros(0))


def score_sequence(path: Path, weights: Path | None) -> Iterator[Looked | None]:
    """Compare with joints in pixels, of every person that counts."""
    references = {r["stamp_ns"]: r for r in json.loads(path.with_suffix(".json").read_text())}
    for frame, found in _frames(path, weights, 1):
        if frame.stamp_ns not in references:
            continue
        for asked in references[frame.stamp_ns]["persons"]:
            if not asked["ignore"]:
                yield _best(found, asked["joints"], frame.camera, _height(asked, frame.camera))


def score_singles(path: Path, weights: Path | None) -> Iterator[Looked | None]:
    """Compare with ``joints_2d.json``: a frame, a person."""
    references = json.loads((path.parent / "joints_2d.json").read_text())
    for (frame, found), joints in zip(_frames(path, weights, 1), references, strict=True):
        rows = np.nonzero((frame.depth > 0).any(axis=1))[0]
        yield _best(found, joints, frame.camera, float(rows[-1] - rows[0]))


def _height(asked: dict[str, Any], camera: Camera) -> float:
    """Height of a person in the image: of their box, or of an adult if they are cut off or seated."""
    tall, away = asked["box"][3] - asked["box"][1], asked["median_depth_m"]
    whole = _ADULT_M * camera.fy / away if away > 0 else tall
    cut = tall < 0.8 * whole or any(word in asked["note"] for word in ("cut", "seated"))
    return float(whole if cut else tall)


def _best(found: list[Any], joints: dict[str, Any], camera: Camera, height: float) -> Looked | None:
    shares = []
    for person in found:
        pixels = camera.project(person.places.astype(float))
        off = [np.hypot(*(pixels[JOINT_INDEX[n]] - [u, v])) for n, (u, v, _) in joints.items()]
        shares.append(np.array(off) / height)
    if not shares or min(np.median(s) for s in shares) > 0.5:
        return Looked(np.zeros((0, 3)), np.zeros((0, 2)), np.full(len(joints), np.inf))
    return Looked(np.zeros((0, 3)), np.zeros((0, 2)), min(shares, key=lambda s: float(np.median(s))))


def _line(name: str, looks: list[Looked | None]) -> str:
    seen = [s for s in looks if s is not None]
    answered = len(seen) / max(len(looks), 1)
    if not seen or not len(seen[0].off):
        share = np.concatenate([s.share for s in seen]) if seen else np.zeros(0)
        found = np.mean([np.isfinite(s.share).all() for s in seen]) if seen else 0.0
        pck = f"PCK.10 {(share < 0.1).mean():.3f} PCK.05 {(share < 0.05).mean():.3f}"
        return f"{name:14s} found {found:.3f} {pck}"
    off, sigma = np.array([s.off for s in seen]), np.array([s.sigma for s in seen])
    error = np.linalg.norm(off, axis=-1)
    parts = [
        f"{g} {1000 * error[:, [k for k, n in enumerate(JOINTS) if n.endswith(g)]].mean():.0f}"
        for g in _GROUPS
    ]
    spread = np.stack([np.sqrt((off[..., :2] ** 2).mean(axis=-1)), np.abs(off[..., 2])], axis=-1)
    inside = (spread < sigma).mean(axis=(0, 1))
    return (
        f"{name:14s} answered {answered:.3f} mean {1000 * error.mean():5.1f} median "
        f"{1000 * np.median(error):5.1f} within {(error < 0.1).mean():.3f}  {' '.join(parts)}"
        f"  within sigma: plane {inside[0]:.2f} depth {inside[1]:.2f}"
    )


@app.command()
def main(
    data: Annotated[Path, typer.Argument(help="Folder of folders of recordings")],
    weights: Annotated[
        Path | None, typer.Option(help="Folder of both nets; the released ones by default")
    ] = None,
    only: Annotated[list[str] | None, typer.Option(help="Folders to score")] = None,
    step: Annotated[int, typer.Option(help="Use every n-th frame of clips with joints", min=1)] = 4,
    each: Annotated[bool, typer.Option(help="Print a line for every recording")] = False,
) -> None:
    """Score the joint net's joints."""
    for name in only or SETS:
        total: list[Looked | None] = []
        for path in sorted((data / name).glob("*.mcap")):
            if path.with_suffix(".npz").exists():
                looks = list(score_clip(path, weights, step))
            elif path.with_suffix(".json").exists():
                looks = list(score_sequence(path, weights))
            else:
                looks = list(score_singles(path, weights))
            total += looks
            if each:
                print(_line(path.stem, looks), flush=True)
        print(_line(name, total), flush=True)


if __name__ == "__main__":
    app()
