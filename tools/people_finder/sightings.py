"""The finder's detections in scenes, as training samples of the joint net."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from crops import NO_DEPTH, CropBatch
from joint_net import CELL_M
from numpy.typing import NDArray
from replicas import Replica

from depth_pose.core.measurement import CropView
from depth_pose.core.skeleton import JOINTS, LANDMARKS
from depth_pose.detect._crop_kernels import fill_features

OUTSIDE = 255
"""Mask value of pixels outside the image."""

_ALONE = Replica()


@dataclass(frozen=True)
class Sightings:
    """People, and objects that the finder took for people; ``find_sightings.py`` describes the arrays."""

    depth: NDArray[np.uint16]
    whose: NDArray[np.uint8]
    mask: NDArray[np.uint8]
    torso: NDArray[np.float32]
    probability: NDArray[np.float32]
    is_person: NDArray[np.bool_]
    joints: NDArray[np.float32]

    @classmethod
    def load(cls, path: Path, replica: Replica = _ALONE) -> Sightings:
        """Read a replica's share of a file."""
        with np.load(path) as z:
            return cls(*(np.array(replica.share(z[n])) for n in cls.__dataclass_fields__))

    def __len__(self) -> int:
        return len(self.depth)

    def draw(self, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
        """Draw some at random, half of them people."""
        kinds = np.flatnonzero(self.is_person), np.flatnonzero(~self.is_person)
        return np.concatenate([rng.choice(kind, count // 2) for kind in kinds])

    def batch(self, which: NDArray[np.int64], rng: np.random.Generator | None) -> CropBatch:
        """Make crops: mirrored and corrupted at random with ``rng``, unchanged without."""
        out = CropBatch.empty(len(which))
        for k, n in enumerate(which):
            grid = self.depth[n] * np.float32(0.001)
            whose = np.where(self.whose[n] == OUTSIDE, -1, self.whose[n].astype(np.int64))
            x, y, z = self.torso[n].tolist()
            mask, flip = self.mask[n], 1.0
            if rng is not None:
                spoil_crop(grid, whose, rng)
                if rng.random() < 0.5:
                    flip, grid, whose, mask = -1.0, grid[:, ::-1], whose[:, ::-1], mask[:, ::-1]
            look = CropView(x, y, z, CELL_M, flip=flip)
            fill_features(grid, whose, 1, look, out.features[k])
            out.person[k] = float(self.is_person[n])
            out.mask[k] = np.where(grid > 0, mask, NO_DEPTH)
            if self.is_person[n]:
                landmarks = np.full((len(LANDMARKS), 3), np.nan)  # rooms do not know the heels
                landmarks[: len(JOINTS)] = self.joints[n]
                out.place(k, landmarks, look)
        return out


def spoil_crop(grid: NDArray[np.float32], whose: NDArray[np.int64], rng: np.random.Generator) -> None:
    """Remove the background, add holes and noise, each with some probability."""
    if rng.random() < 0.08:
        grid[whose == 0] = 0
    if rng.random() < 0.25:
        grid[rng.random(grid.shape, np.float32) < rng.uniform(0, 0.2)] = 0
    if rng.random() < 0.3:
        noise = rng.standard_normal(grid.shape, np.float32) * np.float32(rng.uniform(0, 0.004))
        grid += noise * grid * grid
    np.maximum(grid, 0, out=grid)
    whose[(whose > 0) & (grid == 0)] = 0
