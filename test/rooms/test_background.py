"""The empty room from images with people in it, and its points and normals, against an analytic box."""

import numpy as np
from strollers import CAMERA, ROOM, empty_box, place_camera, still_room

from depth_pose.rooms.background import empty_room, find_surface, thin_to_voxels

T_ROOM_CAMERA = place_camera(0.0, 0.0, 1.5, (3.0, 0.0, 1.0), roll_deg=5.0)


def test_people_who_pass_are_not_part_of_the_room():
    box = empty_box(T_ROOM_CAMERA)
    rng = np.random.default_rng(0)
    images = np.stack([box + rng.normal(0.0, 0.01, box.shape) for _ in range(20)]).astype(np.float32)
    for t, image in enumerate(images):
        image[40:, 8 * t : 8 * t + 30] = 2.0  # somebody who walks through
    images[:15, :10] = 0.0  # seen in a quarter of the images
    images[:18, 10:20] = 0.0  # seen too rarely
    room = empty_room(images, CAMERA).depth
    assert (room[10:20] == 0.0).all()
    off = np.abs(room - box)[np.r_[:10, 20:120]]
    assert np.median(off) < 0.005
    assert np.percentile(off, 99) < 0.03


def test_the_deviation_over_time():
    rng = np.random.default_rng(0)
    images = (3.0 + rng.normal(0.0, 1.0, (50, 8, 8)) * np.linspace(0.005, 0.04, 8)).astype(np.float32)
    images[rng.random(images.shape) < 0.3] = 0.0
    spread = empty_room(images, CAMERA).spread.mean(axis=0)
    assert np.allclose(spread, np.linspace(0.005, 0.04, 8), rtol=0.2)


def test_an_average_evens_out_a_sensors_steps():
    true = np.full((8, 8), 3.014)
    noisy = true + np.random.default_rng(1).normal(0.0, 0.015, (60, 8, 8))
    stepped = (np.round(noisy / 0.03) * 0.03).astype(np.float32)
    assert abs(empty_room(stepped, CAMERA).depth.mean() - 3.014) < 0.006


def test_points_and_normals_of_a_box():
    surface = find_surface(still_room(empty_box(T_ROOM_CAMERA)))
    points = surface.points @ T_ROOM_CAMERA[:3, :3].T + T_ROOM_CAMERA[:3, 3]
    normals = surface.normals @ T_ROOM_CAMERA[:3, :3].T
    assert len(points) > 2000
    gaps = np.concatenate([np.abs(points - ROOM[0]), np.abs(points - ROOM[1])], axis=1)
    assert gaps.min(axis=1).max() < 0.03
    inward = np.concatenate([np.eye(3), -np.eye(3)])[gaps.argmin(axis=1)]
    cosines = np.sum(normals * inward, axis=1)
    assert np.percentile(cosines, 5) > 0.95
    assert (np.sum(surface.normals * surface.points, axis=1) < 0.0).all()  # they look to the camera


def test_no_surface_without_returns():
    nothing = still_room(np.zeros((CAMERA.height, CAMERA.width), np.float32))
    assert find_surface(nothing).points.shape == (0, 3)


def test_voxels_hold_the_mean_of_their_points():
    points = np.array([[0.01, 0.0, 0.0], [0.03, 0.0, 0.0], [0.51, 0.0, 0.0]])
    assert np.allclose(thin_to_voxels(points, 0.05), [[0.02, 0.0, 0.0], [0.51, 0.0, 0.0]])
