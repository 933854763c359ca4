"""Canonical axes and the descriptor image drawn in them."""

from __future__ import annotations

import numpy as np
import pytest

import synthetic as syn
from depth_pose.bank import _view_kernels as kernels
from depth_pose.bank.canonical import (
    DEPTH_LIMIT_M,
    DESCRIPTOR_SIZE,
    FOREGROUND_LEVEL,
    HALF_WIDTH_M,
    CanonicalAxes,
    canonical_axes,
    describe,
)


@pytest.fixture(scope="module")
def points():
    """A standing person with one arm raised, as partial cloud."""
    raised = syn.upright(left_shoulder=syn.rotation("z", 70.0))
    return syn.to_person(syn.draw(syn.mesh(syn.posed(raised, turn=20.0)))).points


def canonical(points, axes):
    return (points - axes.origin) @ axes.rotation.T


def test_axes_are_proper_rotations(points):
    for turn in (0.0, 80.0, 180.0):
        for axes in canonical_axes(points @ syn.rotation("z", turn).T):
            np.testing.assert_allclose(axes.rotation @ axes.rotation.T, np.eye(3), atol=1e-12)
            assert np.linalg.det(axes.rotation) == pytest.approx(1.0)


def test_up_is_the_longest_axis_and_toward_faces_the_camera(points):
    (axes,) = canonical_axes(points)
    right, up, toward = axes.rotation
    assert up[1] < -0.95  # the camera's y axis points down
    assert toward @ axes.origin < 0
    np.testing.assert_allclose(np.cross(up, toward), right, atol=1e-12)
    spread = canonical(points, axes).std(axis=0)
    assert spread[1] == spread.max()


@pytest.mark.parametrize("roll", [-40.0, 15.0, 30.0])
def test_rolled_camera_gives_the_same_canonical_cloud(points, roll):
    rolled = points @ syn.rotation("z", roll).T
    before, after = canonical_axes(points)[0], canonical_axes(rolled)[0]
    np.testing.assert_allclose(canonical(rolled, after), canonical(points, before), atol=1e-9)


@pytest.mark.parametrize("roll", [70.0, 90.0, 130.0, 180.0, -100.0])
def test_any_roll_is_among_the_axes_or_upside_down(points, roll):
    """Beyond 45 degrees both signs of "up" are given; hanging upside down, the camera's up decides."""
    rolled = points @ syn.rotation("z", roll).T
    all_axes = canonical_axes(rolled)
    before = canonical(points, canonical_axes(points)[0])
    errors = [np.abs(canonical(rolled, axes) - before).max() for axes in all_axes]
    if abs(roll) < 135.0 and len(all_axes) == 2:
        assert min(errors) < 1e-9
    if abs(roll) == 180.0:
        assert len(all_axes) == 1
        np.testing.assert_allclose(canonical(rolled, all_axes[0]), before * [-1, -1, 1], atol=1e-9)


def test_moving_the_person_moves_the_axes_with_them(points):
    """Only the pixels' share of area depends on the place, so the canonical cloud hardly changes."""
    before = canonical(points, canonical_axes(points)[0])
    turn = syn.rotation("y", 12.0) @ syn.rotation("x", 6.0)  # about the camera: the view is the same
    moved = points @ turn.T
    after = canonical(moved, canonical_axes(moved)[0])
    assert np.abs(after - before).max() < 0.03
    assert np.abs(after - before).mean() < 0.01


def test_seen_along_the_longest_axis():
    """Any direction will do for "toward", but the same every time."""
    rng = np.random.default_rng(0)
    rod = rng.standard_normal((500, 3)) * [0.01, 0.01, 0.5] + [0.0, 0.0, 5.0]
    rod = np.concatenate([rod, rod * [-1, 1, 1], rod * [1, -1, 1], rod * [-1, -1, 1]])
    for axes, again in zip(canonical_axes(rod), canonical_axes(rod), strict=True):
        np.testing.assert_allclose(axes.rotation @ axes.rotation.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(axes.rotation) == pytest.approx(1.0)
        np.testing.assert_array_equal(axes.rotation, again.rotation)


def test_descriptor_of_a_scaled_person_is_the_same(points):
    axes = canonical_axes(points)[0]
    small = 0.7 * points
    np.testing.assert_allclose(
        describe(small, canonical_axes(small)[0], 0.7), describe(points, axes), atol=1e-6
    )


def test_descriptor_values(points):
    image = describe(points, canonical_axes(points)[0])
    assert image.shape == (DESCRIPTOR_SIZE**2,)
    drawn = image[image != 0]
    assert 100 < len(drawn) < 1200
    low, high = FOREGROUND_LEVEL - DEPTH_LIMIT_M, FOREGROUND_LEVEL + DEPTH_LIMIT_M
    assert drawn.min() >= low - 1e-12
    assert drawn.max() <= high + 1e-12


def test_nearer_is_brighter_and_the_image_is_upright():
    """One point up and near the camera, one down and far, one far aside beyond the image."""
    points = np.array([[0.0, -0.5, 2.8], [0.0, 0.5, 3.2], [0.0, 0.0, 3.0], [1.5, 0.0, 3.0]])
    axes = CanonicalAxes(syn.FACING, np.array([0.0, 0.0, 3.0]))
    image = describe(points, axes).reshape(DESCRIPTOR_SIZE, DESCRIPTOR_SIZE)
    rows, cols = np.nonzero(image)
    assert rows.tolist() == [14, 24, 34]
    assert cols.tolist() == [24, 24, 24]
    np.testing.assert_allclose(image[rows, cols], [1.0, 0.8, 0.6], atol=1e-12)


def test_moments_twin(points):
    mean, covariance = kernels.weighted_moments(points)
    weights = points[:, 2] ** 2
    np.testing.assert_allclose(mean, np.average(points, axis=0, weights=weights), rtol=1e-9)
    np.testing.assert_allclose(
        covariance, np.cov(points.T, aweights=weights, bias=True), rtol=1e-6, atol=1e-9
    )


def test_splat_twin(points):
    axes = canonical_axes(points)[0]
    at = canonical(points, axes) / 1.1
    size = DESCRIPTOR_SIZE
    rows = np.floor((HALF_WIDTH_M - at[:, 1]) / (2 * HALF_WIDTH_M) * size).astype(int)
    cols = np.floor((HALF_WIDTH_M + at[:, 0]) / (2 * HALF_WIDTH_M) * size).astype(int)
    inside = (rows >= 0) & (cols >= 0) & (rows < size) & (cols < size)
    level = FOREGROUND_LEVEL + np.clip(at[:, 2], -DEPTH_LIMIT_M, DEPTH_LIMIT_M)
    total, count = np.zeros((size, size)), np.zeros((size, size))
    np.add.at(total, (rows[inside], cols[inside]), level[inside])
    np.add.at(count, (rows[inside], cols[inside]), 1)
    expected = (total / np.maximum(count, 1)).ravel()
    np.testing.assert_allclose(describe(points, axes, 1.1), expected, atol=1e-9)
