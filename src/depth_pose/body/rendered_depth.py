"""Compare posed bodies with an observed person by rendering their depth.

The score of a hypothesis is the mean, over the union of the two silhouettes, of
``min(|dz|, band) / band``; a pixel in one silhouette only counts as a full mismatch, and pixels
where nothing is known are left out. It ranks candidates, finds the body's size, and detects
failures.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.body._nearest_kernels import nearest_person
from depth_pose.core import _raster_kernels as kernels
from depth_pose.core.camera import Camera

SCORE_BAND_M = 0.12
"""Depth difference that counts as a full mismatch in every score (m): about the thickness of a limb."""


class Observation(NamedTuple):
    """The observed person on a pixel grid, cropped to a window, in the form of the kernels' argument.

    Attributes
    ----------
    depth : (h, w) float32
        Metres; 0 where the pixel is not the person's.
    labels : (h, w) uint8
    camera : Camera
        Camera of the window.
    """

    depth: NDArray[np.float32]
    labels: NDArray[np.uint8]
    camera: Camera

    def strided(self, step: int) -> Observation:
        """Return the image of every ``step``-th pixel, beginning with the first."""
        return Observation(
            np.ascontiguousarray(self.depth[::step, ::step]),
            np.ascontiguousarray(self.labels[::step, ::step]),
            self.camera.strided(step),
        )


def nearest_person_pixels(observation: Observation) -> NDArray[np.int32]:
    """Find row and column of the nearest person pixel for every pixel, shape (h, w, 2)."""
    nearest = np.empty((*observation.labels.shape, 2), np.int32)
    nearest_person(observation.labels, nearest)
    return nearest


def render_depth(
    vertices: NDArray[np.float64], faces: NDArray[np.int32], camera: Camera
) -> NDArray[np.float32]:
    """Depth of a mesh in the camera frame, shape (h, w), metres, infinite where there is none."""
    zbuffer = np.empty((camera.height, camera.width), np.float32)
    kernels.rasterize(vertices, faces, camera, zbuffer)
    return zbuffer


@dataclass(frozen=True)
class Comparison:
    """Result of comparing a mesh with the observation.

    Attributes
    ----------
    score : float
        Disagreement, 0 to 1.
    mean_depth_error : float
        Mean depth difference where both are, each at most the band, metres.
    """

    score: float
    mean_depth_error: float


class DepthScorer:
    """Renders meshes into one observation's window and scores them."""

    def __init__(self, observation: Observation) -> None:
        self.observation = observation
        self.zbuffer = np.empty(observation.depth.shape, np.float32)
        self._sums = np.empty(5)

    @cached_property
    def nearest(self) -> NDArray[np.int32]:
        """Row and column (h, w, 2) of the nearest person pixel to every pixel."""
        return nearest_person_pixels(self.observation)

    def compare(self, vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> Comparison:
        """Render a mesh in the camera frame and compare it with the observation.

        Parameters
        ----------
        vertices : (V, 3) float64
            Camera frame, metres.
        faces : (F, 3) int32
        """
        kernels.score_mesh(vertices, faces, self.observation, SCORE_BAND_M, self.zbuffer, self._sums)
        score, mean_depth_error = self._sums[:2].tolist()
        return Comparison(score=score, mean_depth_error=mean_depth_error)
