"""Apply the joint net's mask of a person to the labels of an image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.measurement import CropMask
from depth_pose.core.types import BACKGROUND
from depth_pose.detect import _crop_kernels as kernels
from depth_pose.detect._crop_kernels import MaskLimits

_MASK = MaskLimits(least=-1.0, most=2.0, near=1.0)
"""Logits below and above which a pixel's label changes (chosen on development clips), and the depth (m) from
the torso within which pixels are added."""

_LIKELY = 1.5
"""Logit below which a doubted pixel is removed; chosen on development clips of 0, 1.5 and 3."""


def add_and_remove(
    mask: CropMask, depth: NDArray[np.float32], labels: NDArray[np.uint8], camera: Camera, label: int
) -> None:
    """Remove touching furniture from a person's labels, and add missed pixels."""
    kernels.apply_mask(depth, labels, camera, mask.view, mask.logits, label, _MASK)


def refuse(
    mask: CropMask, labels: NDArray[np.uint8], doubted: NDArray[np.bool_], camera: Camera, label: int
) -> None:
    """Remove doubted pixels from a person's labels where it is not probable that they show the person."""
    v, u = np.nonzero(doubted & (labels == label))
    x, y, z, cell = mask.view[:4]
    side = len(mask.logits)
    i = ((v - camera.cy - camera.fy * y / z) * z / (cell * camera.fy) + 0.5 * side).astype(int)
    j = ((u - camera.cx - camera.fx * x / z) * z / (cell * camera.fx) + 0.5 * side).astype(int)
    is_refused = mask.logits[i.clip(0, side - 1), j.clip(0, side - 1)] < _LIKELY
    labels[v[is_refused], u[is_refused]] = BACKGROUND
