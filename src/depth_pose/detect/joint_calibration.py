"""Calibration of the joint net: its deviations by sensor and distance, and the probability of a person."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.odds import logistic, logit
from depth_pose.detect import _crop_kernels as kernels
from depth_pose.detect.crop import CropSample

_BENDS = (1, 4)
"""Steps of `measure_bend`, pixels of a crop."""

_PAIRS = np.triu_indices(1 + len(_BENDS))
"""All pairs of two `crop_measures`, each with itself, too."""


class PersonOdds(NamedTuple):
    """Logistic regression on the logits of a person.

    Attributes
    ----------
    first, second : float
        Weights of the logits of the finder and of the joint net.
    bias : float
    """

    first: float
    second: float
    bias: float

    def probability(self, found: float, log_odds: float) -> float:
        """Combine the finder's probability and the joint net's logit."""
        return float(logistic(self.first * logit(found) + self.second * log_odds + self.bias))


class DeviationScale(NamedTuple):
    """Factors on the net's deviations, by sensor and distance: exponentials of quadratic functions.

    Attributes
    ----------
    weights : (2, K) float64
        Weights of the `terms`, in the plane and in depth.
    least, most : (M,) float64
        Range of the `crop_measures` for which the weights were fitted; others are clipped.
    """

    weights: NDArray[np.float64]
    least: NDArray[np.float64]
    most: NDArray[np.float64]

    def terms(self, measures: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return 1, the measures (..., M) from -1 to 1, and the products of two of them, (..., K)."""
        x = 2.0 * (measures.clip(self.least, self.most) - self.least) / (self.most - self.least) - 1.0
        first, second = _PAIRS
        return np.concatenate([np.ones_like(x[..., :1]), x, x[..., first] * x[..., second]], axis=-1)

    def factors(self, measures: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute the factors (..., 2) for crops with measures (..., M)."""
        return np.exp(self.terms(measures) @ self.weights.T)


class JointCalibration(NamedTuple):
    """Calibration fitted to a trained net's outputs.

    Attributes
    ----------
    person, person_in_window : PersonOdds
        Of a whole crop, and of a window of one.
    deviations : DeviationScale
    """

    person: PersonOdds
    person_in_window: PersonOdds
    deviations: DeviationScale

    @classmethod
    def of(cls, settings: Mapping[str, Any]) -> JointCalibration:
        """Return the calibration of a net's settings file."""
        deviations = (np.array(settings["deviations"][key]) for key in DeviationScale._fields)
        person, in_window = (PersonOdds(*settings[key]) for key in ("person", "person_in_window"))
        return cls(person, in_window, DeviationScale(*deviations))

    def odds(self, in_window: bool) -> PersonOdds:
        """Return the odds of a person for a look at a window, or at a whole crop."""
        return self.person_in_window if in_window else self.person


def crop_measures(sample: CropSample, label: int) -> NDArray[np.float64]:
    """Return features that distinguish sensors and distances, (3,): logarithms of distance and bends (m).

    Parameters
    ----------
    sample : CropSample
    label : int
        The person's.
    """
    bends = [kernels.measure_bend(sample.grid, sample.whose, label, step) for step in _BENDS]
    return np.log([sample.view.z, *bends])
