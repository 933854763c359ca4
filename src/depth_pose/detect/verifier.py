"""Verification of clusters: a small network that distinguishes people from objects by their measures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import ConfigError
from depth_pose.core.odds import logistic
from depth_pose.detect._measure_kernels import MEASURES


@dataclass(frozen=True)
class Verifier:
    """Network with one hidden layer, fitted by ``tools/people_finder/fit_verifier.py``.

    Attributes
    ----------
    mean, scale : (MEASURES,) float64
        Normalisation of the measures.
    hidden, hidden_bias : (MEASURES, H), (H,) float64
    out : (H,) float64
    out_bias : float
    """

    mean: NDArray[np.float64]
    scale: NDArray[np.float64]
    hidden: NDArray[np.float64]
    hidden_bias: NDArray[np.float64]
    out: NDArray[np.float64]
    out_bias: float

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Verifier:
        """Build a verifier from the lists of a weights file.

        Raises
        ------
        ConfigError
            If it was fitted to other measures.
        """
        mean, scale, hidden, hidden_bias, out = (
            np.array(values[n], float) for n in ("mean", "scale", "hidden", "hidden_bias", "out")
        )
        made = cls(mean, scale, hidden, hidden_bias, out, float(values["out_bias"]))
        if made.hidden.shape[0] != MEASURES:
            raise ConfigError(
                f"the verifier was fitted to {made.hidden.shape[0]} measures; there are {MEASURES}"
            )
        return made

    def probability(self, measures: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute the probability that each cluster (P, MEASURES) is a person."""
        x = np.clip((measures - self.mean) / self.scale, -5.0, 5.0)
        log_odds = np.maximum(x @ self.hidden + self.hidden_bias, 0.0) @ self.out + self.out_bias
        return np.asarray(logistic(log_odds))
