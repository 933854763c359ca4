"""The z-buffer against ray casting and a plain twin; the score against plain sums."""

from __future__ import annotations

import numpy as np
import pytest

import synthetic as syn
from depth_pose.body.rendered_depth import DepthScorer, Observation
from depth_pose.core import _raster_kernels as kernels
from depth_pose.core.camera import Camera
from depth_pose.core.labels import BACKGROUND, PERSON, UNKNOWN
from depth_pose.core.open3d import load_open3d
from depth_pose.track.person_view import see_people
from depth_pose.track.tracked_person import TrackedPerson

BAND = 0.12


def _cast(vertices, faces, camera):
    """Depth by Open3D's ray casting."""
    o3d = load_open3d()
    v, u = np.mgrid[: camera.height, : camera.width].astype(np.float32)
    rays = np.zeros((*u.shape, 6), np.float32)
    rays[..., 3:] = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], -1)
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(vertices.astype(np.float32), faces.astype(np.uint32))
    return scene.cast_rays(o3d.core.Tensor(rays), nthreads=1)["t_hit"].numpy()


@pytest.mark.parametrize(("distance", "turn"), [(3.0, 0.0), (1.4, 130.0), (5.0, 250.0)])
def test_zbuffer_against_ray_casting(distance, turn):
    body = syn.posed(syn.varied(3, 40.0), distance=distance, turn=turn)
    ours = syn.draw(syn.mesh(body))
    theirs = _cast(*syn.mesh(body), syn.CAMERA)
    hit = np.isfinite(ours) & np.isfinite(theirs)
    assert hit.sum() > 500
    # rays that graze an edge may fall either way
    assert (np.isfinite(ours) != np.isfinite(theirs)).sum() < 0.005 * hit.sum()
    off = np.abs(ours[hit] - theirs[hit])
    assert np.quantile(off, 0.99) < 1e-3
    assert np.median(off) < 1e-5


def _zbuffer_twin(vertices, faces, camera):
    """Every pixel with every face: Moeller and Trumbore's intersection, front faces only."""
    v, u = np.mgrid[: camera.height, : camera.width]
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], -1)
    depth = np.full(u.shape, np.inf)
    for a, b, c in vertices[faces]:
        if (a[2] <= 0.05) | (b[2] <= 0.05) | (c[2] <= 0.05) or np.cross(b - a, c - a) @ a >= 0:
            continue
        system = np.stack([-rays, *np.broadcast_arrays(b - a, c - a, rays)[:2]], -1)
        t, s, r = np.moveaxis(
            np.linalg.solve(system, np.broadcast_to(-a, rays.shape)[..., None])[..., 0], -1, 0
        )
        inside = (s >= -1e-12) & (r >= -1e-12) & (s + r <= 1 + 1e-12) & (t > 0)
        depth = np.where(inside & (t < depth), t, depth)
    return depth


def test_zbuffer_twin():
    camera = Camera(40, 30, 41.3, 39.7, 19.7, 14.2)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        low = rng.uniform([-0.8, -0.6, 0.8], [0.2, 0.2, 2.0])
        vertices, faces = syn.box(low, low + rng.uniform(0.2, 0.9, 3))
        vertices = vertices @ syn.rotation("y", 30.0).T @ syn.rotation("x", 20.0).T + [0.1, 0.0, 0.5]
        ours, twin = syn.draw((vertices, faces), camera=camera), _zbuffer_twin(vertices, faces, camera)
        assert np.isfinite(twin).sum() > 10
        np.testing.assert_allclose(ours, twin, rtol=2e-6)


def test_back_faces_and_what_lies_behind_the_camera_are_not_drawn():
    vertices, faces = syn.box([-0.3, -0.3, 2.0], [0.3, 0.3, 2.5])
    depth = syn.draw((vertices, faces))
    np.testing.assert_allclose(depth[np.isfinite(depth)].min(), 2.0, rtol=1e-6)
    inside_out = syn.draw((vertices, faces[:, ::-1]))
    assert inside_out[72, 88] == pytest.approx(2.5)  # through the front to the back
    assert not np.isfinite(syn.draw((vertices - [0, 0, 5.0], faces))).any()


def test_drawing_twice_starts_afresh():
    zbuffer = np.empty((syn.CAMERA.height, syn.CAMERA.width), np.float32)
    near, far = syn.box([-0.2, -0.2, 1.0], [0.2, 0.2, 1.2]), syn.box([-0.2, -0.2, 3.0], [0.2, 0.2, 3.2])
    for mesh in near, far:
        kernels.rasterize(*mesh, syn.CAMERA, zbuffer)
    np.testing.assert_array_equal(zbuffer, syn.draw(far))


def _compare_twin(drawn, depth, labels, band):
    known = labels != UNKNOWN
    seen, mesh = (labels == PERSON) & known, np.isfinite(drawn) & known
    both, union = seen & mesh, seen | mesh
    dz = np.where(both, depth - np.where(mesh, drawn, 0.0), 0.0)
    off = np.minimum(np.abs(dz), band)
    score = (off[both].sum() / band + (union & ~both).sum()) / max(union.sum(), 1)
    shift = np.argwhere(seen).mean(axis=0) - np.argwhere(mesh).mean(axis=0)
    return [score, off[both].mean(), np.clip(dz[both], -3 * band, 3 * band).mean(), shift[1], shift[0]]


def test_compare_twin():
    rng = np.random.default_rng(0)
    drawn = np.where(rng.random((30, 40)) < 0.5, rng.uniform(2, 3, (30, 40)), np.inf)
    labels = rng.choice(np.array([BACKGROUND, PERSON, UNKNOWN], np.uint8), (30, 40))
    depth = np.where(labels == PERSON, rng.uniform(2, 3, (30, 40)), 0.0).astype(np.float32)
    out = np.empty(5)
    kernels.compare(drawn, depth, labels, BAND, out)
    np.testing.assert_allclose(out, _compare_twin(drawn, depth, labels, BAND), rtol=1e-6, atol=1e-9)


@pytest.fixture(scope="module")
def scene():
    body = syn.posed(syn.arms_down())
    return body, DepthScorer(syn.to_person(syn.draw(syn.mesh(body))).full)


def test_the_true_pose_scores_zero_and_others_more(scene):
    body, comparer = scene
    faces = syn.default_body().faces
    true = comparer.compare(body.vertices, faces)
    assert true.score < 1e-3
    assert true.mean_depth_error < 1e-4
    scores = [comparer.compare(body.vertices + [x, 0, 0], faces).score for x in (0.02, 0.05, 0.1, 0.3)]
    assert scores == sorted(scores)
    assert true.score < scores[0] < 0.5 < scores[-1] <= 1.0
    raised = syn.posed(syn.upright(left_shoulder=syn.rotation("z", 60.0)))
    assert comparer.compare(raised.vertices, faces).score > 0.1


def test_nothing_drawn_and_nothing_seen(scene):
    body, comparer = scene
    assert comparer.compare(body.vertices + [50.0, 0, 0], syn.default_body().faces).score == 1.0
    blank = np.zeros((20, 20), np.float32)
    empty = DepthScorer(Observation(blank, blank.astype(np.uint8), syn.CAMERA))
    assert empty.compare(body.vertices + [50.0, 0, 0], syn.default_body().faces).score == 0.0


@pytest.mark.parametrize("off", [(0.06, 0.0, 0.0), (0.0, -0.05, 0.0), (0.0, 0.0, 0.1), (-0.04, 0.03, -0.08)])
def test_the_shift_brings_the_mesh_back(scene, off):
    body, comparer = scene
    faces = syn.default_body().faces
    out = np.empty(5)
    kernels.score_mesh(body.vertices + off, faces, comparer.observation, BAND, comparer.zbuffer, out)
    moved = body.vertices + off + out[2:]
    assert comparer.compare(moved, faces).score < 0.5 * out[0]
    assert np.linalg.norm((moved - body.vertices)[0]) < 0.6 * np.linalg.norm(off)


def window_of(depth, labels, camera):
    (person,) = see_people(0, "", camera, depth, labels, [TrackedPerson(PERSON, "body_1", 1.0)]).persons
    return person.full


@pytest.mark.parametrize("stride", [1, 2, 3])
def test_a_windows_camera_sees_the_same_rays(stride):
    rng = np.random.default_rng(0)
    labels = np.zeros((60, 80), np.uint8)
    labels[20:40, 30:44] = PERSON
    depth = np.where(labels == PERSON, rng.uniform(1.9, 2.1, labels.shape), 0.0).astype(np.float32)
    camera = Camera(80, 60, 70.0, 72.0, 39.0, 30.5)
    window = window_of(depth, labels, camera).strided(stride)
    h, w = window.depth.shape
    assert (window.camera.height, window.camera.width) == (h, w)
    assert (window.labels == PERSON).sum() == pytest.approx(280 / stride**2, rel=0.25)
    for i, j in np.argwhere(window.labels == PERSON)[::7]:
        ray = (j - window.camera.cx) / window.camera.fx, (i - window.camera.cy) / window.camera.fy
        col, row = camera.fx * ray[0] + camera.cx, camera.fy * ray[1] + camera.cy
        assert abs(col - round(col)) < 1e-9
        assert window.depth[i, j] == depth[round(row), round(col)]


def test_a_window_at_the_images_corner_has_no_negative_start():
    labels = np.zeros((60, 80), np.uint8)
    labels[0:10, 0:12] = PERSON
    depth = np.where(labels == PERSON, np.float32(2.0), np.float32(0.0))
    window = window_of(depth, labels, Camera(80, 60, 70.0, 70.0, 39.5, 29.5))
    assert (window.labels == PERSON).sum() == 120
    assert (window.camera.cx, window.camera.cy) == (39.5, 29.5)
