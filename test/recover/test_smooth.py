"""The filter on the output: stills noise, follows motion, forgets when told."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.core.config import SmoothConfig
from depth_pose.core.skeleton import Tracking
from depth_pose.recover.smooth import low_pass, with_motion
from depth_pose.track.state import FilterState
from skeletons import make_skeleton

STEP_NS = 40_000_000


def run(frames: np.ndarray, config: SmoothConfig = SmoothConfig()) -> np.ndarray:  # noqa: B008
    state, out = FilterState(), []
    for k, positions in enumerate(frames):
        state = low_pass(state, positions, k * STEP_NS, config)
        out.append(state.positions)
    return np.array(out)


def filter_slowly(frames: np.ndarray, config: SmoothConfig, speed_cutoff_hz: float) -> np.ndarray:
    """The One-Euro filter as its paper prints it, one coordinate set at a time."""

    def alpha(cutoff, dt):
        tau = 1 / (2 * np.pi * cutoff)
        return 1 / (1 + tau / dt)

    dt, out, velocity = STEP_NS * 1e-9, [frames[0]], np.zeros_like(frames[0])
    for p in frames[1:]:
        new = np.empty_like(p)
        for j in range(len(p)):
            a = alpha(speed_cutoff_hz, dt)
            velocity[j] = a * (p[j] - out[-1][j]) / dt + (1 - a) * velocity[j]
            a = alpha(config.min_cutoff + config.beta * np.linalg.norm(velocity[j]), dt)
            new[j] = a * p[j] + (1 - a) * out[-1][j]
        out.append(new)
    return np.array(out)


def test_agrees_with_its_plain_twin() -> None:
    from depth_pose.recover import smooth

    frames = np.cumsum(np.random.default_rng(1).normal(size=(30, 19, 3)) * 0.02, axis=0)
    expected = filter_slowly(frames, SmoothConfig(), smooth.SPEED_CUTOFF_HZ)
    np.testing.assert_allclose(run(frames), expected, atol=1e-12)


def test_stills_a_trembling_joint() -> None:
    noise = np.random.default_rng(2).normal(size=(200, 19, 3)) * 0.005
    out = run(1.0 + noise)
    assert np.diff(out, axis=0).std() < 0.6 * np.diff(noise, axis=0).std()
    np.testing.assert_allclose(out[20:].mean(axis=0), 1.0, atol=0.002)


@pytest.mark.parametrize(("speed", "lag_s"), [(0.5, 0.03), (3.0, 0.012)])
def test_follows_fast_motion_the_closer(speed, lag_s) -> None:
    at = speed * np.arange(50) * STEP_NS * 1e-9
    out = run(np.broadcast_to(at[:, None, None], (50, 19, 3)))
    assert 0 <= at[-1] - out[-1].max() < lag_s * speed


@pytest.mark.parametrize("stamp_ns", [STEP_NS, 0])
def test_stamps_that_do_not_increase_begin_anew(stamp_ns) -> None:
    state = low_pass(FilterState(), np.zeros((19, 3)), STEP_NS, SmoothConfig())
    now = low_pass(state, np.ones((19, 3)), stamp_ns, SmoothConfig())
    np.testing.assert_array_equal(now.positions, np.ones((19, 3)))


def test_disabled_changes_nothing() -> None:
    frames = np.random.default_rng(3).normal(size=(5, 19, 3))
    np.testing.assert_array_equal(run(frames, SmoothConfig(enabled=False)), frames)


@pytest.mark.parametrize("enabled", [True, False])
def test_velocities_are_those_of_steady_motion(enabled: bool) -> None:
    config, velocity = SmoothConfig(enabled=enabled), np.array([1.2, -0.4, 0.3])
    before = state = FilterState()
    for k in range(30):
        positions = np.broadcast_to(k * STEP_NS * 1e-9 * velocity, (19, 3))
        before, state = state, low_pass(state, positions, k * STEP_NS, config)
    np.testing.assert_allclose(state.motion, np.broadcast_to(velocity, (19, 3)), rtol=1e-3)
    skeleton = with_motion(make_skeleton(np.zeros((19, 3))), before, state)
    np.testing.assert_array_equal(skeleton.positions, state.positions)
    np.testing.assert_allclose(skeleton.velocity, velocity, rtol=1e-3)
    assert skeleton.tracking is Tracking.TRACKED


def test_a_first_frame_has_no_velocity() -> None:
    first = low_pass(FilterState(), np.zeros((19, 3)), 0, SmoothConfig())
    skeleton = with_motion(make_skeleton(np.zeros((19, 3))), FilterState(), first)
    assert skeleton.tracking is Tracking.NEW and len(skeleton.velocities) == 0
    assert np.isnan(skeleton.velocity).all()
