"""Virtual cameras around a pose, and the partial clouds that they see."""

from __future__ import annotations

import numpy as np
import pytest

import synthetic as syn
from depth_pose.bank.canonical import canonical_axes, describe
from depth_pose.bank.views import (
    DISTANCE_M,
    VIEWS,
    View,
    cast_views,
    make_scene,
    render_views,
    view_directions,
    view_rotation,
)


def _cast(body, vertices, rotation, target):
    return next(cast_views(make_scene(vertices, body.faces), vertices, [View(rotation, target, True)]))


@pytest.mark.parametrize("azimuth", [0.0, 1.0, np.pi / 2, 4.0])
@pytest.mark.parametrize("elevation", [-0.3, 0.0, 0.8])
def test_view_rotation(azimuth, elevation):
    """A proper rotation whose third row looks from the camera to the body, with level image rows."""
    r = view_rotation(azimuth, elevation)
    np.testing.assert_allclose(r @ r.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(r) == pytest.approx(1.0)
    camera = -r[2]  # where the camera stands, seen from the body
    assert camera[1] == pytest.approx(np.sin(elevation))
    assert np.arctan2(camera[0], camera[2]) % (2 * np.pi) == pytest.approx(azimuth % (2 * np.pi))
    assert r[0, 1] == pytest.approx(0.0)
    assert (r @ [0, 1, 0])[1] < 0  # up in the room is up in the image


def test_view_from_the_front():
    np.testing.assert_allclose(view_rotation(0.0, 0.0), syn.FACING, atol=1e-12)


def test_directions_go_all_round_and_differ_between_poses():
    for pose in (0, 1, 17):
        directions = view_directions(pose)
        assert directions.shape == (VIEWS, 2)
        steps = np.diff(np.sort(directions[:, 0]))
        np.testing.assert_allclose(steps, 2 * np.pi / VIEWS, atol=1e-9)
        assert np.radians(-15.1) < directions[:, 1].min() < 0.0
        assert np.radians(45.0) < directions[:, 1].max() < np.radians(60.1)
        np.testing.assert_array_equal(directions, view_directions(pose))
    assert not np.allclose(view_directions(0)[:, 0], view_directions(1)[:, 0])


def test_partial_cloud_lies_on_the_side_that_the_camera_sees(body):
    vertices = body.pose(syn.arms_down(), np.zeros(3)).vertices
    rotation, target = view_rotation(0.7, 0.2), vertices.mean(axis=0)
    points = _cast(body, vertices, rotation, target)
    assert 400 < len(points) < 6000
    model = (points - [0.0, 0.0, DISTANCE_M]) @ rotation + target
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    assert (model >= low - 1e-4).all()
    assert (model <= high + 1e-4).all()
    # every point is a first hit: the z-buffer of the same mesh agrees
    from scipy.spatial import cKDTree

    gap, nearest = cKDTree(vertices).query(model)
    assert gap.max() < 0.06  # an edge's length
    corners = vertices[body.faces]
    normals = np.zeros_like(vertices)
    faces_normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    for k in range(3):
        np.add.at(normals, body.faces[:, k], faces_normals)
    camera = target - DISTANCE_M * rotation[2]
    toward = ((camera - model) * normals[nearest]).sum(axis=1)
    assert (toward > 0).mean() > 0.97
    # rays are evenly spaced in the image
    x = points[:, 0] / points[:, 2]
    spacing = np.diff(np.unique(np.round(x, 7)))
    assert np.ptp(spacing[spacing > 1e-5]) < 1e-5


def test_rendered_views_are_described_in_their_own_axes(body):
    """Recompute one view step by step; poses keep their views wherever a chunk begins."""
    rotations = np.stack([syn.arms_down(), syn.varied(1, 30.0), syn.varied(2, 30.0)])
    views = render_views(body, rotations, 4)
    assert views.descriptors.shape == (3, VIEWS, 48 * 48)
    vertices = body.pose(rotations[1], np.zeros(3)).vertices
    azimuth, elevation = view_directions(5)[3]
    rotation, target = view_rotation(azimuth, elevation), vertices.mean(axis=0)
    points = _cast(body, vertices, rotation, target)
    axes = canonical_axes(points)[0]
    np.testing.assert_array_equal(views.descriptors[1, 3], describe(points, axes).astype(np.float16))
    # x_canonical = R_canonical_model (x_model - origin)
    model = (points - [0.0, 0.0, DISTANCE_M]) @ rotation + target
    in_axes = (model - views.origins[1, 3]) @ views.rotations[1, 3].T
    np.testing.assert_allclose(in_axes, (points - axes.origin) @ axes.rotation.T, atol=1e-5)
    for r in views.rotations.reshape(-1, 3, 3).astype(np.float64):
        np.testing.assert_allclose(r @ r.T, np.eye(3), atol=1e-5)
        assert np.linalg.det(r) == pytest.approx(1.0, abs=1e-5)
    again = render_views(body, rotations[1:2], 5)
    np.testing.assert_array_equal(again.descriptors[0], views.descriptors[1])
    np.testing.assert_array_equal(again.origins[0], views.origins[1])
