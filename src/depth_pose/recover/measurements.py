r"""Joints fused from two measurements: the fitted body, and the finder's proposals.

The fitted body is right within a centimetre where it explains the depth, and unreliable where it does not:
its standard deviation :math:`\sigma_f` grows with the rendered-depth disagreement :math:`s`. The finder's
second look states the expected error :math:`e_j` of each joint. The joint is the mean weighted by inverse
variances,

.. math:: x_j = (1 - a_j)\, f_j + a_j\, p_j, \qquad a_j = \frac{\sigma_f^2}{\sigma_f^2 + \sigma_j^2},
   \qquad \sigma_f^2 = \sigma_0^2 + k^2 \max(0, s - s_0)^2, \qquad \sigma_j = e_j / 1.6,

since the mean distance of a three-dimensional Gaussian is 1.6 of its standard deviations.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.types import FoundPerson
from depth_pose.detect.joint_finder import TYPICAL_ERROR_M
from depth_pose.refine.proposals import named_alike

_FIT_M, _FIT_RISE_M, _FIT_SCORE = 0.01, 0.7, 0.4
"""Standard deviation of a good fit (m), its rise with the score (m), and the score where the rise begins;
chosen on three real and three simulated sets."""

_MEAN_DISTANCE = 1.6
"""Mean distance of a three-dimensional Gaussian, in standard deviations."""

_LEAST, _MOST = 0.02, 0.98
"""Confidences of proposals are clipped to this range."""


class Measured(NamedTuple):
    """Joints (19, 3), camera frame, metres; weights (19,) and confidences (19,) of their proposals."""

    joints: NDArray[np.float64]
    share: NDArray[np.float64]
    proposed: NDArray[np.float64]


def weigh_joints(fitted: NDArray[np.float64], score: float, found: FoundPerson) -> Measured:
    """Compute the mean of fitted and proposed joints, weighted by their inverse variances.

    Parameters
    ----------
    fitted : (19, 3) float64
        Camera frame, metres.
    score : float
        Rendered-depth disagreement of the fit.
    found : FoundPerson
        Left and right are exchanged if that is nearer to the fit.
    """
    if len(found.proposals) != len(fitted):
        return Measured(fitted, np.zeros(len(fitted)), np.zeros(len(fitted)))
    places, confidence = named_alike(fitted, found)
    sure = np.clip(confidence.astype(np.float64), _LEAST, _MOST)
    stated = TYPICAL_ERROR_M * np.sqrt(1.0 / sure - 1.0) / _MEAN_DISTANCE
    of_fit = _FIT_M**2 + (_FIT_RISE_M * max(0.0, score - _FIT_SCORE)) ** 2
    share = of_fit / (of_fit + stated**2)
    return Measured(fitted + share[:, None] * (places - fitted), share, sure)
