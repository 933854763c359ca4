"""Probabilities and their log-odds."""

from __future__ import annotations

from typing import Any

import numpy as np


def logistic(log_odds: Any) -> Any:
    """Return the probabilities of log-odds, numbers or arrays; also compiled, in `core._odds_kernels`."""
    return 1.0 / (1.0 + np.exp(-log_odds))


def logit(probability: float, least: float = 1e-4) -> float:
    """Return the log-odds of a probability, which is clipped to this distance from 0 and 1."""
    p = min(max(probability, least), 1.0 - least)
    return float(np.log(p / (1.0 - p)))
