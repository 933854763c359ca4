"""Apply the joint net's mask of a person to the labels of an image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.labels import BACKGROUND
from depth_pose.core.measurement import CropMask
from depth_pose.detect import _crop_kernels as kernels
from depth_pose.detect._crop_kernels import MaskLimits
from depth_pose.detect.crop import Crop

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
    is_refused = _logits_at(mask, camera, v, u) < _LIKELY
    labels[v[is_refused], u[is_refused]] = BACKGROUND


def without_denied(mask: CropMask, crop: Crop) -> NDArray[np.uint8]:
    """Return a crop's labels without the person's pixels that the mask denies."""
    labels = crop.labels.copy()
    v, u = np.nonzero(labels == crop.label)
    is_denied = _logits_at(mask, crop.camera, v, u) < 0.0
    labels[v[is_denied], u[is_denied]] = BACKGROUND
    return labels


def _logits_at(
    mask: CropMask, camera: Camera, v: NDArray[np.int64], u: NDArray[np.int64]
) -> NDArray[np.float32]:
    """Return the mask at pixels of the image; beyond the crop that of its border."""
    x, y, z, cell = mask.view[:4]
    side = len(mask.logits)
    i = ((v - camera.cy - camera.fy * y / z) * z / (cell * camera.fy) + 0.5 * side).astype(int)
    j = ((u - camera.cx - camera.fx * x / z) * z / (cell * camera.fx) + 0.5 * side).astype(int)
    i, j = np.minimum(np.maximum(i, 0), side - 1), np.minimum(np.maximum(j, 0), side - 1)
    return mask.logits[i, j]
