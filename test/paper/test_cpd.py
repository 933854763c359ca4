"""Coherent point drift: known motions, its plain twin, and what it must not depend on."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.core._fast_exp import CUT
from depth_pose.core.errors import InputError
from depth_pose.core.rotations import rotvec_to_matrix
from depth_pose.paper import _cpd_kernels as kernels
from depth_pose.paper.cpd import euclidean_basis, register
from depth_pose.paper.tuning import CpdTuning


def drift_slowly(source, target, basis, config: CpdTuning):
    """Plain-numpy twin of the kernel: dense, in double precision, without cutting Gaussians."""
    w, sigma2 = config.outlier_weight, config.sigma_start**2
    shift, iterations = np.zeros_like(source), 0
    while True:
        moved = source + shift
        squared = ((target[None] - moved[:, None]) ** 2).sum(axis=2)
        p = np.exp(-0.5 * squared / sigma2)
        c = (2 * np.pi * sigma2) ** 1.5 * w / (1 - w) * len(source) / len(target)
        p /= c + p.sum(axis=0)
        p1, px = p.sum(axis=1), p @ target
        if iterations == config.max_iterations:
            return moved, p1, px / p1[:, None], np.sqrt(sigma2)
        system = basis.T @ (p1[:, None] * basis) + config.stiffness * sigma2 * np.eye(basis.shape[1])
        new = basis @ np.linalg.solve(system, basis.T @ (px - p1[:, None] * source))
        step, shift, iterations = np.linalg.norm(new - shift, axis=1).max(), new, iterations + 1
        squared = ((target[None] - (source + shift)[:, None]) ** 2).sum(axis=2)
        last, sigma2 = sigma2, (p * squared).sum() / (3 * p1.sum())
        sigma2 = max(min(sigma2, last), config.sigma_floor**2)
        if step < config.tolerance and last - sigma2 < 1e-3 * last:
            config = CpdTuning(**{**config._asdict(), "max_iterations": iterations})


def sheet(rng: np.random.Generator, count: int) -> np.ndarray:
    """Points on a wavy sheet of one by two metres, 3 m before the camera."""
    xy = rng.uniform((-0.5, -1.0), (0.5, 1.0), (count, 2))
    return np.column_stack([xy, 3 + 0.1 * np.sin(3 * xy[:, 0]) * np.cos(2 * xy[:, 1])])


def bend(points: np.ndarray) -> np.ndarray:
    x, y, z = points.T
    return np.column_stack([x + 0.03 * np.sin(2 * y), y + 0.02 * x, z + 0.04 * x * y])


@pytest.mark.parametrize("settings", [{}, {"outlier_weight": 0.3}, {"sigma_start": 0.1}])
@pytest.mark.parametrize(("iterations", "apart"), [(1, 3e-5), (15, 6e-4)])  # single precision adds up
def test_agrees_with_its_plain_twin(settings, iterations, apart) -> None:
    rng = np.random.default_rng(1)
    source, target = sheet(rng, 150), bend(sheet(rng, 130)) + rng.normal(size=(130, 3)) * 0.004
    config = CpdTuning(max_iterations=iterations, **settings)
    basis = euclidean_basis(source, config.basis_points, config.beta)
    result = register(source, target, config, basis)
    moved, p1, mean, sigma = drift_slowly(source, target, basis, config)
    np.testing.assert_allclose(result.moved, moved, atol=apart)
    np.testing.assert_allclose(result.probability, p1, atol=30 * apart)
    seen = p1 > 0.1
    np.testing.assert_allclose(result.target_mean[seen], mean[seen], atol=3 * apart)
    assert result.sigma == pytest.approx(sigma, rel=1e-3)


def test_undoes_a_smooth_motion() -> None:
    rng = np.random.default_rng(2)
    source = sheet(rng, 600)
    truth = bend(source)
    result = register(source, truth[::-1], CpdTuning(stiffness=3.0, sigma_floor=0.004, max_iterations=100))
    assert np.linalg.norm(truth - source, axis=1).mean() > 0.02
    assert np.linalg.norm(truth - result.moved, axis=1).mean() < 0.004
    assert result.explained > 0.95


def test_moves_with_a_rigid_motion_of_both_sets() -> None:
    rng = np.random.default_rng(3)
    source, target = sheet(rng, 200), bend(sheet(rng, 220))
    rotation, shift = rotvec_to_matrix(np.array([0.3, -0.5, 0.2])), np.array([0.4, -2.0, 1.0])
    here = register(source, target)
    there = register(source @ rotation.T + shift, target @ rotation.T + shift)
    np.testing.assert_allclose(there.moved, here.moved @ rotation.T + shift, atol=2e-5)


def test_leaves_far_outliers_alone() -> None:
    rng = np.random.default_rng(4)
    source = sheet(rng, 300)
    target = bend(sheet(rng, 300))
    far = rng.uniform(-0.3, 0.3, (30, 3)) + np.array([0, 0, 4.0])
    clean, spoiled = register(source, target), register(source, np.concatenate([target, far]))
    assert np.linalg.norm(clean.moved - spoiled.moved, axis=1).max() < 0.003
    assert spoiled.explained == pytest.approx(clean.explained * 300 / 330, abs=0.01)


def test_stays_put_where_nothing_is_within_reach() -> None:
    source = sheet(np.random.default_rng(5), 50)
    result = register(source, source + np.array([0, 0, 9.0]))
    np.testing.assert_allclose(result.moved, source, atol=1e-12)
    assert result.explained == 0


def test_same_input_gives_the_same_bits() -> None:
    rng = np.random.default_rng(6)
    source, target = sheet(rng, 100), bend(sheet(rng, 100))
    assert register(source, target).moved.tobytes() == register(source, target).moved.tobytes()


def test_basis_reproduces_the_kernel() -> None:
    points = sheet(np.random.default_rng(8), 200)
    basis = euclidean_basis(points, 60, 0.7)
    distances = np.linalg.norm(points[:, None] - points, axis=2)
    np.testing.assert_allclose(basis @ basis.T, np.exp(-0.5 * (distances / 0.7) ** 2), atol=1e-3)


def test_series_follows_the_exponential() -> None:
    rng = np.random.default_rng(9)
    moved = np.zeros((1, 3))
    target = np.zeros((400, 3))
    target[:, 0] = np.sort(rng.uniform(0, 0.3, 400))
    grid = kernels.sort_into_grid(target)
    kernel, total = np.empty(400, np.float32), np.empty(400, np.float32)
    p1, residual = np.empty(1), np.empty((1, 3))
    kernels.expect(moved, 0.06**2, np.float32(1.0), grid, kernel, total, p1, residual)
    exact = np.exp(-0.5 * (target[:, 0] / 0.06) ** 2)
    seen = exact > np.exp(-CUT) * 1.001
    np.testing.assert_allclose(kernel[: seen.sum()], exact[seen], rtol=3e-5)
    np.testing.assert_allclose(kernel[seen.sum() + 1 : 390], 0.0)


@pytest.mark.parametrize("bad", [np.zeros((0, 3)), np.zeros((4, 2)), np.full((4, 3), np.nan)])
def test_refuses_bad_points(bad) -> None:
    good = np.random.default_rng(0).normal(size=(10, 3))
    with pytest.raises(InputError, match="source"):
        register(bad, good)
    with pytest.raises(InputError, match="target"):
        register(good, bad)
    with pytest.raises(InputError, match="basis"):
        register(good, good, basis=np.zeros((9, 4)))


def test_follow_twin():
    """Vertices go where the points around them went; those without any stay."""
    rng = np.random.default_rng(5)
    before = rng.uniform(0.0, 0.3, (80, 3))
    moved, probability = before + 0.05 * rng.standard_normal((80, 3)), rng.uniform(0.2, 1.3, 80)
    vertices = np.concatenate([rng.uniform(0.0, 0.3, (30, 3)), np.full((2, 3), 9.0)])
    targets, mass, reach = vertices.copy(), np.empty(32), 0.05
    kernels.follow(vertices, before, moved, probability, reach, targets, mass)
    square = np.square(vertices[:, None] - before).sum(axis=-1)
    weight = np.exp(-4.5 * square / reach**2) * np.minimum(probability, 1.0) * (square < (1.2 * reach) ** 2)
    np.testing.assert_allclose(mass, weight.sum(axis=1), rtol=1e-9)
    near = mass > 0
    assert 20 < near.sum() < 32
    np.testing.assert_allclose(targets[near], (weight @ moved)[near] / mass[near, None])
    np.testing.assert_array_equal(targets[~near], vertices[~near])
