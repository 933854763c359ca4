"""Gaussian processes: gradients against differences, predictions against the textbook's formulas."""

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from depth_pose.volume.config import LearnConfig
from depth_pose.volume.gp import Kernel, Regression, evidence, learn_regression, square_distances
from depth_pose.volume.gpdm import chain_rows, learn_dynamics, principal_points
from depth_pose.volume.tuning import LearnTuning


@pytest.mark.parametrize("linear", [None, -0.7])
def test_gradients(linear):
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(11, 3)), rng.normal(size=(11, 4))
    kernel, gram = Kernel(0.2, 0.1, -1.5, linear), y @ y.T
    packed = np.concatenate([x.ravel(), kernel.as_array()])

    def value(p):
        return evidence(Kernel.from_array(p[33:]), p[:33].reshape(11, 3), gram, 4, 0.01).value

    found = evidence(kernel, x, gram, 4, 0.01)
    analytic = np.concatenate([found.inputs.ravel(), found.parameters])
    assert np.allclose(analytic, approx_fprime(packed, value, 1e-7), atol=2e-4, rtol=1e-4)


def test_the_evidence_is_the_logarithm_of_a_gaussian():
    rng = np.random.default_rng(1)
    x, y = rng.normal(size=(6, 2)), rng.normal(size=(6, 3))
    kernel = Kernel(0.3, -0.2, -1.0)
    covariance = kernel.of(x)
    plain = sum(
        0.5 * np.linalg.slogdet(covariance)[1] + 0.5 * y[:, d] @ np.linalg.solve(covariance, y[:, d])
        for d in range(3)
    )
    assert evidence(kernel, x, y @ y.T, 3).value == pytest.approx(plain)


def test_a_regression_learns_a_function_and_knows_where_it_does_not():
    rng = np.random.default_rng(2)
    x = rng.uniform(-3, 3, (120, 1))
    y = np.hstack([np.sin(x), np.cos(2 * x)]) + 0.05 * rng.normal(size=(120, 2))
    learned = learn_regression(x, y)
    grid = np.linspace(-2.8, 2.8, 50)[:, None]
    error = learned.predict(grid) - np.hstack([np.sin(grid), np.cos(2 * grid)])
    assert np.abs(error).max() < 0.12
    assert np.exp(learned.kernel.noise) == pytest.approx(0.05**2, rel=0.6)
    assert learned.variance(np.array([[12.0]]))[0] > 20 * learned.variance(grid).max()
    others = Regression(x[1:], y[1:], learned.kernel, learned.floor)
    others.__dict__["mean"] = learned.mean
    assert np.allclose(learned.left_out()[0], y[0] - others.predict(x[:1])[0], atol=1e-8)


def test_distances():
    rng = np.random.default_rng(3)
    a, b = rng.normal(size=(4, 5)), rng.normal(size=(6, 5))
    assert np.allclose(square_distances(a, b), ((a[:, None] - b) ** 2).sum(axis=-1))


def test_chains_do_not_cross_performances():
    before, after, starts = chain_rows([3, 2])
    assert before.tolist() == [0, 1, 3] and after.tolist() == [1, 2, 4] and starts.tolist() == [0, 3]


def circle(frames, dimensions, seed):
    t = np.linspace(0, 4 * np.pi, frames)
    mix = np.random.default_rng(seed).normal(size=(4, dimensions))
    v = np.stack([np.sin(t), np.cos(t), np.sin(2 * t), np.cos(2 * t)], axis=1) @ mix
    v -= v.mean(axis=0)
    return v / v.std()


def test_dynamics_of_a_cycle():
    """Twice through a cycle: the second time lies on the first, and the next point is foreseen."""
    v = circle(80, 12, 0)
    steps = []
    found = learn_dynamics([v], [80], LearnConfig(latent=3, iterations=80), steps.append)
    assert steps == list(range(1, len(steps) + 1)) and len(steps) <= 80
    x = found.latent
    apart = np.linalg.norm(x[:39] - x[40:79], axis=1).mean()
    assert apart < 0.35 * np.linalg.norm(x[:39] - x[20:59], axis=1).mean()
    motion = Regression(x[:-1], x[1:], found.motion_kernel, LearnTuning().noise_floor)
    assert np.linalg.norm(motion.left_out(), axis=1).mean() < np.linalg.norm(x[1:] - x[:-1], axis=1).mean()
    volume = Regression(x, v, found.volume_kernel)
    assert np.sqrt((volume.left_out() ** 2).mean()) < 0.3
    again = learn_dynamics([v], [80], LearnConfig(latent=3, iterations=80))
    assert np.array_equal(again.latent, x)


def test_learning_lowers_the_cost():
    v = circle(40, 8, 1) + 0.1 * np.random.default_rng(1).normal(size=(40, 8))
    short, longer = (learn_dynamics([v, v], [25, 15], LearnConfig(latent=2, iterations=n)) for n in (1, 40))
    assert longer.cost < short.cost


def test_principal_points():
    v = circle(30, 6, 2)
    x = principal_points(v, 2)
    assert x[:, 0].std() == pytest.approx(1.0) and x.shape == (30, 2)
