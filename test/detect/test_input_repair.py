"""Interpolated rims and sparse grids are recognised and repaired; any other image keeps its bits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from depth_pose.core.camera import Camera
from depth_pose.core.config import PipelineConfig, SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.detect.input_repair import InputRepair
from depth_pose.detect.sample_frame import sample_frame
from depth_pose.perception import Perception
from depth_pose.pipeline import PosePipeline


@pytest.fixture(scope="module")
def scene() -> DepthFrame:
    """A person before a wall, 352 x 288, with holes of all sizes and millimetres, as sensors have them."""
    frame = scaled(sample_frame(), 2)
    rng = np.random.default_rng(3)
    depth = frame.depth + rng.normal(0.0, 0.005, frame.depth.shape).astype(np.float32)
    for _ in range(60):
        size = rng.integers(1, 9)
        v, u = rng.integers(0, depth.shape[0] - size), rng.integers(0, depth.shape[1] - size)
        depth[v : v + size, u : u + size] = 0.0
    return replace(frame, depth=rounded(depth))


def rounded(depth: np.ndarray) -> np.ndarray:
    return (np.rint(1000 * depth) / 1000).astype(np.float32)


def scaled(frame: DepthFrame, factor: float) -> DepthFrame:
    """Sample a frame to another size, by the nearest pixel."""
    c = frame.camera
    rows, cols = round(c.height * factor), round(c.width * factor)
    v = ((np.arange(rows) + 0.5) / factor).astype(int)
    u = ((np.arange(cols) + 0.5) / factor).astype(int)
    return DepthFrame(frame.stamp_ns, frame.frame_id, frame.depth[np.ix_(v, u)], camera_of(c, rows, cols))


def camera_of(c: Camera, rows: int, cols: int) -> Camera:
    x, y = cols / c.width, rows / c.height
    return Camera(cols, rows, c.fx * x, c.fy * y, (c.cx + 0.5) * x - 0.5, (c.cy + 0.5) * y - 0.5)


def area(frame: DepthFrame, block: int) -> DepthFrame:
    """Resize by the mean of blocks, holes included, as cv2.INTER_AREA does."""
    rows, cols = frame.depth.shape[0] // block, frame.depth.shape[1] // block
    means = frame.depth[: rows * block, : cols * block].reshape(rows, block, cols, block).mean(axis=(1, 3))
    return replace(frame, depth=rounded(means), camera=camera_of(frame.camera, rows, cols))


def bilinear(frame: DepthFrame, factor: float) -> DepthFrame:
    """Resize by bilinear interpolation, holes included, as cv2.INTER_LINEAR does."""
    depth = frame.depth
    for axis in (0, 1):
        length = depth.shape[axis]
        at = np.clip((np.arange(int(length * factor)) + 0.5) / factor - 0.5, 0, length - 1)
        low = np.minimum(at.astype(int), length - 2)
        share = (at - low).astype(np.float32)
        share = share[:, None] if axis == 0 else share
        depth = np.take(depth, low, axis) * (1 - share) + np.take(depth, low + 1, axis) * share
    return replace(frame, depth=rounded(depth), camera=camera_of(frame.camera, *depth.shape))


def registered(frame: DepthFrame, factor: float, baseline_m: float = 0.02) -> DepthFrame:
    """Register to a finer image from a place aside, nearest first, without filling."""
    c = frame.camera
    rows, cols = int(c.height * factor), int(c.width * factor)
    v, u = np.nonzero(frame.depth)
    z = frame.depth[v, u]
    row = np.floor((v + 0.5) * factor).astype(int)
    col = np.floor((u + 0.5 + c.fx * baseline_m / z) * factor).astype(int)
    inside = (col >= 0) & (col < cols)
    out = np.full((rows, cols), np.inf, np.float32)
    np.minimum.at(out, (row[inside], col[inside]), z[inside])
    return replace(frame, depth=np.where(np.isfinite(out), out, 0.0), camera=camera_of(c, rows, cols))


def lossy(frame: DepthFrame, kept: float) -> DepthFrame:
    """Lose pixels at random."""
    is_kept = np.random.default_rng(1).random(frame.depth.shape) < kept
    return replace(frame, depth=frame.depth * is_kept.astype(np.float32))


def flying(frame: DepthFrame) -> DepthFrame:
    """Mix half of the pixels on depth steps with the background, as time-of-flight sensors do."""
    depth = frame.depth.copy()
    left, right = depth[:, :-1], depth[:, 1:]
    is_step = (np.abs(left - right) > 0.3) & (left > 0) & (right > 0)
    is_step &= np.random.default_rng(2).random(is_step.shape) < 0.5
    depth[:, :-1][is_step] = (0.5 * (left + right))[is_step]
    return replace(frame, depth=depth)


RESIZED = {
    "area 2": lambda frame: area(frame, 2),
    "area 3": lambda frame: area(frame, 3),
    "bilinear 1/2": lambda frame: bilinear(frame, 0.5),
    "bilinear 2/3": lambda frame: bilinear(frame, 2 / 3),
    "bilinear 2": lambda frame: bilinear(frame, 2.0),
}


@pytest.mark.parametrize("how", RESIZED)
def test_interpolated_rims_are_removed_and_said(scene: DepthFrame, how: str) -> None:
    repair, shown = InputRepair(), RESIZED[how](scene)
    for _ in range(4):  # where few holes are seen, it takes some frames
        repaired = repair.apply(shown)
    assert repair.has_rims and repair.gap == 0.0
    assert "INTER_NEAREST" in repair.doubt and repair.warnings == (repair.doubt,)
    assert repaired.camera == shown.camera
    kept = repaired.depth > 0
    assert (repaired.depth[kept] == shown.depth[kept]).all(), "nothing is invented"
    before_all = scene.depth[scene.depth > 0].min() - 0.05
    false = shown.depth < before_all
    assert (false & kept).sum() < 0.1 * (false & (shown.depth > 0)).sum(), "no depth before all surfaces"
    assert kept.mean() > 0.75 * (shown.depth > 0).mean()


@pytest.mark.parametrize("change", [lambda f: f, flying, lambda f: scaled(f, 0.5), lambda f: lossy(f, 0.9)])
def test_images_without_rims_and_gaps_keep_their_bits(scene: DepthFrame, change) -> None:
    repair, shown = InputRepair(), change(scene)
    assert all(repair.apply(shown) is shown for _ in range(70))
    assert repair.warnings == () and repair.doubt == ""


@pytest.mark.parametrize("kept", [0.002, 0.05, 0.25, 0.45, 0.65, 0.8])
def test_random_loss_is_no_grid(scene: DepthFrame, kept: float) -> None:
    repair, shown = InputRepair(), lossy(scene, kept)
    assert repair.apply(shown) is shown


@pytest.mark.parametrize("nothing", [0.0, np.nan, np.inf])
def test_empty_images_are_no_evidence(scene: DepthFrame, nothing: float) -> None:
    repair = InputRepair()
    empty = replace(scene, depth=np.full_like(scene.depth, nothing))
    assert repair.apply(empty) is empty
    repair.apply(area(scene, 2))
    assert repair.has_rims


@pytest.mark.parametrize("factor", [1.3, 1.5, 1.8, 2.0, 2.4, 3.0, 4.0])
def test_sparse_grids_are_reduced_to_what_was_measured(scene: DepthFrame, factor: float) -> None:
    repair = InputRepair()
    repaired = repair.apply(registered(scene, factor))
    assert repair.gap == pytest.approx(factor, rel=0.05)
    assert "fill_upsampling_holes" in repair.doubt
    rows, cols = scene.depth.shape
    assert repaired.depth.shape == pytest.approx((rows, cols), rel=0.05)
    assert (repaired.depth > 0).mean() > 0.9 * (scene.depth > 0).mean()
    points = repaired.camera.back_project(repaired.depth)
    seen = np.isfinite(points[..., 2])
    shift = np.array([0.02, 0.0, 0.0], np.float32)
    at = scene.camera.project(points[seen] - shift)
    col, row = np.clip(np.rint(at).astype(int), 0, [cols - 1, rows - 1]).T
    measured, found = scene.depth[row, col], points[seen][:, 2]
    assert np.median(np.abs(measured - found)) < 0.01
    assert np.mean(np.abs(measured - found)[measured > 0] < 0.05) > 0.95


def test_a_lossy_grid_is_still_a_grid(scene: DepthFrame) -> None:
    repair = InputRepair()
    repair.apply(lossy(registered(scene, 2.0), 0.9))
    assert repair.gap == pytest.approx(2.0, rel=0.05)


def test_the_background_does_not_show_through_a_sparse_foreground() -> None:
    depth = np.zeros((240, 320), np.float32)
    depth[::2, ::2] = 4.0
    depth[60:180:2, 100:220:2] = 2.0
    depth[61:180:2, 101:220:2] = 4.0  # seen between the foreground's pixels
    camera = Camera(320, 240, 300.0, 300.0, 159.5, 119.5)
    repair = InputRepair()
    repaired = repair.apply(DepthFrame(0, "", depth, camera))
    assert repaired.depth.shape == (120, 160)
    assert (repaired.depth[32:88, 52:108] == 2.0).all()


def test_a_sensor_that_is_mended_is_left_alone(scene: DepthFrame) -> None:
    repair = InputRepair()
    repair.apply(area(scene, 2))
    good = scaled(scene, 0.5)
    last = [repair.apply(good) for _ in range(300)][-1]
    assert last is good and repair.doubt == ""
    assert len(repair.warnings) == 1, "the report still says what was repaired"
    repair.reset()
    assert not repair.warnings


def test_another_size_is_judged_at_once(scene: DepthFrame) -> None:
    repair = InputRepair()
    assert repair.apply(scene) is scene
    assert repair.apply(area(scene, 2)).depth.shape == (144, 176)
    assert repair.has_rims
    assert repair.apply(scene) is scene


@pytest.mark.parametrize("change", [lambda f: area(f, 2), lambda f: registered(f, 2.0)])
def test_people_are_found_as_without(scene: DepthFrame, change) -> None:
    perception, repair = Perception(SegmentConfig(), PipelineConfig().denoise), InputRepair()
    (plain,) = perception.perceive(scene).persons
    perception.reset()
    (person,) = perception.perceive(repair.apply(change(scene))).persons
    assert np.abs(np.median(plain.points, axis=0) - np.median(person.points, axis=0)).max() < 0.05


def test_the_pipeline_repairs_and_says_it_once(bank, scene: DepthFrame) -> None:
    pipeline = PosePipeline(bank)
    shown = registered(scene, 2.0)
    skeletons = [pipeline.process_frame(replace(shown, stamp_ns=n * 40_000_000)).skeletons for n in range(3)]
    assert all(len(s) == 1 for s in skeletons)
    assert len(pipeline.warnings) == 1 and "sparse" in pipeline.warnings[0]
    pipeline.reset()
    assert pipeline.warnings == ()
