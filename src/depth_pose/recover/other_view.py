"""A second answer, for frames in which a person's left and right are ambiguous.

From the front and from behind people may look alike, as from straight above, or far away. The joint net
states how surely it names the sides (`JointMeasurement.sides`). A confident decision is remembered for a
moment, so that a tracked pose keeps its sides.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.odds import logistic, logit
from depth_pose.core.skeleton import MIRROR_JOINTS
from depth_pose.track.state import Sides

_HALF_LIFE_S = 0.5
"""Half-life of the remembered log-odds: a person may turn round in a second. Set by hand."""


def renew_sides(
    sides: Sides, joints: NDArray[np.float64], measured: JointMeasurement | None, stamp_ns: int
) -> tuple[Sides, float]:
    """Update the belief that left and right of a person's answers are not exchanged.

    The stronger of this frame's and the remembered evidence is used. Without measured joints nothing speaks
    against an answer: then the probability is 1.

    Parameters
    ----------
    sides : Sides
        Of the frame before.
    joints : (19, 3) float64
        The answer.
    measured : JointMeasurement or None
    stamp_ns : int

    Returns
    -------
    tuple of Sides, float
        The new belief, and the probability.
    """
    if measured is None:
        return sides, 1.0
    kept = sides.logit * 0.5 ** (1e-9 * (stamp_ns - sides.stamp_ns) / _HALF_LIFE_S)
    if sides.joints is not None and _is_turned(joints, sides.joints):
        kept = 0.0  # the person turned round, or the answer changed sides
    said = logit(measured.sides) * (-1.0 if measured.named_like(joints).is_exchanged else 1.0)
    log_odds = said if abs(said) >= abs(kept) else kept
    return Sides(log_odds, stamp_ns, joints), float(logistic(log_odds))


def _is_turned(joints: NDArray[np.float64], before: NDArray[np.float64]) -> bool:
    """Check whether joints are nearer to those of the frame before with left and right exchanged."""
    gaps = [float(np.linalg.norm(joints - other).sum()) for other in (before, before[MIRROR_JOINTS])]
    return gaps[1] < gaps[0]
