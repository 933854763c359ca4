"""Collect true and false detections of the people finder in simulated scenes, to train the joint net.

    python tools/people_finder/find_sightings.py weights sightings.npz scenes/train lookalikes/train

Every look at a scene differs: mirrored, cropped as if the view were narrower, a room without people scaled.
The first look at each is the scene as it is. The file holds, of N sightings:

=========== ===================== ======================================================================
depth       (N, 128, 128) uint16    crop around the torso, millimetres; 0 where nothing returned
whose       (N, 128, 128) uint8     1 of the person, 0 not, 255 outside the image
mask        (N, 128, 128) uint8     1 where it truly shows the person, 0 where not
torso       (N, 3) float32        the finder's estimate, metres, optical frame
probability (N,) float32          the finder's, that this is a person
is_person   (N,) bool             half of its pixels are one person's, and no other detection has more of them
joints      (N, 19, 3) float32    of that person, metres, optical frame; NaN for an object
=========== ===================== ======================================================================
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from fit_verifier import frame_of, truth_on_grid, whose
from joint_net import CELL_M, SIDE
from make_scenes import pool
from numpy.typing import NDArray
from rich.progress import track
from scenes import Scenes, list_shards, load_scenes
from sightings import OUTSIDE

from depth_pose.core.config import SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.core.measurement import CropView
from depth_pose.core.skeleton import JOINTS, MIRROR_JOINTS
from depth_pose.detect._crop_kernels import sample_crop
from depth_pose.detect.candidates import CandidateFinder
from depth_pose.detect.tuning import DetectTuning

_LEAST = 0.05
"""Detections below this probability are left out: the finder rejects them by itself."""

_NARROWEST = 0.4
"""Smallest share of a scene's width and height that a look shows."""

_SMALLEST, _LARGEST = 0.6, 1.4
"""Range of scale factors of a room without people."""


@dataclass(frozen=True)
class Shot:
    """One look at a scene: a frame, its person labels, and the joints of all people, (P, 19, 3)."""

    frame: DepthFrame
    person: NDArray[np.uint8]
    joints: NDArray[np.float32]


def shoot(scenes: Scenes, k: int, rng: np.random.Generator | None) -> Shot:
    """Take a look at a scene; changed at random with ``rng``."""
    frame, joints = frame_of(scenes, k), scenes.joints[k]
    camera = frame.camera
    person = scenes.person[k, : camera.height, : camera.width]
    if rng is None:
        return Shot(frame, person, joints)
    depth = frame.depth
    if not person.any():
        depth = depth * np.float32(np.exp(rng.uniform(np.log(_SMALLEST), np.log(_LARGEST))))
    if rng.random() < 0.5:
        depth, person = depth[:, ::-1], person[:, ::-1]
        joints = joints[:, MIRROR_JOINTS] * np.array([-1, 1, 1], np.float32)
        camera = camera._replace(cx=camera.width - 1 - camera.cx)
    if rng.random() < 0.6:
        share = rng.uniform(_NARROWEST, 1.0)
        h, w = int(share * camera.height), int(share * camera.width)
        top, left = int(rng.integers(0, camera.height - h + 1)), int(rng.integers(0, camera.width - w + 1))
        part = np.s_[top : top + h, left : left + w]
        depth, person = depth[part], person[part]
        camera = camera._replace(width=w, height=h, cx=camera.cx - left, cy=camera.cy - top)
    return Shot(DepthFrame(0, "", np.ascontiguousarray(depth), camera), person, joints)


class Collector:
    """Collector of a finder's detections."""

    def __init__(self, weights: Path) -> None:
        self._candidates = CandidateFinder(SegmentConfig(), weights, DetectTuning(keep=_LEAST))
        self.rows: list[tuple[NDArray, ...]] = []

    def add(self, shot: Shot) -> None:
        """Collect the detections in one frame."""
        self._candidates.reset()
        found = self._candidates.find(shot.frame)
        labels = self._candidates.mark_hidden(found, shot.frame.filled)
        truth = truth_on_grid(shot.person, shot.frame.camera.fx / found.camera.fx, labels.shape)
        count = max((p.label for p in found.people), default=0)
        owner, is_person = whose(np.where(labels <= count, labels, 0), truth, count)
        for person in found.people:
            k = person.label - 1
            if is_person[k] < 0:
                continue
            grid, theirs = np.empty((SIDE, SIDE), np.float32), np.empty((SIDE, SIDE), np.int64)
            look = CropView(*person.torso.tolist(), CELL_M)
            sample_crop(found.depth, labels, found.camera, look, grid, theirs)
            mask = np.where(theirs < 0, OUTSIDE, theirs == person.label).astype(np.uint8)
            joints = shot.joints[owner[k]] if is_person[k] else np.full((len(JOINTS), 3), np.nan, np.float32)
            truly = np.empty((SIDE, SIDE), np.int64)
            sample_crop(found.depth, truth, found.camera, look, grid, truly)
            true_mask = (truly == owner[k] + 1).astype(np.uint8) if is_person[k] else np.zeros_like(mask)
            millimetres = np.rint(1000 * grid).astype(np.uint16)
            torso = person.torso.astype(np.float32)
            probability = np.float32(person.probability)
            self.rows.append(
                (millimetres, mask, true_mask, torso, probability, np.bool_(is_person[k]), joints)
            )


def find_in(weights: Path, shard: Path, looks: int, seed: tuple[int, int]) -> list[tuple[NDArray, ...]]:
    """Return the sightings in one shard."""
    collector, loaded, rng = Collector(weights), load_scenes([shard]), np.random.default_rng(seed)
    for k in range(len(loaded)):
        for n in range(looks):
            collector.add(shoot(loaded, k, rng if n else None))
    return collector.rows


def save(rows: list[tuple[NDArray, ...]], path: Path) -> None:
    """Write sightings."""
    names = ("depth", "whose", "mask", "torso", "probability", "is_person", "joints")
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **{n: np.array(c) for n, c in zip(names, zip(*rows, strict=True), strict=True)})


def main(
    weights: Annotated[Path, typer.Argument(help="Folder of the finder's weights")],
    out: Annotated[Path, typer.Argument(help="File to write (.npz)")],
    scenes: Annotated[list[Path], typer.Argument(help="Folders of shards from make_scenes.py")],
    looks: Annotated[int, typer.Option(help="Looks at each scene")] = 2,
    seed: Annotated[int, typer.Option(help="Start of all random numbers")] = 5,
    workers: Annotated[int, typer.Option(min=1, help="Processes")] = 1,
) -> None:
    """Run the finder over scenes and save its detections."""
    shards = [shard for folder in scenes for shard in list_shards(folder)]
    rows = []
    with pool(workers) as processes:
        jobs = [processes.submit(find_in, weights, s, looks, (seed, k)) for k, s in enumerate(shards)]
        for job in track(jobs, "sightings"):  # in the order of the shards, whichever is done first
            rows += job.result()
    save(rows, out)
    persons = sum(bool(row[5]) for row in rows)
    print(f"{len(rows)} sightings: {persons} people, {len(rows) - persons} things")


if __name__ == "__main__":
    typer.run(main)
