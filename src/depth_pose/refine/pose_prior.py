r"""How unusual a pose is, among those of the bank.

Depth alone does not tell a hidden leg that points backward from one that stands, nor an arm from a chair's
back that was taken for one. The joints of the bank's poses, in the trunk's own axes, have a mean
:math:`\mu` and a covariance :math:`C` that knows how limbs go together; a pose's distance from them, in
standard deviations, is

.. math:: d = \sqrt{(x - \mu)^T C^{-1} (x - \mu) / n}

with all :math:`n` coordinates :math:`x` of its joints (P. Mahalanobis, *On the generalized distance in
statistics*, 1936). Of skeletons that were off by more than 60 mm on development clips the true pose had
the smaller distance in 67 of 69 frames; up to 30 mm the two do not differ. So it says nothing up to what
is usual, and more and more beyond.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.core.skeleton import JOINT_NODES, MIRROR_JOINTS
from depth_pose.refine import _plausible_kernels as kernels

_USUAL = 0.7
"""Distance up to which a pose is as good as any; 0.65 is the bank's median, 0.98 its 95th percentile."""

_NOISE_M = 0.02
"""Joints vary by this beside what the bank says, metres."""

_POSES = 6000
"""Poses of the bank, evenly spread, that stand for all; not swept."""


def usual_joints(bank: Bank) -> NDArray[np.float64]:
    """Give joints (N, 19, 3) of a bank's poses and their mirror images, in trunk axes, metres."""
    step = max(1, bank.poses // _POSES)
    joints = kernels.in_trunk_axes_all(bank.pose_nodes[::step][:, JOINT_NODES])
    return np.concatenate([joints, joints[:, MIRROR_JOINTS] * np.array([-1.0, 1.0, 1.0])])


class PosePrior:
    """Tells how unusual poses are.

    Parameters
    ----------
    usual : (N, 19, 3) float64
        `usual_joints` of a bank.
    """

    def __init__(self, usual: NDArray[np.float64]) -> None:
        rows = usual.reshape(len(usual), -1)
        self._mean = rows.mean(axis=0)
        covariance = np.cov(rows.T) + _NOISE_M**2 * np.eye(rows.shape[1])
        self._whiten = np.ascontiguousarray(np.linalg.inv(np.linalg.cholesky(covariance)))

    def distance(self, nodes: NDArray[np.float64], scale: float) -> float:
        """Give a pose's distance from the bank's mean, in standard deviations.

        Parameters
        ----------
        nodes : (21, 3) float64
            In any frame, metres.
        scale : float
        """
        return float(kernels.distance(nodes[JOINT_NODES], scale, self._mean, self._whiten))

    def excess(self, nodes: NDArray[np.float64], scale: float) -> float:
        """Give by how much a pose is more unusual than poses are; 0 for most."""
        return max(0.0, self.distance(nodes, scale) - _USUAL)
