"""What a camera may show that is no room: nobody, no crash, and the person is back afterwards."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from depth_pose.core.frame import DepthFrame
from depth_pose.detect.sample_frame import sample_frame
from depth_pose.pipeline import PosePipeline

STEP_NS = 40_000_000


@pytest.fixture(scope="module")
def pipeline(bank) -> PosePipeline:
    return PosePipeline(bank)


def at(frame: DepthFrame, number: int, depth: np.ndarray | None = None) -> DepthFrame:
    shown = frame.depth if depth is None else depth.astype(np.float32)
    return replace(frame, stamp_ns=number * STEP_NS, depth=shown)


def nothing(depth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.zeros_like(depth)


def hand_over_the_lens(depth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A palm at 10 to 30 cm, with gaps between the fingers."""
    u = np.linspace(0.0, 4.0 * np.pi, depth.shape[1])
    palm = 0.2 + 0.1 * np.sin(u) + rng.normal(0.0, 0.01, depth.shape)
    return np.where(np.sin(u) > 0.97, 0.0, palm)


def covered_lens(depth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A palm that touches the lens: all within 10 cm."""
    u = np.arange(depth.shape[1])
    return 0.06 + 0.03 * np.sin(u / 9.0) + rng.normal(0.0, 0.003, depth.shape)


def television(depth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The picture of a person on a flat screen; matched stereo shows its outline by a centimetre or two."""
    wall = depth[:, :1]
    return np.where(depth < wall - 0.05, wall - 0.02 + rng.normal(0.0, 0.008, depth.shape), wall)


def dark_screen(depth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A screen that returns next to nothing, in front of a wall."""
    wall = np.broadcast_to(depth[:, :1], depth.shape).copy()
    screen = wall[20:100, 30:146]
    screen[rng.random(screen.shape) < 0.9] = 0.0
    return wall


def sun(depth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """One pixel in fifty measures, and half of these anything."""
    noise = rng.uniform(0.3, 8.0, depth.shape)
    shown = np.where(rng.random(depth.shape) < 0.5, depth, noise)
    return np.where(rng.random(depth.shape) < 0.02, shown, 0.0)


def single_value(depth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A frozen or saturated sensor."""
    return np.full_like(depth, 65.535)


COVERED = (nothing, hand_over_the_lens, covered_lens, sun, single_value)


@pytest.mark.parametrize("image", COVERED)
def test_nobody_is_seen_meanwhile_and_the_person_is_back(
    pipeline: PosePipeline, image: Callable[[np.ndarray, np.random.Generator], np.ndarray]
) -> None:
    pipeline.restart()
    frame, rng = sample_frame(), np.random.default_rng(4)
    (before,) = pipeline.process_frame(at(frame, 0)).skeletons
    for k in range(1, 9):
        assert pipeline.process_frame(at(frame, k, image(frame.depth, rng))).skeletons == ()
    (after,) = pipeline.process_frame(at(frame, 9)).skeletons
    assert np.abs(after.positions - before.positions).max() < 0.1
    assert pipeline.warnings == ()


@pytest.mark.parametrize("image", [*COVERED, television, dark_screen])
def test_a_stream_that_begins_so_finds_nobody(
    pipeline: PosePipeline, image: Callable[[np.ndarray, np.random.Generator], np.ndarray]
) -> None:
    pipeline.restart()
    frame, rng = sample_frame(), np.random.default_rng(5)
    for k in range(5):
        assert pipeline.process_frame(at(frame, k, image(frame.depth, rng))).skeletons == ()


def test_a_mirror_shows_at_most_the_mirror_image(pipeline: PosePipeline) -> None:
    """A person's mirror image behind a wall: a person at the image's place, or nobody."""
    pipeline.restart()
    frame = sample_frame()
    v, u = np.mgrid[: frame.camera.height, : frame.camera.width]
    is_mirror = (np.abs(u - frame.camera.cx) < 45) & (np.abs(v - frame.camera.cy) < 65)
    mirrored = np.where(is_mirror, frame.depth, 2.2)
    for k in range(8):
        skeletons = pipeline.process_frame(at(frame, k, mirrored)).skeletons
        assert len(skeletons) <= 1
        for skeleton in skeletons:
            assert np.isfinite(skeleton.positions).all()
            assert 2.2 < skeleton.positions[0, 2] < 4.8, "behind the wall, as the image is"


def glass_door(depth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Half of the pixels return nothing, a tenth the glass, the others what is behind it."""
    at = rng.random(depth.shape)
    return np.where(at < 0.5, 0.0, np.where(at < 0.6, 1.5, depth))


def sunlit_half(depth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Direct sun on one half of the image, which hardly measures."""
    is_lit = np.arange(depth.shape[1]) < 0.45 * depth.shape[1]
    return np.where(is_lit & (rng.random(depth.shape) < 0.95), 0.0, depth)


def sunlit(depth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Sun on everything: three pixels in ten measure."""
    return np.where(rng.random(depth.shape) < 0.7, 0.0, depth)


@pytest.mark.parametrize("image", [glass_door, sunlit_half, sunlit])
def test_a_poorly_seen_person_is_where_they_are_or_nobody(
    pipeline: PosePipeline, image: Callable[[np.ndarray, np.random.Generator], np.ndarray]
) -> None:
    pipeline.restart()
    frame, rng = sample_frame(), np.random.default_rng(6)
    (clear,) = pipeline.process_frame(at(frame, 0)).skeletons
    pipeline.restart()
    for k in range(5):
        skeletons = pipeline.process_frame(at(frame, k, image(frame.depth, rng))).skeletons
        assert len(skeletons) <= 1
        for skeleton in skeletons:
            off = np.linalg.norm(skeleton.positions - clear.positions, axis=1)
            assert off[skeleton.joint_confidence > 0.9].max(initial=0.0) < 0.25, "no limb is surely elsewhere"
            assert skeleton.confidence <= clear.confidence + 0.02
