"""Walls, floor and ceiling are found; people and furniture are not."""

from __future__ import annotations

import numpy as np
import pytest

import synthetic as syn
from depth_pose.detect import _plane_kernels as kernels
from depth_pose.detect.planes import PlaneFinder


def points_of(depth):
    c = syn.CAMERA
    finite = np.where(np.isfinite(depth), depth, 0.0).astype(np.float32)
    return c.back_project(finite)


@pytest.fixture(scope="module")
def person():
    return syn.draw(syn.mesh(syn.posed(syn.arms_down())))


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_planes_are_marked_and_people_are_not(person, noise):
    depth = np.minimum(person, syn.room()) + noise * np.random.default_rng(0).standard_normal(person.shape)
    points = points_of(depth)
    marked = PlaneFinder().mark(points, syn.CAMERA)
    background = ~np.isfinite(person)
    assert marked[background].mean() > 0.95
    assert marked[~background].mean() < 0.05
    np.testing.assert_array_equal(marked, PlaneFinder().mark(points, syn.CAMERA))


def test_known_planes_are_found_again_and_moved_ones_too(person):
    finder = PlaneFinder()
    first = finder.mark(points_of(np.minimum(person, syn.room())), syn.CAMERA)
    background = ~np.isfinite(person)
    for room in (syn.room(), syn.room(wall=4.62), syn.room(floor=0.8, wall=3.9)):
        again = finder.mark(points_of(np.minimum(person, room)), syn.CAMERA)
        assert again[background].mean() > 0.95
        assert again[~background].mean() < 0.06
    assert not finder.mark(points_of(person), syn.CAMERA).any()  # the room is gone
    finder.reset()
    again = finder.mark(points_of(np.minimum(person, syn.room())), syn.CAMERA)
    np.testing.assert_array_equal(again, first)


def test_a_persons_back_and_a_small_board_are_not_planes():
    """0.5 x 1 m across the view: flat, but too small."""
    board = syn.draw(syn.box([-0.25, -0.5, 2.5], [0.25, 0.5, 2.6]))
    assert not PlaneFinder().mark(points_of(board), syn.CAMERA).any()


@pytest.mark.parametrize("depth", [0.0, np.inf])
def test_nothing_there(depth):
    assert not PlaneFinder().mark(points_of(np.full((144, 176), depth)), syn.CAMERA).any()


def test_plane_kernels_twins():
    """A slanted plane among scattered points is found, with its inliers and its area."""
    rng = np.random.default_rng(7)
    normal = np.array([0.3, -0.8, 0.5]) / np.linalg.norm([0.3, -0.8, 0.5])
    spot = np.array([0.1, 0.4, 3.0])
    samples = rng.uniform([-1, -1, 2], [1, 1, 4], (400, 3))
    samples[:250] -= ((samples[:250] - spot) @ normal)[:, None] * normal
    normals = np.tile(normal, (400, 1))
    normals[250:] = rng.standard_normal((150, 3))
    normals[250:] /= np.linalg.norm(normals[250:], axis=1, keepdims=True)
    areas = rng.uniform(0.5, 1.5, 400)
    plane = np.append(normal, normal @ spot)
    on, area = kernels.plane_inliers(samples, normals, areas, plane, 0.012)
    expected = (np.abs(samples @ normal - plane[3]) < 0.012 * samples[:, 2]) & (
        np.abs(normals @ normal) > 0.8
    )
    np.testing.assert_array_equal(on, expected)
    slant = np.maximum(np.abs(plane[3]) / np.linalg.norm(samples, axis=1), 0.25)
    assert area == pytest.approx((areas / slant)[expected].sum())
    found = kernels.best_plane(samples, normals, areas, rng.integers(0, 400, 40), 0.012)
    np.testing.assert_allclose(found, plane, atol=1e-9)


def test_samples_lie_all_over_a_plane_and_face_its_way():
    c = syn.CAMERA
    normal = np.array([0.2, -0.3, 0.9]) / np.linalg.norm([0.2, -0.3, 0.9])
    depth = syn.draw_plane(normal, 2.0).astype(np.float32)
    depth[60:80, 60:80] = 0.0
    points = c.back_project(depth)
    reach = 4
    for most in (100_000, 2500):
        samples, normals, areas = kernels.draw_samples(points, most, reach, c.fx)
        step = max(1, int((depth > 0).sum()) // most)
        i, j = np.nonzero(depth > 0)
        i, j = i[::step], j[::step]
        h, w = depth.shape
        inner = (i >= reach) & (j >= reach) & (i < h - reach) & (j < w - reach)
        i, j = i[inner], j[inner]
        whole = depth[i, j - reach] * depth[i, j + reach] * depth[i - reach, j] * depth[i + reach, j] > 0
        np.testing.assert_allclose(samples, points[i[whole], j[whole]])
        np.testing.assert_allclose(np.abs(normals @ normal), 1.0, atol=1e-4)
        np.testing.assert_allclose(areas, step * (samples[:, 2] / c.fx) ** 2)


def test_moments_twin():
    rng = np.random.default_rng(3)
    samples, on = rng.standard_normal((60, 3)) + 5.0, rng.random(60) < 0.5
    count, mean, covariance = kernels.moments(samples, on)
    assert count == on.sum()
    np.testing.assert_allclose(mean, samples[on].mean(axis=0))
    np.testing.assert_allclose(covariance, np.cov(samples[on].T))
    assert kernels.moments(samples, np.zeros(60, bool))[0] == 0


def test_marked_plane_pixels():
    """A pixel counts with half of its window on the plane; a lone one does not."""
    points = np.full((20, 20, 3), np.nan, np.float32)
    points[..., :2] = 0.0
    points[:, :10, 2] = 2.0
    points[:, 10:, 2] = 3.0
    points[5, 15, 2] = 2.0
    marked = np.zeros((20, 20), bool)
    kernels.mark_planes(points, np.array([[0.0, 0.0, 1.0, 2.0]]), 0.01, 3, marked)
    assert marked[:, :10].all()
    assert not marked[:, 10:].any()
