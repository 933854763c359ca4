"""Simulated people as training samples of the second look: crops, changed so that no two are the same."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scenes import Scenes, seen_from_behind, spoil

from depth_pose.core.camera import Camera
from depth_pose.core.skeleton import JOINT_INDEX, JOINTS, MIRROR_JOINTS
from depth_pose.detect._crop_kernels import (
    CELL_M,
    CHANNELS,
    SIDE,
    Look,
    fill_features,
    sample_crop,
    to_crop,
)

_TORSO = [JOINT_INDEX[f"{side}_{n}"] for side in ("left", "right") for n in ("shoulder", "hip")]
_LIMBS = [JOINT_INDEX[f"{s}_{n}"] for s in ("left", "right") for n in ("elbow", "wrist", "knee", "ankle")]

_LEAST_SHOWN = 0.15
"""Share of a person's silhouette below which they are not asked for."""

_LEAST_PIXELS = 30
"""A person with fewer pixels left after the changes is shown without them. Set by hand."""

_PLACE_M = 0.06
"""Deviation of the torso that is given from the truth, each way, metres: about what the finder's is."""


@dataclass(frozen=True)
class CropBatch:
    """What the net sees, and should say.

    Attributes
    ----------
    features : (B, C, H, W) float32
    joints : (B, J, 3) float32
        In the crop's coordinates, metres; named as if all people faced the camera.
        Not finite where they are not known, as for a thing.
    side : (B,) float32
        How surely the person is seen from behind: -1 (from the front) to 1.
    person : (B,) float32
        1 for a person, 0 for a thing, NaN where the mask tells too easily.
    """

    features: NDArray[np.float32]
    joints: NDArray[np.float32]
    side: NDArray[np.float32]
    person: NDArray[np.float32]

    @classmethod
    def empty(cls, n: int) -> CropBatch:
        """Make room for some samples."""
        return cls(
            np.empty((n, CHANNELS, SIDE, SIDE), np.float32),
            np.full((n, len(JOINTS), 3), np.nan, np.float32),
            np.zeros(n, np.float32),
            np.full(n, np.nan, np.float32),
        )

    def place(self, k: int, joints: NDArray[np.float64], look: Look) -> None:
        """Say where the joints (J, 3) of sample ``k`` are, camera frame, metres."""
        places = np.empty((len(JOINTS), 3))
        to_crop(joints, look, places)
        if look.flip < 0:
            places = places[MIRROR_JOINTS]
        shown = places + np.array([0.0, 0.0, look.z])
        shown[:, :2] *= shown[:, 2:] / look.z  # as points, for who is seen from behind
        side = float(seen_from_behind(shown[None].astype(np.float32))[0])
        self.joints[k] = places[MIRROR_JOINTS] if side > 0 else places
        self.side[k] = side


class CropSampler:
    """Makes crops of everybody in some scenes; with ``rng`` changed at random, without as they are."""

    def __init__(self, scenes: Scenes) -> None:
        self.scenes = scenes
        shown = (scenes.visible >= _LEAST_SHOWN) & np.isfinite(scenes.joints[:, :, 0, 0])
        self.people = np.argwhere(shown)
        """Scene and number of everybody who is shown, (P, 2)."""
        self._grid = np.empty((SIDE, SIDE), np.float32)
        self._whose = np.empty((SIDE, SIDE), np.int64)

    def batch(self, which: NDArray[np.int64], rng: np.random.Generator | None) -> CropBatch:
        """Make crops of some people; who is hidden by the changes is shown without."""
        n = len(which)
        out = CropBatch.empty(n)
        for k, person in enumerate(which):
            if not self._fill(int(person), rng, out, k):
                self._fill(int(person), None, out, k)
        return out

    def _fill(self, person: int, rng: np.random.Generator | None, out: CropBatch, k: int) -> bool:
        s, (scene, number) = self.scenes, self.people[person]
        size = 1.0 if rng is None else float(np.exp(rng.uniform(-0.12, 0.12)))  # larger or smaller people
        width, height = (int(n) for n in s.size[scene])
        camera = Camera(width, height, *(float(v) for v in s.camera[scene]))
        depth = s.depth[scene, :height, :width] * np.float32(0.001 * size)
        joints = s.joints[scene, number].astype(np.float64) * size
        look = _look(joints[_TORSO].mean(axis=0), rng)
        grid, whose = self._grid, self._whose
        sample_crop(depth, s.person[scene, :height, :width], camera, look, grid, whose)
        own = number + 1
        if rng is not None:
            labels = np.maximum(whose, 0)
            spoil(grid, labels, SIDE, SIDE, rng)
            whose[(whose >= 0) & (labels != whose)] = 0
            _spoil_mask(grid, whose, own, joints, look, rng)
        if rng is not None and int((whose == own).sum()) < _LEAST_PIXELS:
            return False
        fill_features(grid, whose, own, look, out.features[k])
        out.place(k, joints, look)
        return True


def _look(torso: NDArray[np.float64], rng: np.random.Generator | None) -> Look:
    """Look at a torso: where it is, or about there, turned, mirrored, coarser."""
    if rng is None:
        return Look(*torso.tolist())
    spread = _PLACE_M * (2.5 if rng.random() < 0.15 else 1.0)
    x, y, z = (torso + spread * rng.standard_normal(3)).tolist()
    z = max(z, 0.35)
    angle = np.radians(rng.normal(0.0, 12.0)) if rng.random() < 0.7 else 0.0
    coarse = int(rng.choice([1, 1, 1, 2, 2, 3]))
    return Look(x, y, z, float(np.cos(angle)), float(np.sin(angle)), rng.choice([-1.0, 1.0]), coarse)


def _spoil_mask(
    grid: NDArray[np.float32],
    whose: NDArray[np.int64],
    own: int,
    joints: NDArray[np.float64],
    look: Look,
    rng: np.random.Generator,
) -> None:
    """Take limbs out of the mask, and put what is near into it: each now and then."""
    places = np.empty((len(joints), 3))
    to_crop(joints, look, places)
    pixels = places[:, :2] / CELL_M + 0.5 * (SIDE - 1)
    rows, cols = np.mgrid[:SIDE, :SIDE]
    for joint in _LIMBS:
        if rng.random() < 0.07:
            reach = rng.uniform(0.06, 0.22) / CELL_M
            near = (cols - pixels[joint, 0]) ** 2 + (rows - pixels[joint, 1]) ** 2 < reach**2
            whose[near & (whose == own)] = 0
    for _ in range(rng.integers(0, 4) if rng.random() < 0.4 else 0):
        inside = np.argwhere(whose == own)
        if len(inside) == 0:
            return
        i, j = inside[rng.integers(len(inside))]
        reach = rng.uniform(0.06, 0.35) / CELL_M
        near = (cols - j) ** 2 + (rows - i) ** 2 < reach**2
        close = near & (grid > 0) & (np.abs(grid - grid[i, j]) < rng.uniform(0.05, 0.5))
        whose[close & (whose >= 0)] = own
    if rng.random() < 0.25:  # a ragged edge
        edge = whose == own
        edge &= ~(np.roll(edge, 1, 0) & np.roll(edge, -1, 0) & np.roll(edge, 1, 1) & np.roll(edge, -1, 1))
        whose[edge & (rng.random(edge.shape) < rng.uniform(0.1, 0.9))] = 0
