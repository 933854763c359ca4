"""The modified LOP against plain sums, and what it does to noisy surfaces."""

from __future__ import annotations

import numpy as np
import pytest

import synthetic as syn
from depth_pose.core.camera import Camera
from depth_pose.core.config import DenoiseConfig
from depth_pose.denoise import _denoise_kernels as kernels
from depth_pose.denoise.denoise import denoise_depth
from depth_pose.denoise.tuning import DenoiseTuning

H = 0.2
SMALL = Camera(17, 13, 60.0, 62.0, 8.3, 5.9)
MU = 0.35


def _theta(r):
    return np.exp(-16.0 * r**2 / H**2)


def _points(depth, camera):
    v, u = np.mgrid[: depth.shape[0], : depth.shape[1]]
    x, y = (u - camera.cx) / camera.fx * depth, (v - camera.cy) / camera.fy * depth
    return np.stack([x, y, depth], axis=-1)[depth > 0].astype(np.float64)


def _first(depth, camera):
    """Eq. 1 as printed, every point with every other."""
    p = _points(depth, camera)
    theta = _theta(np.linalg.norm(p[:, None] - p, axis=-1))
    out = np.zeros(depth.shape)
    out[depth > 0] = theta @ p[:, 2] / theta.sum(axis=1)
    return out


def _next(original, depth, camera, mu):
    """Eqs. 3 and 5 with the signed difference, every point with every other."""
    p0, p = _points(original, camera), _points(depth, camera)
    r = np.maximum(np.linalg.norm(p0[:, None] - p, axis=-1), 1e-3)
    alpha = _theta(r) / r
    d = np.maximum(np.linalg.norm(p[:, None] - p, axis=-1), 1e-3)
    beta = _theta(d) / d * d**2  # |d eta / d r| = r^2
    np.fill_diagonal(beta, 0.0)
    out = np.zeros(depth.shape)
    attraction = (alpha * p0[None, :, 2]).sum(axis=1) / alpha.sum(axis=1)
    repulsion = ((p[:, None, 2] - p[None, :, 2]) * beta).sum(axis=1) / np.maximum(beta.sum(axis=1), 1e-30)
    out[depth > 0] = attraction + mu * repulsion
    return out


@pytest.fixture
def rough():
    """A step between two rough surfaces, with holes; so far off that no neighbour is skipped."""
    rng = np.random.default_rng(0)
    depth = np.where(np.arange(17) < 9, 1.5, 1.9) + 0.01 * rng.standard_normal((13, 17))
    depth[rng.random(depth.shape) < 0.1] = 0.0
    return depth.astype(np.float32)


def test_first_step_twin(rough):
    """What lies beyond the kernel's support weighs at most 0.1 percent."""
    assert kernels.step_of(rough, H, SMALL.fx) == 1
    found = kernels.project_first(rough, SMALL, H, 1)
    expected = _first(rough, SMALL)
    np.testing.assert_array_equal(found > 0, rough > 0)
    np.testing.assert_allclose(found, expected, atol=2e-4)
    assert np.abs(expected - rough).max() > 5e-3, "the step must do something"


def test_next_step_twin(rough):
    once = kernels.project_first(rough, SMALL, H, 1)
    found = kernels.project_next(rough, once, SMALL, H, MU, 1)
    expected = _next(rough, once, SMALL, MU)
    np.testing.assert_allclose(found, expected, atol=4e-4)
    plain = kernels.project_next(rough, once, SMALL, H, 0.0, 1)
    assert np.abs(plain - found).max() > 1e-3, "the repulsion must do something"


def test_steps_follow_one_another(rough):
    """Three iterations are eq. 1, then eq. 3 twice, always attracted by the original points."""
    one = _first(rough, SMALL)
    three = _next(rough, _next(rough, one, SMALL, MU), SMALL, MU)
    tuning = DenoiseTuning(support_radius=H, repulsion=MU, outlier_distance=1.0)
    projected = denoise_depth(rough, SMALL, DenoiseConfig(iterations=3), tuning)
    np.testing.assert_allclose(projected, three, atol=1e-3)


def test_wide_supports_are_sampled():
    """With more pixels than needed in the support, those left out change next to nothing."""
    camera = Camera(120, 120, 600.0, 600.0, 59.5, 59.5)
    v, u = np.mgrid[:120, :120]
    depth = (1.0 + 0.05 * np.sin(u / 25.0) * np.cos(v / 30.0)).astype(np.float32)
    step = kernels.step_of(depth, H, 600.0)
    assert step > 4
    found = kernels.project_first(depth, camera, H, step)
    p = _points(depth, camera)
    for i, j in ((60, 60), (45, 80), (75, 30)):
        x = p[i * 120 + j]
        theta = _theta(np.linalg.norm(p - x, axis=1))
        assert found[i, j] == pytest.approx((theta * p[:, 2]).sum() / theta.sum(), abs=1e-3)


def test_outliers_twin():
    rng = np.random.default_rng(1)
    depth = rng.uniform(1.0, 1.6, (13, 17)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.5] = 0.0
    found = kernels.drop_outliers(depth, SMALL, 0.06)
    p = _points(depth, SMALL)
    gaps = np.linalg.norm(p[:, None] - p, axis=-1) + 10 * np.eye(len(p))
    expected = depth.copy()
    expected[depth > 0] = np.where(gaps.min(axis=1) < 0.06, depth[depth > 0], 0.0)
    np.testing.assert_array_equal(found, expected)
    assert 0 < (found > 0).sum() < (depth > 0).sum()


def test_points_stay_on_their_rays(rough):
    """Eqs. 2 and 4: the result is a depth per pixel, of the same pixels, within its surface."""
    for iterations in (1, 4):
        out = denoise_depth(
            rough, SMALL, DenoiseConfig(iterations=iterations), DenoiseTuning(outlier_distance=1.0)
        )
        assert out.dtype == np.float32
        np.testing.assert_array_equal(out > 0, rough > 0)
        assert np.abs(out - rough)[rough > 0].max() < 0.08


@pytest.mark.parametrize("iterations", [1, 5])
def test_noise_on_a_plane_goes_down_without_a_shift(iterations):
    plane = syn.draw_plane([0.3, 0.1, 1.0], 3.0)
    noisy = syn.to_frame(plane, noise=0.015).depth
    out = denoise_depth(noisy, syn.CAMERA, DenoiseConfig(iterations=iterations))
    inner = (slice(15, -15), slice(15, -15))
    off = (out - plane)[inner]
    assert off.std() < (0.35 if iterations == 1 else 0.55) * 0.015  # eq. 5 weighs a point itself most
    assert abs(off.mean()) < 0.001


def test_noise_on_a_limb_goes_down_without_shrinkage():
    """A ball of 8 cm, thinner than the support is wide."""
    c = syn.CAMERA
    v, u = np.mgrid[: c.height, : c.width]
    ray = np.stack([(u - c.cx) / c.fx, (v - c.cy) / c.fy, np.ones(u.shape)], -1)
    centre = np.array([0.1, 0.0, 2.0])
    square = (ray**2).sum(-1)
    along = ray @ centre / square
    under = along**2 - (centre @ centre - 0.08**2) / square
    ball = np.where(under > 0, along - np.sqrt(np.maximum(under, 0)), 0.0)
    assert (ball > 0).sum() > 150
    noisy = np.where(ball > 0, ball + 0.01 * np.random.default_rng(0).standard_normal(ball.shape), 0.0)
    out = denoise_depth(noisy.astype(np.float32), c, DenoiseConfig())
    front = under > np.quantile(under[under > 0], 0.5)
    assert (out - ball)[front].std() < 0.7 * 0.01
    assert abs((out - ball)[front].mean()) < 0.012
    points = _points(out, c)
    assert np.linalg.norm(points - centre, axis=1).mean() == pytest.approx(0.08, abs=0.006)


def test_lone_points_are_dropped_and_surfaces_kept():
    plane = np.where(np.abs(np.arange(176) - 88) < 30, 2.0, 0.0) * np.ones((144, 1))
    dirty = plane.copy()
    lone = [(10, 10), (70, 140), (130, 30)]
    for i, j in lone:
        dirty[i, j] = 2.0
    dirty[70, 88] = 1.0  # a flying pixel before the surface
    out = denoise_depth(dirty.astype(np.float32), syn.CAMERA, DenoiseConfig())
    assert all(out[i, j] == 0.0 for i, j in lone)
    assert out[70, 88] == 0.0
    assert (out[plane > 0] > 0).sum() == (plane > 0).sum() - 1


def test_nothing_in_nothing_out():
    out = denoise_depth(np.zeros((20, 30), np.float32), SMALL, DenoiseConfig(iterations=3))
    assert not out.any()


def test_no_iterations_only_drops_outliers(rough):
    out = denoise_depth(rough, SMALL, DenoiseConfig(iterations=0))
    kept = out > 0
    np.testing.assert_array_equal(out[kept], rough[kept])
