r"""Joints fused from two measurements: the fitted body, and the finder's proposals.

The fitted body is right within a centimetre where it explains the depth, and unreliable where it does not:
its standard deviation :math:`\sigma_f` grows with the rendered-depth disagreement :math:`s` and with the mean
depth difference :math:`g` where body and person overlap, and where the confidence :math:`p_j` of the joint is
low. A bed that is taken for a part of the person raises the disagreement alone, and says nothing against the
fit. The joint net states the deviations of each joint
across and along its ray. The joint is the mean weighted by inverse covariances,

.. math:: x_j = f_j + \sigma_f^2\, (\sigma_f^2 1 + C_j)^{-1} (q_j - f_j), \qquad
   \sigma_f^2 = \sigma_0^2 + \min(k\, (s - s_0)_+,\; m\, (g - g_0)_+)^2 + c^2 (1 / p_j - 1),

with the covariance :math:`C_j` of `depth_pose.refine.articulated`, but a smaller floor. The published
covariance is that of this mean, :math:`(\sigma_f^{-2} 1 + C_j^{-1})^{-1}`, before the low-pass filter, and
wider where the joint is not seen;
``benchmarks/accuracy.py spread`` compares it with errors.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.rotations import unit_vectors
from depth_pose.core.skeleton import JointState

_FIT_M, _FIT_RISE_M, _FIT_SCORE = 0.01, 0.3, 0.25
"""Standard deviation of a good fit (m), its rise with the score (m), and the score where the rise begins;
chosen on three real and six simulated sets."""

_GAP_RISE, _GAP_M = 3.0, 0.015
"""Rise of that deviation with the depth difference, and the difference (m) where it begins; chosen on
recordings from ceilings and in homes from two pairs."""

_EVEN_M = 0.07
"""Standard deviation (m) of a joint whose confidence is one half; chosen on the same sets from .05, .07 and
.10."""

_LEAST, _MOST = 0.02, 0.998
"""Confidences are clipped to this range."""

_SHARED_M = 0.02
"""Standard deviation (m) added to each proposal's; flat between .01 and .04."""

_SEEN = int(JointState.SEEN)
_UNSEEN = 1.4
"""Factor on the deviations of joints that are hidden or outside of the image; chosen on 22 clips."""


class Measured(NamedTuple):
    """Joints fused from fit and measurement.

    Attributes
    ----------
    joints : (19, 3) float64
        Camera frame, metres.
    share : (19, 2) float64
        Weight of the measurement across the ray and along it, 0 to 1.
    variance : (19, 2) float64
        Variance of each joint across its ray and along it, m^2.
    """

    joints: NDArray[np.float64]
    share: NDArray[np.float64]
    variance: NDArray[np.float64]


def weigh_joints(
    fitted: NDArray[np.float64],
    score: float,
    confidence: NDArray[np.float64],
    measured: JointMeasurement | None,
    mean_depth_error: float = np.inf,
) -> Measured:
    """Compute the mean of fitted and proposed joints, weighted by their inverse covariances.

    Parameters
    ----------
    fitted : (19, 3) float64
        Camera frame, metres.
    score : float
        Rendered-depth disagreement of the fit.
    confidence : (19,) float64
        Confidence of each fitted joint, 0 to 1.
    measured : JointMeasurement or None
        Left and right are exchanged if that is nearer to the fit.
    mean_depth_error : float
        Mean depth difference of the fit, metres; only the disagreement counts if it is left out.
    """
    doubt = 1.0 / np.minimum(np.maximum(confidence, _LEAST), _MOST) - 1.0
    rise = min(_FIT_RISE_M * max(0.0, score - _FIT_SCORE), _GAP_RISE * max(0.0, mean_depth_error - _GAP_M))
    whole = _FIT_M**2 + rise**2
    of_fit = (whole + _EVEN_M**2 * doubt)[:, None]
    if measured is None:
        return Measured(fitted, np.zeros((len(fitted), 2)), np.repeat(of_fit, 2, axis=1))
    proposed = measured.named_like(fitted)
    apart = proposed.places - fitted
    ray = unit_vectors(proposed.places)
    along = (apart * ray).sum(axis=1, keepdims=True) * ray
    share = of_fit / (of_fit + proposed.sigmas**2 + _SHARED_M**2)
    joints = fitted + share[:, :1] * (apart - along) + share[:, 1:] * along
    return Measured(joints, share, (1.0 - share) * of_fit)


def covariances(
    joints: NDArray[np.float64], variance: NDArray[np.float64], states: NDArray[np.uint8]
) -> NDArray[np.float64]:
    """Compute the covariances (19, 3, 3) of fused joints, camera frame, m^2.

    Parameters
    ----------
    joints : (19, 3) float64
        Camera frame, metres.
    variance : (19, 2) float64
        As in `Measured`.
    states : (19,) uint8
        `depth_pose.core.skeleton.JointState` values; what is not seen is wider (`_UNSEEN`).
    """
    ray = unit_vectors(joints)
    widened = np.where(states == _SEEN, 1.0, _UNSEEN**2)
    across, along = (widened * variance.T)[..., None, None]
    return across * np.eye(3) + (along - across) * ray[:, :, None] * ray[:, None, :]
