r"""The probability that a track is a person, from all that speaks for it and against it.

A logistic regression, in two steps. Before the fit, a track's log-odds are

.. math:: L = w^T (1,\; \bar l,\; l - \bar l,\; m,\; \log(1 + t),\; \log z,\; \log \sigma)

with the discounted mean :math:`\bar l` of the logits of its detections (finder and joint net) and the last
of them :math:`l`; the way :math:`m` that it has come in the room, up to 1 m, which counts while the camera
stands still; the time :math:`t` on track, s; its distance :math:`z`, m; and the mean deviation
:math:`\sigma` of its measured joints, m, which tells sensors apart, averaged as the logits are. After the fit
they are :math:`v^T (1, L, \bar o)` with the mean distance :math:`\bar o` of the fitted poses from the bank's:
a body that is fitted to a pet or to furniture takes an unusual pose. Beside it, the disagreement of the body
with the depth image says no more. Detections of a thing that stands still repeat one error, so their logits
are averaged, not summed.

``tools/people_finder/fit_person_odds.py`` fits both to tracks in simulated homes.
"""

from __future__ import annotations

import json
import math
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.odds import logistic
from depth_pose.detect.net import read_weights

_HALF_LIFE_S = 1.0
"""Time (s) after which a detection counts half in the mean of a track's logits."""

_FAR_ENOUGH_M = 1.0
"""A longer way (m) in the room says no more."""

_NO_SIGMA_M = 0.05
"""Deviation of joints (m) where none were measured."""

_LEAST_LOGIT, _MOST_LOGIT = -6.0, 6.0
"""Range of the logits of detections."""


class TrackEvidence(NamedTuple):
    """What detections and motion say of a track.

    Attributes
    ----------
    total, weight : float
        Discounted sum of the logits of its detections, and of ones.
    last : float
        Logit of the last detection.
    way_m : float
        Longest distance from its first place while the camera stood still, metres.
    seconds : float
        Time on track.
    distance : float
        From the camera, metres.
    deviations : float
        Discounted sum of the logarithms of its measured joints' mean deviation, metres.
    """

    total: float = 0.0
    weight: float = 0.0
    last: float = 0.0
    way_m: float = 0.0
    seconds: float = 0.0
    distance: float = 1.0
    deviations: float = 0.0

    def seen(
        self, logit: float, seconds: float, way_m: float, distance: float, sigma: float | None
    ) -> TrackEvidence:
        """Return the evidence with one more detection, ``seconds`` after the last."""
        kept = 0.5 ** (seconds / _HALF_LIFE_S)
        logit = min(max(logit, _LEAST_LOGIT), _MOST_LOGIT)
        deviation = self._log_deviation() if sigma is None else math.log(max(sigma, 1e-3))
        return TrackEvidence(
            total=kept * self.total + logit,
            weight=kept * self.weight + 1.0,
            last=logit,
            way_m=max(self.way_m, way_m),
            seconds=self.seconds + seconds,
            distance=distance,
            deviations=kept * self.deviations + deviation,
        )

    def joined(self, other: TrackEvidence) -> TrackEvidence:
        """Return the evidence of this track and of an earlier one of the same person."""
        return self._replace(
            total=self.total + other.total,
            weight=self.weight + other.weight,
            deviations=self.deviations + other.deviations,
            way_m=max(self.way_m, other.way_m),
            seconds=self.seconds + other.seconds,
        )

    def terms(self) -> NDArray[np.float64]:
        """Return the regression's terms, (7,)."""
        mean = self.total / max(self.weight, 1e-9)
        return np.array(
            [
                1.0,
                mean,
                self.last - mean,
                min(self.way_m, _FAR_ENOUGH_M),
                np.log1p(self.seconds),
                np.log(max(self.distance, 0.1)),
                self._log_deviation(),
            ]
        )

    def _log_deviation(self) -> float:
        return self.deviations / self.weight if self.weight else math.log(_NO_SIGMA_M)


class PersonOdds(NamedTuple):
    """Weights of the regression.

    Attributes
    ----------
    track : (7,) float64
        Of `TrackEvidence.terms`.
    fitted : (3,) float64
        Of 1, the log-odds before the fit, and the mean distance of fitted poses.
    """

    track: NDArray[np.float64]
    fitted: NDArray[np.float64]

    @classmethod
    @cache
    def load(cls) -> PersonOdds:
        """Read the packaged weights, which belong to the nets."""
        values = json.loads(read_weights("person_odds.json", None))
        return cls(np.array(values["track"]), np.array(values["fitted"]))

    def before_fit(self, evidence: TrackEvidence) -> float:
        """Compute the probability that a track is a person, 0 to 1."""
        return logistic(float(self.track @ evidence.terms()))

    def after_fit(self, probability: float, pose_distance: float) -> float:
        """Compute it once bodies were fitted, with their poses' mean distance from the bank's, 0 to 1."""
        p = min(max(probability, 1e-6), 1.0 - 1e-6)
        return logistic(float(self.fitted @ [1.0, math.log(p / (1.0 - p)), pose_distance]))
