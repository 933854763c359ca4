"""Coarse bodies look and move like the fine one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from depth_pose.body.body import INFLUENCES
from depth_pose.body.coarsen import coarsen
from depth_pose.body.procedural import make_body
from depth_pose.body.rendered_depth import render_depth
from depth_pose.core.camera import Camera
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL

_CAMERA = Camera(60, 80, 110.0, 110.0, 29.5, 39.5)


@pytest.fixture(scope="module")
def body():
    return make_body()


def drawn(body):
    turn = np.broadcast_to(R_CAMERA_FACING_MODEL, (len(body.nodes), 3, 3))
    posed = body.pose(turn, np.array([0.0, 0.1, 3.0]))
    return render_depth(posed.vertices, body.faces, _CAMERA)


@pytest.mark.parametrize("vertices", [300, 500])
def test_silhouette_and_depth_stay(body, vertices):
    coarse = coarsen(body, vertices)
    assert len(coarse.vertices) == vertices
    fine, rough = drawn(body), drawn(coarse)
    seen, kept = np.isfinite(fine), np.isfinite(rough)
    assert (seen & kept).sum() / (seen | kept).sum() > 0.82
    assert np.abs(np.median(rough[seen & kept] - fine[seen & kept])) < 0.006


def test_every_segment_keeps_vertices_near_the_surface(body):
    coarse = coarsen(body, 500)
    np.testing.assert_array_equal(coarse.nodes, body.nodes)
    nearest = np.linalg.norm(coarse.vertices[:, None] - body.vertices, axis=2).min(axis=1)
    assert np.median(nearest) < 0.01
    assert nearest.max() < 0.04
    assert int((coarse.weights > 0).sum(axis=1).max()) <= INFLUENCES
    strongest = np.unique(np.argmax(coarse.weights, axis=1))
    np.testing.assert_array_equal(strongest, np.unique(np.argmax(body.weights, axis=1)))
    faces = coarse.faces
    assert faces.min() >= 0 and faces.max() < 500
    assert (faces[:, 0] != faces[:, 1]).all() and (faces[:, 1] != faces[:, 2]).all()


def test_a_coarse_body_stays(body):
    assert coarsen(body, len(body.vertices)) is body


def test_doubled_vertices_are_no_matter(body):
    """As of a mesh that was split at the seams of its texture: more vertices than places."""
    few = coarsen(body, 400)
    at = np.tile(np.arange(400), 2)
    faces = np.concatenate([few.faces, few.faces + 400])
    doubled = replace(few, vertices=few.vertices[at], weights=few.weights[at], faces=faces)
    coarse = coarsen(doubled, 500)
    assert np.isfinite(coarse.vertices).all()
    assert np.isfinite(drawn(coarse)).any()
