"""The virtual sensor on scenes whose depth is known in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from depth_pose.sim.config import Placement, Room
from depth_pose.sim.noise import NO_NOISE, NoiseConfig, add_noise
from depth_pose.sim.placement import camera_pose, room_mesh
from depth_pose.sim.sensor import SENSORS, VirtualSensor
from depth_pose.sim.simulate import transform

IDEAL = replace(SENSORS["tof"], noise=NO_NOISE)


def _quad(z: float, half: float = 10.0, x: float = 0.0):
    vertices = np.array(
        [[x - half, -half, z], [x + half, -half, z], [x + half, half, z], [x - half, half, z]]
    )
    return vertices, np.array([[0, 1, 2], [0, 2, 3]])


def test_wall_has_one_depth() -> None:
    depth = VirtualSensor(IDEAL).render([_quad(2.5)])
    assert depth.shape == (144, 176)
    assert depth.dtype == np.float32
    np.testing.assert_allclose(depth, 2.5, atol=1e-5)


def test_another_width_sees_the_same() -> None:
    """A square is found at the same place, to a pixel, in images of two sizes."""
    edges = []
    for width in (640, 320):
        model = replace(SENSORS["structured"], noise=NO_NOISE).with_width(width)
        depth = VirtualSensor(model).render([_quad(2.0, half=0.5, x=0.2)])
        assert depth.shape == (width * 3 // 4, width)
        columns = np.flatnonzero((depth > 0).any(axis=0))[[0, -1]] + np.array([-0.5, 0.5])
        edges.append((columns - model.camera.cx) / model.camera.fx * 2.0)
    np.testing.assert_allclose(edges[0], edges[1], atol=2.0 / 287)
    np.testing.assert_allclose(edges[0], [-0.3, 0.7], atol=2.0 / 575)


def test_range_is_limited_and_nothing_is_zero() -> None:
    assert (VirtualSensor(IDEAL).render([_quad(9.0)]) == 0).all()
    assert (VirtualSensor(IDEAL).render([_quad(0.2)]) == 0).all()
    assert (VirtualSensor(IDEAL).render([]) == 0).all()


def test_floor_lies_where_the_camera_height_says() -> None:
    """A pixel v pixels below the principal point sees the floor at z = h f / v."""
    placement = Placement(height=1.2, distance=3.0)
    target = np.array([0.5, 0.9, -0.3])
    vertices, faces = room_mesh(Room(floor=True, wall=1.5), placement, target)
    depth = VirtualSensor(IDEAL).render([(transform(camera_pose(placement, target), vertices), faces)])
    below = np.arange(144) - 71.5
    expected = np.where(below > 0, 1.2 * 225 / np.maximum(below, 1e-9), np.inf)
    expected = np.minimum(expected, 4.5)
    np.testing.assert_allclose(depth, np.broadcast_to(expected[:, None], depth.shape), rtol=1e-4)


@pytest.mark.parametrize("pitch", [-20.0, 0.0, 35.0])
@pytest.mark.parametrize("roll", [0.0, 25.0])
def test_camera_pose(pitch: float, roll: float) -> None:
    target = np.array([1.0, 0.8, 2.0])
    T = camera_pose(Placement(distance=2.0, height=1.5, azimuth=90.0, pitch=pitch, roll=roll), target)
    R = T[:3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1)
    # the camera stands at the person's left (model +x)
    np.testing.assert_allclose(-R.T @ T[:3, 3], [3.0, 1.5, 2.0], atol=1e-12)
    gravity = R @ [0, -1.0, 0]
    assert gravity[2] == pytest.approx(np.sin(np.deg2rad(pitch)))
    assert np.rad2deg(np.arctan2(gravity[0], gravity[1])) == pytest.approx(roll, abs=1e-6)


def test_the_persons_left_is_at_the_images_right() -> None:
    T = camera_pose(Placement(), np.zeros(3))
    left, up = transform(T, np.array([[0.3, 1.0, 0.0], [0.0, 1.3, 0.0]]))
    np.testing.assert_allclose(left, [0.3, -0.1, 3.8], atol=1e-12)
    np.testing.assert_allclose(up, [0.0, -0.4, 3.8], atol=1e-12)


def test_projector_shadow_falls_on_the_right_of_a_near_thing() -> None:
    """The projector sits left of the camera, so the shadow's width is b f (1/z_near - 1/z_far)."""
    model = replace(SENSORS["structured"], noise=NO_NOISE)
    depth = VirtualSensor(model).render([_quad(1.5, 0.2), _quad(3.0)])
    row = depth[240]
    near = np.flatnonzero(np.isclose(row, 1.5, atol=1e-3))
    shadow = np.flatnonzero(row == 0)
    assert shadow.min() == near.max() + 1
    assert len(shadow) == pytest.approx(0.075 * 575 * (1 / 1.5 - 1 / 3.0), abs=1.5)


def test_noise_grows_as_configured() -> None:
    config = NoiseConfig(
        constant=0.001, quadratic=0.002, grazing_power=1.0, grazing_limit=90.0, depth_step=0.0
    )
    for z, cos in [(1.0, 1.0), (3.0, 1.0), (3.0, 0.5)]:
        depth = np.full((200, 200), z, np.float32)
        noisy = add_noise(depth, np.full_like(depth, cos), config, np.random.default_rng(0))
        assert (noisy - depth).std() == pytest.approx((0.001 + 0.002 * z**2) / cos, rel=0.02)
        assert abs((noisy - depth).mean()) < 1e-3


def test_no_noise_changes_nothing() -> None:
    depth = np.full((20, 30), 3.0, np.float32)
    depth[5:15, 8:20], depth[:2] = 1.0, 0.0
    np.testing.assert_array_equal(
        add_noise(depth, np.ones_like(depth), NO_NOISE, np.random.default_rng(0)), depth
    )


def test_flying_pixels_lie_between_the_surfaces() -> None:
    depth = np.full((50, 50), 3.0, np.float32)
    depth[:, :25] = 1.0
    config = replace(NO_NOISE, flying=1.0)
    noisy = add_noise(depth, np.ones_like(depth), config, np.random.default_rng(0))
    changed = noisy != depth
    assert set(np.flatnonzero(changed.any(axis=0))) == {24, 25}
    assert ((noisy >= 1.0) & (noisy <= 3.0)).all()
    assert changed.sum() > 90


def test_losses_and_steps() -> None:
    depth = np.full((200, 200), 2.0, np.float32)
    flat = np.ones_like(depth)
    lost = add_noise(depth, flat, replace(NO_NOISE, dropout=0.1), np.random.default_rng(0)) == 0
    assert lost.mean() == pytest.approx(0.1, abs=0.01)
    grazing = (
        add_noise(depth, flat * 0.1, replace(NO_NOISE, grazing_limit=80.0), np.random.default_rng(0)) == 0
    )
    assert grazing.mean() == pytest.approx(0.7, abs=0.02)
    stepped = add_noise(depth, flat, NoiseConfig(constant=0.01, depth_step=0.005), np.random.default_rng(0))
    np.testing.assert_allclose(stepped / 0.005, np.rint(stepped / 0.005), atol=1e-3)
    inverse = 1 / add_noise(
        depth, flat, replace(NO_NOISE, constant=0.01, disparity_step=0.003), np.random.default_rng(0)
    )
    np.testing.assert_allclose(inverse / 0.003, np.rint(inverse / 0.003), atol=1e-3)


@pytest.mark.parametrize("name", sorted(SENSORS))
def test_same_seed_same_image(name: str) -> None:
    meshes = [_quad(1.5, 0.3), _quad(3.0)]
    first, again = (VirtualSensor(SENSORS[name], seed=4).render(meshes) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    assert (VirtualSensor(SENSORS[name], seed=5).render(meshes) != first).any()
    camera = SENSORS[name].camera
    assert first.shape == (camera.height, camera.width)
    assert 0.9 < (first > 0).mean() <= 1.0


def test_which_points_are_seen() -> None:
    sensor = VirtualSensor(IDEAL)
    points = np.array([[0, 0, 2.1], [0, 0, 2.3], [0.3, 0, 2.1], [3.0, 0, 2.1], [0, 0, -1.0], [0, 0, 1.5]])
    seen = sensor.sees(points, [_quad(2.0, 0.2)], 0.15)
    assert seen.tolist() == [True, False, True, False, False, True]
