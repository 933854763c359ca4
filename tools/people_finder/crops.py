"""Close-ups as training samples of the joint net: randomly augmented crops."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from _crop_spoil_kernels import clear_near, grow_into, thin_edge
from close_ups import CloseUp
from joint_net import CELL_M, SIDE
from numpy.typing import NDArray
from scenes import seen_from_behind, spoil

from depth_pose.core.measurement import CropView
from depth_pose.core.skeleton import JOINT_INDEX, JOINTS, LANDMARKS, MIRROR_LANDMARKS, Landmarks
from depth_pose.detect._crop_kernels import CHANNELS, fill_features, sample_crop, to_crop
from depth_pose.detect.joint_codec import JointCodec

_TORSO = [JOINT_INDEX[f"{side}_{n}"] for side in ("left", "right") for n in ("shoulder", "hip")]
_LIMBS = [
    JOINT_INDEX[f"{s}_{n}"] for s in ("left", "right") for n in ("elbow", "wrist", "knee", "ankle", "foot")
]

_LEAST_PIXELS = 30
"""If fewer pixels of a person are left after augmentation, the crop is used as it was. Set by hand."""

_PLACE_M = 0.06
"""Standard deviation of the given torso from the truth, each axis, metres: about that of the finder."""

NO_DEPTH = 2
"""Mask value of pixels that are excluded from the loss."""


@dataclass(frozen=True)
class CropBatch:
    """The net's input and targets.

    Attributes
    ----------
    features : (B, C, H, W) float32
    landmarks : (B, L, 3) float32
        In the crop's coordinates, metres; named as if all people faced the camera.
        Not finite where unknown, as for an object.
    side : (B,) float32
        How surely the person is seen from behind: -1 (from the front) to 1.
    person : (B,) float32
        1 for a person, 0 for an object, NaN where the mask gives the answer away.
    mask : (B, H, W) uint8
        1 where a pixel truly shows the person, 0 where not, `NO_DEPTH` where it is excluded.
    """

    features: NDArray[np.float32]
    landmarks: NDArray[np.float32]
    side: NDArray[np.float32]
    person: NDArray[np.float32]
    mask: NDArray[np.uint8]

    @classmethod
    def empty(cls, n: int) -> CropBatch:
        """Allocate arrays for some samples."""
        return cls(
            np.empty((n, CHANNELS, SIDE, SIDE), np.float32),
            np.full((n, len(LANDMARKS), 3), np.nan, np.float32),
            np.zeros(n, np.float32),
            np.full(n, np.nan, np.float32),
            np.full((n, SIDE, SIDE), NO_DEPTH, np.uint8),
        )

    def place(self, k: int, landmarks: NDArray[np.float64], look: CropView) -> None:
        """Set the landmarks (L, 3) of sample ``k``, camera frame, metres; unknown ones are not finite."""
        places = JointCodec.encode(Landmarks(landmarks), look)
        shown = places[: len(JOINTS)] + np.array([0.0, 0.0, look.z])
        shown[:, :2] *= shown[:, 2:] / look.z  # as points, to tell whether the person is seen from behind
        side = float(seen_from_behind(shown[None].astype(np.float32))[0])
        self.landmarks[k] = places[MIRROR_LANDMARKS] if side > 0 else places
        self.side[k] = side


class CropSampler:
    """Crops of close-ups: augmented at random with ``rng``, unchanged without."""

    def __init__(self) -> None:
        self._grid = np.empty((SIDE, SIDE), np.float32)
        self._whose = np.empty((SIDE, SIDE), np.int64)
        self._no_background = np.zeros((SIDE, SIDE), np.float32)

    def batch(self, seen: list[CloseUp], rng: np.random.Generator | None) -> CropBatch:
        """Crop each close-up; a person hidden by the augmentation is cropped again without it."""
        out = CropBatch.empty(len(seen))
        for k, one in enumerate(seen):
            if not self._fill(one, rng, out, k):
                self._fill(one, None, out, k)
        return out

    def _fill(self, seen: CloseUp, rng: np.random.Generator | None, out: CropBatch, k: int) -> bool:
        size = 1.0 if rng is None else float(np.exp(rng.uniform(-0.1, 0.1)))  # larger or smaller people
        depth = seen.depth * np.float32(0.001 * size)
        landmarks = seen.landmarks.astype(np.float64) * size
        look = _look(landmarks[_TORSO].mean(axis=0), rng)
        grid, whose = self._grid, self._whose
        sample_crop(depth, seen.whose, seen.camera, look, grid, whose)
        outside = whose < 0
        if rng is not None:
            labels = np.maximum(whose, 0)
            spoil(grid, labels, self._no_background, SIDE, SIDE, rng)
            grid[outside] = 0.0
            whose[:] = np.where(outside, -1, labels)
        own = whose == 1
        if rng is not None:
            if int(own.sum()) < _LEAST_PIXELS:
                return False
            _spoil_mask(grid, whose, landmarks, look, rng)
            if int((whose == 1).sum()) < _LEAST_PIXELS:
                whose[own] = 1
        out.mask[k] = np.where(grid > 0, own, NO_DEPTH)
        fill_features(grid, whose, 1, look, out.features[k])
        out.place(k, landmarks, look)
        return True


def _look(torso: NDArray[np.float64], rng: np.random.Generator | None) -> CropView:
    """Build the view of a torso: exact, or displaced, rotated, mirrored and coarser at random."""
    if rng is None:
        return CropView(*torso.tolist(), CELL_M)
    spread = _PLACE_M * float(rng.choice([1.0, 2.0, 3.5], p=[0.8, 0.15, 0.05]))
    x, y, z = (torso + spread * rng.standard_normal(3)).tolist()
    z = max(z, 0.35)
    angle = np.radians(rng.normal(0.0, 12.0)) if rng.random() < 0.4 else 0.0
    coarse = int(rng.choice([1, 1, 1, 1, 2, 3]))
    return CropView(
        x, y, z, CELL_M, float(np.cos(angle)), float(np.sin(angle)), rng.choice([-1.0, 1.0]), coarse
    )


def _spoil_mask(
    grid: NDArray[np.float32],
    whose: NDArray[np.int64],
    landmarks: NDArray[np.float64],
    look: CropView,
    rng: np.random.Generator,
) -> None:
    """Remove limbs from the mask and add nearby pixels to it, each with some probability."""
    places = np.empty((len(landmarks), 3))
    to_crop(landmarks, look, places)
    pixels = places[:, :2] / CELL_M + 0.5 * (SIDE - 1)
    for joint in _LIMBS:
        if rng.random() < 0.07:
            clear_near(whose, pixels[joint, 1], pixels[joint, 0], rng.uniform(0.06, 0.25) / CELL_M)
    for _ in range(rng.integers(1, 5) if rng.random() < 0.45 else 0):
        inside = np.argwhere(whose == 1)
        if len(inside) == 0:
            return
        i, j = inside[rng.integers(len(inside))].tolist()
        largest = 0.9 if rng.random() < 0.3 else 0.35  # a sofa, a floor; or part of an object
        grow_into(grid, whose, i, j, rng.uniform(0.06, largest) / CELL_M, rng.uniform(0.05, 0.5))
    if rng.random() < 0.25:  # a ragged edge
        thin_edge(whose, rng.uniform(0.1, 0.9), rng.random(whose.shape, np.float32))
