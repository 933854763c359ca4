"""Exemplars placed at the input, rendered and scored: the compiled loops against the public functions."""

from __future__ import annotations

import numpy as np
import pytest

import synthetic as syn
from depth_pose.bank.canonical import canonical_axes
from depth_pose.body.coarsen import coarsen
from depth_pose.body.rendered_depth import DepthScorer
from depth_pose.core._raster_kernels import score_mesh
from depth_pose.core.rotations import quat_to_matrix
from depth_pose.match.placing import (
    COARSE_VERTICES,
    ExemplarRenderer,
    ExemplarViews,
    better,
    join,
    place_exemplars,
)
from depth_pose.match.search import Nearest

SCALE, BAND = 1.05, 0.12


@pytest.fixture(scope="module")
def person():
    posed = syn.posed(syn.arms_down(), distance=3.0)
    return syn.to_person(syn.draw(syn.mesh(posed)))


@pytest.fixture(scope="module")
def placed(bank, person):
    nearest = Nearest(np.array([120 * bank.views + 3, 40, 777]), np.array([1.0, 2.0, 3.0], np.float32))
    views = ExemplarViews(np.arange(bank.poses), bank.view_quats, bank.view_origins)
    return place_exemplars(views, nearest, canonical_axes(person.points)[0], SCALE)


def test_views_lie_over_the_inputs_axes(bank, person, placed):
    axes = canonical_axes(person.points)[0]
    for k, (exemplar, number) in enumerate(zip(placed.exemplars, placed.views, strict=True)):
        rotation = axes.rotation.T @ quat_to_matrix(bank.view_quats[exemplar, number].astype(np.float64))
        np.testing.assert_allclose(placed.rotations[k], rotation, atol=1e-6)
        start = axes.origin - SCALE * rotation @ bank.view_origins[exemplar, number]
        np.testing.assert_allclose(placed.translations[k], start, atol=1e-6)
    assert placed.exemplars.tolist() == [120, *(n // bank.views for n in (40, 777))]


def test_comparing_twin(bank, person, placed):
    found = ExemplarRenderer(bank).compare(placed, SCALE, person.coarse)
    body, comparer = coarsen(bank.body, COARSE_VERTICES), DepthScorer(person.coarse)
    for k, exemplar in enumerate(placed.exemplars):
        turned = placed.rotations[k] @ bank.rotations(exemplar)
        posed = body.pose(turned, placed.translations[k], SCALE)
        expected = np.empty(5)
        score_mesh(posed.vertices, body.faces, person.coarse, BAND, comparer.zbuffer, expected)
        assert found.scores[k] == pytest.approx(expected[0], abs=2e-3)
        np.testing.assert_allclose(found.shifts[k], expected[2:], atol=1e-4)
        np.testing.assert_allclose(found.nodes[k], posed.nodes, atol=1e-4)


def test_moved_ones_are_nearer_and_the_better_ones_are_kept(bank, person, placed):
    renderer = ExemplarRenderer(bank)
    off = np.array([0.1, -0.08, 0.06])
    there = renderer.compare(placed, SCALE, person.coarse)
    away = renderer.compare(placed._replace(translations=placed.translations + off), SCALE, person.coarse)
    back = renderer.compare(away.moved(), SCALE, person.coarse)
    np.testing.assert_allclose(back.translations - away.translations, away.shifts, atol=1e-12)
    gaps = [np.linalg.norm(p.translations - there.translations - there.shifts, axis=1) for p in (away, back)]
    assert (gaps[1] < gaps[0]).all()
    best = better(away, there)
    np.testing.assert_array_equal(best.scores, np.minimum(away.scores, there.scores))
    for k, score in enumerate(best.scores):
        source = there if score < away.scores[k] else away
        np.testing.assert_array_equal(best.nodes[k], source.nodes[k])


def test_ranked_and_joined_in_order(bank, person, placed):
    found = ExemplarRenderer(bank).compare(placed, SCALE, person.coarse)
    both = join([found, found])
    best = both.take(both.ranking()[:4])
    order = np.argsort(found.scores)
    assert best.exemplars.tolist() == np.repeat(found.exemplars[order], 2)[:4].tolist()
    assert (np.diff(best.scores) >= 0).all()
    np.testing.assert_array_equal(best.nodes[0], found.nodes[order[0]])
