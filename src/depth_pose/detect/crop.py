"""The crop around one detection, the input of a joint net.

A crop around the torso has the same pixel size, in metres, for every sensor and distance.
"""

from __future__ import annotations

import threading
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.measurement import CropView
from depth_pose.detect import _crop_kernels as kernels


class Crop(NamedTuple):
    """One detection, and the image around it.

    Attributes
    ----------
    depth : (h, w) float32
        The whole image, metres; 0 where nothing returned.
    labels : (h, w) uint8
        Number of the person at each pixel.
    camera : Camera
    label : int
        Number of this person.
    torso : (3,) float64
        Approximate middle of shoulders and hips, camera frame, metres.
    probability : float
        Probability of a person, from the finder.
    expected : (J, 3) float64 or None
        Approximate joints, camera frame, metres, of somebody who was measured well a moment ago.
    """

    depth: NDArray[np.float32]
    labels: NDArray[np.uint8]
    camera: Camera
    label: int
    torso: NDArray[np.float64]
    probability: float
    expected: NDArray[np.float64] | None = None


class CropSample(NamedTuple):
    """A crop resampled to a net's pixels; valid until the sampler's next one.

    Attributes
    ----------
    view : CropView
    grid : (side, side) float32
        Depth, metres; 0 without.
    whose : (side, side) int64
        Number of the person at each pixel, -1 outside the image.
    """

    view: CropView
    grid: NDArray[np.float32]
    whose: NDArray[np.int64]


class CropSampler(threading.local):
    """Resamples crops, in each thread into other arrays.

    Parameters
    ----------
    side : int
        Rows and columns of a sample.
    cell_m : float
        Side of a pixel at the torso's distance, metres.
    """

    def __init__(self, side: int, cell_m: float) -> None:
        self.side, self._cell_m = side, cell_m
        self._grid, self._whose = np.empty((side, side), np.float32), np.empty((side, side), np.int64)

    def sample(self, crop: Crop, flip: float = 1.0) -> CropSample:
        """Return the crop's depth and labels; its mirror image with a ``flip`` of -1."""
        x, y, z = crop.torso.tolist()
        view = CropView(x, y, z, self._cell_m, flip=flip)
        kernels.sample_crop(crop.depth, crop.labels, crop.camera, view, self._grid, self._whose)
        return CropSample(view, self._grid, self._whose)
