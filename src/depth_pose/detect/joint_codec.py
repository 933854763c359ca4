"""Encode a person's landmarks as the joint net's outputs, and decode these.

Training encodes the targets (``tools/people_finder``), the pipeline decodes the outputs; both use this
module. Landmarks are labelled by image side, as if everybody faced the camera; the back view is a separate
output. Each has a distribution exp(-r / width) in the image plane, and exp(-|z| / width) in depth with a
width of its own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.measurement import CropView
from depth_pose.core.odds import logistic
from depth_pose.core.rotations import lengths_of
from depth_pose.core.skeleton import MIRROR_LANDMARKS, Landmarks
from depth_pose.detect import _crop_kernels as kernels

LOG_WIDTHS = (-6.0, 2.0)
"""Range to which the logarithms of widths (m) are clipped."""

_STANDARD = np.sqrt([3.0, 2.0])
"""Standard deviation of a distribution of width 1: exp(-r) over the plane, each way, and exp(-|z|)."""

_MEAN_SQUARE = np.array([4.0 / 3.0, 0.5])
"""Squares of the mean distances, 2 widths in the plane and 1 in depth, by the squares of those deviations."""

_HALF = np.float32(0.5)


class JointCodes(NamedTuple):
    """Outputs of the net for one crop.

    Attributes
    ----------
    places : (L, 3) float32
        Landmarks in the crop's coordinates, metres; left and right as in the image.
    log_width : (L, 2) float32
        Logarithms of the widths of their distributions, in the image plane and in depth.
    behind, person : float
        Logits of a back view, and of a person.
    mask : (side, side) float32
        Logits of a pixel showing the person.
    """

    places: NDArray[np.float32]
    log_width: NDArray[np.float32]
    behind: float
    person: float
    mask: NDArray[np.float32]

    def mirrored(self) -> JointCodes:
        """Return the answer for the mirror image of the crop."""
        places = self.places[MIRROR_LANDMARKS] * np.array([-1.0, 1.0, 1.0], np.float32)
        width, mask = self.log_width[MIRROR_LANDMARKS], np.ascontiguousarray(self.mask[:, ::-1])
        return self._replace(places=places, log_width=width, mask=mask)

    def mean(self, other: JointCodes) -> JointCodes:
        """Return the mean of two answers for one crop; left and right of the other are named alike."""
        gap, swapped_gap = (
            lengths_of(self.places - places).sum()
            for places in (other.places, other.places[MIRROR_LANDMARKS])
        )
        if swapped_gap < gap:  # seen from the side: then it is also the other view
            places, width = other.places[MIRROR_LANDMARKS], other.log_width[MIRROR_LANDMARKS]
            other = other._replace(places=places, log_width=width, behind=-other.behind)
        return JointCodes(
            _HALF * (self.places + other.places),
            _HALF * (self.log_width + other.log_width),
            0.5 * (self.behind + other.behind),
            0.5 * (self.person + other.person),
            _HALF * (self.mask + other.mask),
        )


class DecodedJoints(NamedTuple):
    """A net's answer in the camera frame, left and right the person's.

    Attributes
    ----------
    places : Landmarks
        Camera frame, metres.
    sigma : (L, 2) float64
        Standard deviation in each direction of the image plane, and in depth, metres.
    error : (L,) float64
        Expected error, metres, including that of exchanging left and right.
    left_right_confidence : float
        Probability that left and right are not exchanged, .5 to 1.
    """

    places: Landmarks
    sigma: NDArray[np.float64]
    error: NDArray[np.float64]
    left_right_confidence: float


class JointCodec:
    """Converts landmarks to a net's numbers and back.

    Parameters
    ----------
    least_width_m : float
        Smallest width of a landmark's distribution, metres.
    """

    def __init__(self, least_width_m: float) -> None:
        self._least_width_m = least_width_m

    @staticmethod
    def encode(landmarks: Landmarks, view: CropView) -> NDArray[np.float64]:
        """Return a person's landmarks, camera frame, in a crop's coordinates (L, 3), metres.

        Names are the person's, those of a mirrored crop the mirror image's; for people who are seen from
        behind, the caller exchanges left and right (``MIRROR_LANDMARKS``).
        """
        places = np.empty((len(landmarks), 3))
        kernels.to_crop(landmarks, view, places)
        return places[MIRROR_LANDMARKS] if view.flip < 0 else places

    def decode(self, codes: JointCodes, view: CropView) -> DecodedJoints:
        """Return a net's answer for a crop, neither rotated nor mirrored, in the camera frame."""
        places = kernels.from_crop(codes.places.astype(np.float64), view)
        sigma, error = self.deviations(codes.log_width)
        from_behind = float(logistic(codes.behind))
        if from_behind > 0.5:
            places, sigma, error = (v[MIRROR_LANDMARKS] for v in (places, sigma, error))
        apart = lengths_of(places - places[MIRROR_LANDMARKS])
        error = error + min(from_behind, 1.0 - from_behind) * apart
        return DecodedJoints(Landmarks(places), sigma, error, max(from_behind, 1.0 - from_behind))

    def deviations(self, log_width: NDArray[np.float32]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return standard deviations (L, 2) and mean distances (L,), metres, from log widths (L, 2)."""
        width = self._least_width_m + np.exp(log_width.astype(np.float64).clip(*LOG_WIDTHS))
        sigma = _STANDARD * width
        return sigma, np.sqrt(sigma**2 @ _MEAN_SQUARE)
