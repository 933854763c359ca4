"""Carving, against a plain numpy twin and against solids of known volume."""

import numpy as np
import pytest

from depth_pose.core.camera import Camera
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.rooms.rig import RigCamera, look_at
from depth_pose.sim.roof_cameras import RigRenderer, depth_ring, front_camera, roof_rig, roughen
from depth_pose.volume.config import SpaceConfig
from depth_pose.volume.hull import LEAST_VIEWS, HullCarver, SurfaceVoxels


def sphere(centre, radius, rings=24):
    """A triangle mesh of a sphere, faces outward."""
    a = np.linspace(0, np.pi, rings + 1)
    b = np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False)
    vertices = np.array(
        [[np.sin(p) * np.sin(q), np.cos(p), np.sin(p) * np.cos(q)] for p in a for q in b]
    ) * radius + np.asarray(centre)
    faces = []
    n = len(b)
    for i in range(rings):
        for j in range(n):
            k = (j + 1) % n
            faces += [[i * n + j, (i + 1) * n + j, (i + 1) * n + k], [i * n + j, (i + 1) * n + k, i * n + k]]
    return vertices, np.array(faces, np.int32)


def plain_carve(rig, space, silhouettes):
    """Occupied voxel centres: in the image and in the silhouette of every camera that sees them."""
    side = max(2, round(0.08 / space.voxel))
    across = int(np.ceil(2 * space.half_width / (side * space.voxel) - 1e-6)) * side
    up = int(np.ceil(space.height / (side * space.voxel) - 1e-6)) * side
    grid = np.stack(np.meshgrid(np.arange(across), np.arange(up), np.arange(across), indexing="ij"), -1)
    half = across * space.voxel / 2
    points = (grid + 0.5) * space.voxel + [space.centre_x - half, 0.0, space.centre_z - half]
    keep, votes = np.ones(points.shape[:3], bool), np.zeros(points.shape[:3], int)
    for c, silhouette in zip(rig, silhouettes, strict=True):
        if silhouette is None:
            continue
        p = c.to_camera(points)
        ahead = p[..., 2] > 0.05
        z = np.where(ahead, p[..., 2], 1.0)
        u = np.rint(c.camera.fx * p[..., 0] / z + c.camera.cx).astype(int)
        v = np.rint(c.camera.fy * p[..., 1] / z + c.camera.cy).astype(int)
        seen = ahead & (u >= 0) & (v >= 0) & (u < c.camera.width) & (v < c.camera.height)
        hit = np.zeros_like(seen)
        hit[seen] = silhouette[v[seen], u[seen]] > 0
        keep &= hit | ~seen
        votes += seen
    keep &= votes >= LEAST_VIEWS
    inside = np.pad(keep, 1)
    buried = np.ones_like(keep)
    for axis in range(3):
        for shift in (-1, 1):
            buried &= np.roll(inside, shift, axis)[1:-1, 1:-1, 1:-1]
    return points[keep], points[keep & ~buried]


@pytest.fixture(scope="module")
def scene():
    rig = roof_rig(5, camera=Camera(128, 96, 90.0, 90.0, 63.5, 47.5))
    mesh = sphere([0.15, 0.9, -0.2], 0.32)
    return rig, mesh, RigRenderer(rig).silhouettes([mesh])


@pytest.mark.parametrize("voxel", [0.03, 0.05])
@pytest.mark.parametrize("lost", [(), (1,), (0, 3)])
def test_two_levels_give_what_plain_carving_gives(scene, voxel, lost):
    rig, _, silhouettes = scene
    seen = [None if i in lost else s for i, s in enumerate(silhouettes)]
    space = SpaceConfig(voxel=voxel, half_width=0.8, height=1.6)
    volume = HullCarver(rig, space).carve(seen)
    inside, surface = plain_carve(rig, space, seen)
    assert volume.voxels == len(inside) > 500
    assert volume.views == len(rig) - len(lost)
    assert np.allclose(volume.centroid, inside.mean(axis=0), atol=1e-9)
    order = lambda p: p[np.lexsort(np.round(p, 6).T)]  # noqa: E731
    assert np.allclose(order(volume.surface), order(surface), atol=1e-9)


def test_a_sphere_is_contained_and_hardly_larger(scene):
    rig, _, silhouettes = scene
    space = SpaceConfig(voxel=0.02, half_width=0.8, height=1.6)
    volume = HullCarver(rig, space).carve(silhouettes)
    litres = volume.voxels * 0.02**3 * 1e3
    true = 4 / 3 * np.pi * 0.32**3 * 1e3
    assert 0.95 * true < litres < 1.35 * true
    assert np.linalg.norm(volume.surface - [0.15, 0.9, -0.2], axis=1).min() > 0.32 - 0.06  # a pixel is 4 cm


def test_the_largest_of_two_bodies_is_kept():
    rig = roof_rig(8, camera=Camera(160, 120, 110.0, 110.0, 79.5, 59.5))
    meshes = [sphere([-0.5, 1.0, 0.0], 0.3), sphere([0.7, 0.6, 0.3], 0.12)]
    volume = HullCarver(rig).carve(RigRenderer(rig).silhouettes(meshes))
    assert np.linalg.norm(volume.centroid - [-0.5, 1.0, 0.0]) < 0.05
    assert volume.surface[:, 0].max() < 0.1


def test_nobody(scene):
    rig, _, silhouettes = scene
    carver = HullCarver(rig)
    empty = [np.zeros_like(s) for s in silhouettes]
    assert carver.carve(empty).is_empty
    assert carver.carve([silhouettes[0], *empty[1:]]).is_empty  # one camera alone sees somebody
    assert carver.carve([silhouettes[0], None, None, None, None]).is_empty
    full = carver.carve(silhouettes)
    assert not full.is_empty and carver.carve(empty).is_empty  # nothing is left over
    assert np.array_equal(carver.carve(silhouettes).surface, full.surface)


def test_rough_silhouettes_cost_little(scene):
    rig, _, silhouettes = scene
    rng = np.random.default_rng(0)
    carver = HullCarver(rig)
    clean = carver.carve(silhouettes)
    rough = carver.carve([roughen(s, rng, edge=0.2, specks=0.0005) for s in silhouettes])
    assert np.linalg.norm(rough.centroid - clean.centroid) < 0.03
    assert rough.voxels > 0.6 * clean.voxels


def test_what_cannot_be_used_is_refused(scene):
    rig, _, silhouettes = scene
    carver = HullCarver(rig)
    with pytest.raises(InputError, match="4 images for 5 cameras"):
        carver.carve(silhouettes[:4])
    with pytest.raises(InputError, match="camera2 is 10 x 10"):
        carver.carve([*silhouettes[:2], np.ones((10, 10), np.uint8), *silhouettes[3:]])
    with pytest.raises(ConfigError, match="at least 2 cameras"):
        HullCarver(rig[:1])
    with pytest.raises(ConfigError, match="make voxel larger"):
        HullCarver(rig, SpaceConfig(voxel=0.005, half_width=3.0))
    with pytest.raises(ConfigError, match="rotation"):
        RigCamera("bad", rig[0].camera, np.diag([1.0, 1.0, -1.0, 1.0]))


def test_cameras_look_where_they_are_told():
    T = look_at([2.0, 2.5, 1.0], [0.0, 1.0, 0.0])
    camera = RigCamera("c", Camera(10, 10, 5.0, 5.0, 4.5, 4.5), T)
    assert np.allclose(camera.position, [2.0, 2.5, 1.0])
    assert np.allclose(camera.to_camera(np.array([0.0, 1.0, 0.0]))[:2], 0.0, atol=1e-12)
    assert camera.to_camera(np.array([0.0, 2.0, 0.0]))[1] < 0  # up in the world is up in the image
    points = np.random.default_rng(0).normal(size=(7, 3))
    assert np.allclose(camera.to_world(camera.to_camera(points)), points)


def test_a_depth_camera_gives_the_near_side():
    camera = front_camera()
    mesh = sphere([0.1, 1.0, 0.2], 0.3)
    depth = RigRenderer([camera]).depths([mesh])[0]
    points = camera.points_world(depth)
    away = np.linalg.norm(points - [0.1, 1.0, 0.2], axis=1)
    assert np.abs(away - 0.3).max() < 0.01
    volume = SurfaceVoxels().see(points, camera.position)
    assert volume.views == 1 and np.array_equal(volume.eyes, camera.position[None])
    assert volume.sights == (volume,)
    assert volume.seen_from == pytest.approx(np.arctan2(*(camera.position - volume.centroid)[[0, 2]]))
    assert np.abs(np.linalg.norm(volume.surface - [0.1, 1.0, 0.2], axis=1) - 0.3).max() < 0.03
    assert (volume.surface[:, 2] > 0.2 - 0.05).all()
    keys = np.round(volume.surface / 0.02 - 0.5).astype(int)
    assert len(np.unique(keys, axis=0)) == len(keys)
    assert np.array_equal(np.unique(keys, axis=0), np.unique(np.floor(points / 0.02).astype(int), axis=0))


def test_depth_cameras_all_around_give_the_whole_surface():
    rig, centre = depth_ring(3), np.array([0.1, 1.0, 0.2])
    voxels = SurfaceVoxels()
    parts = [
        voxels.see(c.points_world(d), c.position)
        for c, d in zip(rig, RigRenderer(rig).depths([sphere(centre, 0.3)]), strict=True)
    ]
    whole = voxels.join(parts)
    assert whole.views == 3 and whole.sights == tuple(parts) and whole.seen_from == 0.0
    assert np.array_equal(whole.eyes, [c.position for c in rig])
    keys = {tuple(k) for k in np.round(whole.surface / 0.02 - 0.5).astype(int)}
    assert keys == {tuple(k) for p in parts for k in np.round(p.surface / 0.02 - 0.5).astype(int)}
    assert len(keys) == len(whole.surface) == whole.voxels
    # from all sides, as no single camera sees it
    outward = (whole.surface - centre) / np.linalg.norm(whole.surface - centre, axis=1, keepdims=True)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / np.sqrt(3)
    nearest = lambda v: (corners @ ((v - centre) / 0.3).T).max(axis=1)  # noqa: E731
    assert nearest(whole.surface).min() > 0.95
    assert all(nearest(p.surface).min() < 0.9 for p in parts)
    assert np.linalg.norm(outward.mean(axis=0)) < 0.15
    # a camera that brings nothing has no say
    blind = voxels.see(np.zeros((0, 3)), rig[1].position)
    assert blind.is_empty and voxels.join([blind, blind]).is_empty
    one = voxels.join([parts[0], blind])
    assert one is parts[0]
