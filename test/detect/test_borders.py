"""The borders of people: flying pixels, against plain loops, and what may hide legs."""

from __future__ import annotations

import numpy as np

from depth_pose.core.camera import Camera
from depth_pose.core.labels import HIDDEN
from depth_pose.detect._border_kernels import mark_at_limbs, mark_unsupported


def test_pixels_without_support_of_their_own_person_are_hidden():
    rng = np.random.default_rng(5)
    depth = rng.choice([1.0, 1.05, 2.0], (21, 23)).astype(np.float32)
    labels = rng.choice([0, 1, 2, HIDDEN], depth.shape, p=[0.15, 0.4, 0.4, 0.05]).astype(np.uint8)
    marked = labels.copy()
    mark_unsupported(depth, marked, 0.08, 7)
    for i in range(21):
        for j in range(23):
            window = (slice(max(0, i - 2), i + 3), slice(max(0, j - 2), j + 3))
            own = (labels[window] == labels[i, j]) & (np.abs(depth[window] - depth[i, j]) <= 0.08)
            flies = labels[i, j] in (1, 2) and own.sum() - 1 < 7
            assert marked[i, j] == (HIDDEN if flies else labels[i, j])


def test_background_at_a_doubtful_leg_is_hidden_unless_it_is_behind():
    camera = Camera(80, 80, 80.0, 80.0, 40.0, 40.0)
    depth = np.full((80, 80), 3.0, np.float32)  # a wall far behind the legs
    depth[50:] = 1.9  # a table in front of the shins
    labels = np.zeros(depth.shape, np.uint8)
    labels[20:50, 36:45] = 1
    places = np.zeros((3, 3), np.float32)
    places[:, 1], places[:, 2] = (-0.2, 0.2, 0.7), 2.0  # hip, knee, ankle, on one vertical line at x = 0
    unsure = np.array([[0.03, 0.04], [0.1, 0.1], [0.2, 0.2]], np.float32)
    ends = np.array([1, 2])

    marked = labels.copy()
    mark_at_limbs(depth, marked, camera, ends, places, unsure)
    assert (marked[:50] == labels[:50]).all()  # the wall is seen behind the thigh, and people stay theirs
    assert (marked[52:66, 40] == HIDDEN).all()  # the table, where the shin is
    assert (marked[50:, :24] == 0).all() and (marked[50:, 57:] == 0).all()  # but not far beside it
    reach = (marked[50:] == HIDDEN).sum(axis=1)
    assert reach[16] > reach[2] > 0  # the ankle is less sure than the knee

    sure = np.full((3, 2), 0.04, np.float32)
    marked = labels.copy()
    mark_at_limbs(depth, marked, camera, ends, places, sure)
    assert (marked == labels).all()

    behind = places.copy()
    behind[:, 2] = 0.0  # not in front of the camera
    mark_at_limbs(depth, marked, camera, ends, behind, unsure)
    assert (marked == labels).all()
