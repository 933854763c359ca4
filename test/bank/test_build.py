"""Building banks: the same from any number of processes; the subspace against a plain one."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.bank import build as building
from depth_pose.bank.build import BuildConfig, Subspace, build_bank, learn_subspace, project


@pytest.fixture(scope="module")
def few(bank):
    return np.stack([bank.rotations(i) for i in range(0, bank.poses, bank.poses // 10)])


@pytest.mark.slow
def test_same_bank_from_any_number_of_workers(body, few, monkeypatch, tmp_path):
    monkeypatch.setattr(building, "POSES_PER_PART", 4)
    told = []
    config = BuildConfig(dimensions=12)
    banks = [
        build_bank(body, few, config, {"a": 1}, lambda done, total: told.append((done, total)), workers)
        for workers in (0, 1, 2)
    ]
    assert len({b.bank_id for b in banks}) == 1
    for number, made in enumerate(banks):
        made.save(tmp_path / f"{number}.npz")
    assert len({(tmp_path / f"{number}.npz").read_bytes() for number in range(3)}) == 1
    count = len(few)
    once = [(min(n, count), count) for n in range(4, count + 4, 4)]
    assert told == 3 * once
    b = banks[0]
    assert b.coefficients.shape == (count, 16, 12)
    assert b.source["a"] == 1
    assert b.source["views"] == b.view_scheme == "partial"
    assert 0.4 < b.source["explained_variance"] < 1.0
    np.testing.assert_allclose(
        np.stack([b.rotations(i) for i in range(count)]), few, atol=1e-4
    )  # as they were given, but for the rounding


def test_coefficients_come_from_the_poses_as_stored(bank):
    """Rendering a stored pose again gives its stored coefficients."""
    from depth_pose.bank.views import render_views

    views = render_views(bank.body, bank.rotations(7)[None], 7)
    again = project(views.descriptors, Subspace(bank.mean, bank.components))
    half_a_step = np.abs(bank.coefficients).max(axis=(0, 1)) / 254
    assert (np.abs(again[0] - bank.coefficients[7]) < half_a_step + 2e-3).all()
    np.testing.assert_allclose(views.origins[0], bank.view_origins[7], atol=5.1e-5)


@pytest.mark.parametrize("rows", [200, 25])
def test_subspace_against_svd(rows):
    rng = np.random.default_rng(0)
    mixing = rng.standard_normal((40, 40)) * 0.8 ** np.arange(40)
    descriptors = (rng.standard_normal((rows, 40)) @ mixing.T + rng.standard_normal(40)).astype(np.float16)
    found = learn_subspace(descriptors, 6)
    data = descriptors.astype(np.float64)
    mean = data.mean(axis=0)
    expected = np.linalg.svd(data - mean, full_matrices=False)[2][:6]
    np.testing.assert_allclose(found.mean, mean, atol=1e-4)
    np.testing.assert_allclose(np.abs(np.sum(found.components * expected, axis=1)), 1.0, atol=1e-4)
    assert found.components.dtype == found.mean.dtype == np.float32


def test_no_more_dimensions_than_descriptors():
    descriptors = np.random.default_rng(0).standard_normal((5, 30)).astype(np.float16)
    assert learn_subspace(descriptors, 48).components.shape == (5, 30)


def test_projection_twin():
    rng = np.random.default_rng(1)
    descriptors = rng.standard_normal((7, 3, 20)).astype(np.float16)
    subspace = learn_subspace(descriptors.reshape(-1, 20), 5)
    found = project(descriptors, subspace)
    for i in range(7):
        for w in range(3):
            expected = subspace.components @ (descriptors[i, w].astype(np.float32) - subspace.mean)
            np.testing.assert_allclose(found[i, w], expected, atol=1e-5)


def test_subspace_explains_most_of_the_views(bank):
    """What 32 dimensions keep of unseen descriptors' variance."""
    from depth_pose.bank.views import render_views
    from depth_pose.motion.procedural.generator import make_clip

    rotations = make_clip("stand_casual", fps=2.0, seconds=2.0, seed=9).rotations
    views = render_views(bank.body, rotations, 0).descriptors.astype(np.float32)
    off = views.reshape(-1, views.shape[-1]) - bank.mean
    kept = np.square(off @ bank.components.T).sum() / np.square(off).sum()
    assert kept > 0.5
    assert bank.mean.max() < 1.4
