"""Simulated scenes as training samples: loading and random augmentation."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from _sample_kernels import (
    Cut,
    cell_labels,
    choose_cells,
    drape,
    fill_joint_offsets,
    fill_offsets,
    reduce_scene,
)
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.skeleton import JOINTS, MIRROR_JOINTS
from depth_pose.detect._finder_kernels import (
    CHANNELS,
    COLS,
    ROWS,
    NetImage,
    fill_features,
)

CELL = 4
"""Side of a cell that votes for joints, pixels of the net's image."""

_FLESH_M = 0.35
"""No part of a person or their clothes is nearer or farther than their joints by more than this, metres."""

_KNOWN, _STAYED = 0.55, 0.35
"""Share of images with a known background, and share of people there who were part of it. Set by hand."""

_NO_REACH = np.zeros((0, 2))
"""Reach of nobody, for the room without people."""

_INDEX = {name: n for n, name in enumerate(JOINTS)}
_TORSO = [_INDEX[n] for n in ("left_shoulder", "right_shoulder", "left_hip", "right_hip")]
_LEFT = [_INDEX[n] for n in ("left_shoulder", "left_hip")]
_RIGHT = [_INDEX[n] for n in ("right_shoulder", "right_hip")]
_CLEAR_M = 0.1
"""Left and right joints this far apart across the view (m) decide the facing with certainty."""


@dataclass(frozen=True)
class Scenes:
    """Simulated depth images with their people.

    Attributes
    ----------
    depth : (N, 240, 320) uint16
        Millimetres; 0 where nothing returned.
    background : (N, 240, 320) uint16
        Likewise, of the room without people.
    person : (N, 240, 320) uint8
        0 nobody, else the person's number from 1.
    camera : (N, 4) float64
        fx, fy, cx, cy, pixels.
    size : (N, 2) int64
        Columns and rows that the camera fills, from the top left.
    joints : (N, 6, 19, 3) float32
        Metres, optical frame; NaN where there is no such person.
    visible : (N, 6) float32
        Share of each person that the image shows.
    """

    depth: NDArray[np.uint16]
    background: NDArray[np.uint16]
    person: NDArray[np.uint8]
    camera: NDArray[np.float64]
    size: NDArray[np.int64]
    joints: NDArray[np.float32]
    visible: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.depth)


def list_shards(folder: Path) -> list[Path]:
    """List a folder's shards, in order."""
    return sorted(p for p in folder.glob("*.npz") if not p.name.startswith("."))


def load_scenes(shards: list[Path]) -> Scenes:
    """Read shards that ``make_scenes.py`` wrote."""
    parts = []
    for path in shards:
        with np.load(path) as z:
            parts.append(
                Scenes(
                    z["depth"],
                    z["background"],
                    z["person"],
                    z["K"].astype(float),
                    z["valid_size"][:, ::-1].astype(np.int64),
                    z["joints"].astype(np.float32),
                    z["visible"],
                )
            )
    return join(parts)


def join(parts: list[Scenes]) -> Scenes:
    """Concatenate scenes."""
    names = Scenes.__dataclass_fields__
    return Scenes(*(np.concatenate([getattr(p, n) for p in parts]) for n in names))


@dataclass(frozen=True)
class Batch:
    """The net's input and targets.

    Attributes
    ----------
    features : (B, C, H, W) float32
    grid : (B, H, W) float32
        Depth, metres.
    labels : (B, H, W) int64
        Persons by number; 0 nobody.
    torso : (B, 3, H, W) float32
        Offsets to the torso of a pixel's person, metres.
    cell_labels : (B, H/4, W/4) int64
    joints : (B, 3 J + 1, H/4, W/4) float32
        Offsets to the joints of a cell's person, metres, named as if all people faced the camera; last,
        how surely the person is seen from behind: -1 (from the front) to 1.
    """

    features: NDArray[np.float32]
    grid: NDArray[np.float32]
    labels: NDArray[np.int64]
    torso: NDArray[np.float32]
    cell_labels: NDArray[np.int64]
    joints: NDArray[np.float32]


class Sampler:
    """Batches of scenes: augmented at random with ``rng``, unchanged and with no background without."""

    def __init__(self, scenes: Scenes) -> None:
        self.scenes = scenes
        self._behind = np.zeros((ROWS, COLS), np.float32)
        self._nobody = np.zeros(scenes.person.shape[1:], np.uint8)
        self._whose = np.empty((ROWS, COLS), np.int64)
        self._sums = np.zeros((ROWS + 1, COLS + 1))
        self._counts = np.zeros((ROWS + 1, COLS + 1), np.int64)
        self._cells = np.empty((ROWS // CELL, COLS // CELL), np.int64)

    def batch(self, which: NDArray[np.int64], rng: np.random.Generator | None) -> Batch:
        """Make one batch of some scenes."""
        n, h, w = len(which), ROWS // CELL, COLS // CELL
        out = Batch(
            np.empty((n, CHANNELS, ROWS, COLS), np.float32),
            np.empty((n, ROWS, COLS), np.float32),
            np.empty((n, ROWS, COLS), np.int64),
            np.zeros((n, 3, ROWS, COLS), np.float32),
            np.empty((n, h, w), np.int64),
            np.zeros((n, 3 * len(JOINTS) + 1, h, w), np.float32),
        )
        for k, scene in enumerate(which):
            self._fill(int(scene), rng, out, k)
        return out

    def _fill(self, scene: int, rng: np.random.Generator | None, out: Batch, k: int) -> None:
        s, grid, labels = self.scenes, out.grid[k], out.labels[k]
        width, height = s.size[scene]
        left, top, view_w, view_h, mirrored = 0.0, 0.0, float(width), float(height), False
        if rng is not None:
            mirrored = bool(rng.random() < 0.5)
            if rng.random() < 0.4:  # a camera with a narrower view
                zoom = rng.uniform(0.4, 1.0)
                view_w, view_h = view_w * zoom, view_h * zoom
                left, top = rng.uniform(0, width - view_w), rng.uniform(0, height - view_h)
        stride = max(view_w / COLS, view_h / ROWS)
        if rng is not None and rng.random() < 0.15:  # a coarser sensor
            stride *= rng.uniform(1.0, 1.35)
        rows, cols = min(ROWS, int(view_h / stride + 1e-6)), min(COLS, int(view_w / stride + 1e-6))
        joints = s.joints[scene]
        reach = np.nan_to_num(
            np.stack([joints[:, :, 2].min(axis=1) - _FLESH_M, joints[:, :, 2].max(axis=1) + _FLESH_M], axis=1)
        )
        cut = Cut(left, top, stride, rows, cols, mirrored)
        reduce_scene(s.depth[scene], s.person[scene], reach, cut, grid, labels)
        self._behind[:] = 0.0
        if rng is not None and rng.random() < _KNOWN:
            reduce_scene(s.background[scene], self._nobody, _NO_REACH, cut, self._behind, self._whose)
        fx, fy, cx, cy = s.camera[scene]
        cx, cy = (cx + 0.5 - left) / stride - 0.5, (cy + 0.5 - top) / stride - 0.5
        fx, fy = fx / stride, fy / stride
        if mirrored:
            cx = cols - 1 - cx
            joints = joints[:, MIRROR_JOINTS] * np.array([-1, 1, 1], np.float32)
        if rng is not None:
            if not labels.any() and rng.random() < 0.6:  # a room of another size: clutter close by
                scale = np.float32(np.exp(rng.uniform(np.log(0.1), np.log(1.6))))
                grid *= scale
                self._behind *= scale
            spoil(grid, labels, self._behind, rows, cols, rng)
        camera = Camera(cols, rows, fx, fy, cx, cy)
        image = NetImage(grid, rows, cols, stride, camera)
        fill_features(image, self._behind, self._sums, self._counts, out.features[k])
        fill_offsets(grid, labels, joints[:, _TORSO].mean(axis=1), camera, out.torso[k])
        choose_cells(grid, rows, cols, CELL, self._cells)
        cell_labels(labels, self._cells, out.cell_labels[k])
        side = seen_from_behind(joints)
        named = np.where((side > 0)[:, None, None], joints[:, MIRROR_JOINTS], joints)
        fill_joint_offsets(grid, self._cells, out.cell_labels[k], named, camera, out.joints[k])
        out.joints[k, -1] = np.append(np.float32(0), side)[out.cell_labels[k]]


def seen_from_behind(joints: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return for each person (P, J, 3) whether their left is on the image's left: 1 surely, -1 surely not.

    Depth images show where limbs are better than which way a person faces; so joints are learned by the side
    of the image, and the facing separately.
    """
    column = joints[..., 0] / np.maximum(joints[..., 2], 0.1)
    apart = column[:, _RIGHT].mean(axis=1) - column[:, _LEFT].mean(axis=1)
    metres = np.nan_to_num(apart * joints[:, _RIGHT + _LEFT, 2].mean(axis=1))
    return np.clip(metres / _CLEAR_M, -1.0, 1.0).astype(np.float32)


def spoil(
    grid: NDArray[np.float32],
    labels: NDArray[np.int64],
    behind: NDArray[np.float32],
    rows: int,
    cols: int,
    rng: np.random.Generator,
) -> None:
    """Remove the background, add occluders, holes and noise, each with some probability.

    The still background ``behind`` follows: people may have been part of it, and things that are added may.
    """
    view = grid[:rows, :cols]
    known = behind[:rows, :cols]
    for person in np.unique(labels)[1:]:
        if rng.random() < _STAYED:
            behind[labels == person] = grid[labels == person]
    if rng.random() < 0.15:  # a blanket or cloak over somebody
        for person in np.unique(labels)[1:]:
            if rng.random() < 0.6:
                hang, smooth = int(rng.integers(1, 3)), int(rng.integers(1, 8))
                drape(grid, labels, person, rng.uniform(0.35, 1.0), hang, smooth, rows, cols)
    if rng.random() < 0.08 and labels.any():  # recordings with nothing but people
        view[labels[:rows, :cols] == 0] = 0
        known[:] = 0
    elif rng.random() < 0.06:  # a short-sighted sensor
        farthest = rng.uniform(2.5, 6.0)
        view[view > farthest] = 0
        known[known > farthest] = 0
    if rng.random() < 0.15:
        before = view.copy()
        _occlude(view, labels[:rows, :cols], rng)
        if rng.random() < 0.7:  # it has always been there
            known[view != before] = view[view != before]
    if rng.random() < 0.3:
        always = rng.random() < 0.6
        for _ in range(rng.integers(1, 8)):
            h, w = rng.integers(1, rows // 3), rng.integers(1, cols // 3)
            i, j = rng.integers(0, rows), rng.integers(0, cols)
            patch = view[i : i + h, j : j + w]
            far = np.median(patch) + rng.uniform(-0.5, 1.0)
            if always:
                known[i : i + h, j : j + w][patch > far] = 0
            patch[patch > far] = 0
    if rng.random() < 0.25:
        view[rng.random(view.shape, np.float32) < rng.uniform(0, 0.2)] = 0
    if rng.random() < 0.3:
        noise = rng.standard_normal(view.shape, np.float32) * np.float32(rng.uniform(0, 0.004))
        view += noise * view * view
    if rng.random() < 0.3:
        scale = np.float32(rng.uniform(0.96, 1.04))
        view *= scale
        known *= scale
    np.maximum(view, 0, out=view)
    view[view < 0.2] = 0
    labels[grid == 0] = 0


def _occlude(view: NDArray[np.float32], labels: NDArray[np.int64], rng: np.random.Generator) -> None:
    """Place a flat occluder in front of part of the view."""
    rows, cols = view.shape
    h, w = rng.integers(rows // 12, rows // 2), rng.integers(cols // 16, cols // 2)
    i, j = rng.integers(-h // 2, rows - h // 2), rng.integers(-w // 2, cols - w // 2)
    if rng.random() < 0.4:  # from the lower border, as a desk before the sensor
        i = rows - h
    patch = (slice(max(i, 0), i + h), slice(max(j, 0), j + w))
    seen = view[patch][view[patch] > 0]
    if seen.size == 0:
        return
    tilt = rng.uniform(-0.004, 0.004, 2)
    a, b = np.mgrid[: view[patch].shape[0], : view[patch].shape[1]]
    plane = np.percentile(seen, 5) * rng.uniform(0.5, 0.95) + tilt[0] * a + tilt[1] * b
    view[patch] = np.maximum(plane, 0.25)
    labels[patch] = 0
