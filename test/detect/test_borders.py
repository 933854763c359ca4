"""The borders of people: flying pixels, against plain loops."""

from __future__ import annotations

import numpy as np

from depth_pose.core.types import HIDDEN
from depth_pose.detect._border_kernels import mark_unsupported


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
