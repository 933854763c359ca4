"""People carried from the net's image to the working grid."""

from __future__ import annotations

import numpy as np

from depth_pose.core.camera import Camera
from depth_pose.core.frame import DepthFrame
from depth_pose.detect import _outline_kernels as kernels
from depth_pose.detect.outline import carry_people, spread
from depth_pose.detect.turned import reduce_frame

CAMERA = Camera(176, 144, 160.0, 160.0, 87.5, 71.5)


def two_discs():
    """Two people of 2 m and 2.5 m distance before a wall; their labels, and the chance of a person."""
    rows, cols = np.mgrid[:144, :176]
    truth = np.zeros((144, 176), np.uint8)
    truth[np.hypot(rows - 70, cols - 60) < 30] = 1
    truth[(np.hypot(rows - 70, cols - 110) < 34) & (truth == 0)] = 2
    depth = np.choose(truth, [np.float32(4.0), np.float32(2.0), np.float32(2.5)])
    image = reduce_frame(DepthFrame(0, "", depth, CAMERA))
    labels = np.select([np.abs(image.depth - 2.0) < 0.1, np.abs(image.depth - 2.5) < 0.1], [1, 2], 0)
    noise = np.random.default_rng(0).uniform(-0.3, 0.3, labels.shape)
    chance = np.clip(np.where(labels > 0, 0.9, 0.1) + noise, 0.0, 1.0).astype(np.float32)
    return depth, truth, image, labels.astype(np.uint8), chance


def test_people_keep_their_pixels_along_the_edges_of_the_depth():
    depth, truth, image, labels, chance = two_discs()
    np.testing.assert_array_equal(carry_people(image, labels, chance, depth, CAMERA), truth)


def test_nobody_is_carried_nowhere():
    depth, _, image, labels, chance = two_discs()
    assert not carry_people(image, np.zeros_like(labels), chance, depth, CAMERA).any()


def test_pixels_inside_people_need_no_weighing():
    depth, _, image, labels, chance = two_discs()
    near, solid = np.empty(labels.shape, np.bool_), np.empty(labels.shape, np.uint8)
    kernels.mark_near(labels, chance, 0.15, image.rows, image.cols, near, solid)
    assert (solid > 0).sum() > 1000
    carried, weighed = np.empty(depth.shape, np.uint8), np.empty(depth.shape, np.uint8)
    for inside, out in ((solid, carried), (np.zeros_like(solid), weighed)):
        space = np.empty(depth.shape, np.float32)
        marks = kernels.Marks(near, inside)
        kernels.carry_labels(depth, CAMERA, image, labels, chance, marks, out, space)
    np.testing.assert_array_equal(carried, weighed)


def test_chance_comes_from_the_nearest_net_pixel():
    _, _, image, _, chance = two_discs()
    wide = spread(chance, image, CAMERA)
    assert wide.shape == (144, 176)
    for i, j in ((0, 0), (70, 90), (143, 175), (20, 133)):
        u = (j - CAMERA.cx) / CAMERA.fx * image.camera.fx + image.camera.cx
        v = (i - CAMERA.cy) / CAMERA.fy * image.camera.fy + image.camera.cy
        assert wide[i, j] == chance[min(round(v), image.rows - 1), min(round(u), image.cols - 1)]


def test_labels_grow_along_a_surface_and_not_over_an_edge():
    depth = np.full((20, 20), 2.0, np.float32)
    depth[:, 10:] = 3.0
    labels = np.zeros(depth.shape, np.uint8)
    labels[5, 5] = 3
    chance = np.full(depth.shape, 0.4, np.float32)
    chance[12:] = 0.0  # the net is sure that this is nobody
    kernels.grow_labels(depth, labels, chance, 0.2, 0.01, 60.0, np.empty(depth.size, np.int64))
    assert (labels[:12, :10] == 3).all()
    assert not labels[:, 10:].any()
    assert not labels[12:].any()
