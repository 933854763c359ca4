"""Simulate a stereo camera by matching images, and compare the fast model of `depth_pose.sim.stereo`.

    pip install opencv-python-headless
    python tools/people_finder/match_blocks.py stereo.png

A room is drawn from two cameras in infrared: surfaces with texture, a projected pattern of dots or none,
sensor noise. Semi-global matching (OpenCV) finds disparities, with a right-to-left check. Then come the same
driver's filters as in the fast model. Beside them are the fast model's defaults, and sensors of training
scenes, with dots (active) and without (passive). Means over rooms show how similar their errors are.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.sim.home_sensors import sample_home_sensor
from depth_pose.sim.people import sample_figure
from depth_pose.sim.placed import place
from depth_pose.sim.rooms import furnish, make_room
from depth_pose.sim.scene_noise import Shown, measure
from depth_pose.sim.scene_view import Drawn, draw, look
from depth_pose.sim.shapes import Triangles, triangulate
from depth_pose.sim.stereo import StereoConfig, _filter, measure_stereo

Array = NDArray[np.float64]
Image = NDArray[np.float32]

_CAMERA = Camera(640, 480, 385.0, 385.0, 319.5, 239.5)
_DISPARITIES = 96
_GRAIN_M = (0.004, 0.015, 0.06)
"""Sizes of a surface's texture, metres."""
_FIGURES = "holes, deviation (px), correlation after 2 4 8 16 32 px, wrong by more than 1 px, nearer of these"
_PATTERN_PX = 3.0
"""Spacing of the projector's dots, pixels."""


def infrared(
    drawn: Drawn, albedo: Image, shift: float, dots: bool, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """Render the image of an infrared camera ``shift`` metres to the right of the left one."""
    points = _CAMERA.back_project(np.nan_to_num(drawn.depth)).astype(np.float64) + np.array([shift, 0.0, 0.0])
    grain = sum(_lattice_noise(points / size, k) for k, size in enumerate(_GRAIN_M))
    light = albedo * np.maximum(drawn.cosine, 0.05) * (1.0 + 0.15 * grain)
    if dots:
        at = points[..., :2] / np.maximum(points[..., 2:], 0.1) * _CAMERA.fx / _PATTERN_PX
        light = light * (0.35 + 1.3 * (_lattice_noise(np.dstack([at, np.zeros(at.shape[:2])]), 9) > 0.45))
    light = light / np.maximum(drawn.depth, 0.5) ** 1.2
    noisy = 140 * light + rng.normal(0, 2.0, light.shape)
    return np.clip(np.where(drawn.depth > 0, noisy, 0), 0, 255).astype(np.uint8)


def _lattice_noise(points: Array, seed: int) -> Array:
    """Noise of unit cells between -1 and 1, interpolated: the same at the same point for both cameras."""
    low = np.floor(points).astype(np.int64)
    part = points - low
    part = part * part * (3 - 2 * part)
    total = np.zeros(points.shape[:-1])
    for corner in np.ndindex(2, 2, 2):
        x, y, z = (low[..., k] + corner[k] for k in range(3))
        h = (x * 374761393 + y * 668265263 + z * 2147483647 + seed * 1274126177) & 0x7FFFFFFF
        h = ((h ^ (h >> 13)) * 1274126177) & 0x7FFFFFFF
        weight = np.prod([part[..., k] if corner[k] else 1 - part[..., k] for k in range(3)], axis=0)
        total += weight * (((h ^ (h >> 16)) & 0xFFFF) / 32767.5 - 1.0)
    return total


def match(left: NDArray[np.uint8], right: NDArray[np.uint8], window: int) -> Image:
    """Semi-global matching; 0 where nothing is matched."""
    import cv2

    matcher = cv2.StereoSGBM_create(
        0,
        _DISPARITIES,
        window,
        8 * window**2,
        32 * window**2,
        1,
        31,
        10,
        100,
        2,
        cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )
    found = matcher.compute(left, right).astype(np.float32) / 16.0
    return np.where(found > 0.5, found, 0).astype(np.float32)


def _scene(rng: np.random.Generator, baseline: float) -> tuple[list[Drawn], list[Image]]:
    """Render a room with a person in it from both cameras."""
    view = look(_CAMERA, 1.2, np.radians(10.0), 0.0)
    room = make_room(rng, 1.2, False)
    person = place(sample_figure(rng), 0.2, rng.uniform(1.6, 2.8), np.pi, rng)
    furnish(room, rng, [person.vertices[::12]], view, 5.0)
    shell: Triangles = triangulate(room.shapes, rng)
    vertices = np.concatenate([view.to_optical(person.vertices), view.to_optical(shell.vertices)])
    faces = np.concatenate([person.faces, shell.faces + len(person.vertices)])
    albedo = np.append(np.concatenate([person.albedo, shell.albedo]), np.float32(0))
    drawn = [draw(vertices - [s, 0.0, 0.0], faces, _CAMERA) for s in (0.0, baseline)]
    return drawn, [albedo[d.face] for d in drawn]


def compare(depth: Image, ideal: Image, reach: float) -> Array:
    """Measure the errors of measured depth in disparity: `_FIGURES`."""
    depth, ideal = depth[:, _DISPARITIES:], ideal[:, _DISPARITIES:]  # nothing is matched left of this
    known = (depth > 0) & (ideal > 0)
    off = np.where(known, reach / np.maximum(depth, 0.1) - reach / np.maximum(ideal, 0.1), np.nan)
    flat = known & (np.abs(off) < 1.0)
    smooth = np.where(flat, off, np.nan)
    lags = [
        np.nansum(smooth[:, :-k] * smooth[:, k:]) / np.nansum(smooth[:, :-k] ** 2) for k in (2, 4, 8, 16, 32)
    ]
    wrong = known & (np.abs(off) >= 1.0)
    nearer = (wrong & (off > 0)).sum() / max(wrong.sum(), 1)
    holes = 1 - known.sum() / (ideal > 0).sum()
    return np.array([holes, np.nanstd(smooth), *lags, wrong.sum() / known.sum(), nearer])


def _at_home(drawn: Drawn, albedo: Image, family: str, baseline: float, rng: np.random.Generator) -> Image:
    """Measure with a random sensor of the fast model, without alignment to a colour camera."""
    sensor = sample_home_sensor(rng, family)
    assert sensor.stereo is not None
    stereo = replace(sensor.stereo, baseline=baseline, colour_offset=0.0, fill=0)
    sensor = replace(sensor, stereo=stereo, native_focal=_CAMERA.fx, near=0.1, far=100.0)
    return measure(Shown(drawn.depth, drawn.cosine, albedo, _CAMERA.fx), sensor, rng)


def main(
    out: Annotated[Path, typer.Argument(help="Picture to write (.png)")],
    rooms: Annotated[int, typer.Option(help="Rooms", min=1)] = 3,
    seed: Annotated[int, typer.Option(help="Of the rooms and all noise")] = 5,
    baseline: Annotated[float, typer.Option(help="Left to right camera, metres")] = 0.05,
    sensors: Annotated[int, typer.Option(help="Sensors at home a room and family", min=1)] = 5,
) -> None:
    """Draw both side by side, and print their errors."""
    import matplotlib.pyplot as plt

    config, figures = StereoConfig(window=9, baseline=baseline), defaultdict(list)
    _, axes = plt.subplots(rooms, 6, figsize=(30, 3.8 * rooms), squeeze=False)
    for number, row in enumerate(axes):
        rng = np.random.default_rng([seed, number])
        drawn, albedo = _scene(rng, baseline)
        reach, ideal = _CAMERA.fx * baseline, drawn[0].depth
        shown = {"ideal": ideal}
        for dots in (False, True):
            pair = [
                infrared(d, a, s, dots, rng) for d, a, s in zip(drawn, albedo, (0.0, baseline), strict=True)
            ]
            found = _filter(match(pair[0], pair[1], config.window), reach, config, rng)
            shown["matched, dots" if dots else "matched, no dots"] = found
        light = np.sqrt(np.maximum(drawn[0].cosine, np.float32(0.05)))
        shown["defaults"] = measure_stereo(ideal, light, _CAMERA.fx, config, rng)
        for family in ("active", "passive"):
            for _ in range(sensors):
                shown[family] = _at_home(drawn[0], albedo[0], family, baseline, rng)
                figures[family].append(compare(shown[family], ideal, reach))
        for axis, (name, depth) in zip(row, shown.items(), strict=True):
            axis.imshow(np.where(depth > 0, depth, np.nan), cmap="turbo", vmin=0.5, vmax=5.0)
            axis.set_title(name)
            axis.set_axis_off()
            if name not in ("ideal", "active", "passive"):
                figures[name].append(compare(depth, ideal, reach))
    print(_FIGURES)
    for name, values in figures.items():
        print(f"{name:17s}", " ".join(f"{v:.3f}" for v in np.nanmean(values, axis=0)))
    plt.tight_layout()
    plt.savefig(out, dpi=50)


if __name__ == "__main__":
    typer.run(main)
