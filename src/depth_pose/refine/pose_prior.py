r"""Pose prior: how unusual a pose is among those of the bank.

Depth alone does not distinguish a hidden leg that points backward from one that stands, or a chair back from
an arm. The joints of the bank's poses, in trunk axes, have a mean :math:`\mu` and a covariance :math:`C` that
captures how limbs move together. The distance of a pose, in standard deviations, is

.. math:: d = \sqrt{(x - \mu)^T C^{-1} (x - \mu) / n}

with all :math:`n` coordinates :math:`x` of its joints (P. Mahalanobis, *On the generalized distance in
statistics*, 1936). It separates true from wrong poses only for errors above about 60 mm, so usual distances
cost nothing and the cost grows beyond them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.core.skeleton import JOINT_NODES, MIRROR_JOINTS, Nodes
from depth_pose.refine import _plausible_kernels as kernels

_NOISE_M = 0.02
"""Standard deviation (m) added to the bank's variation of each joint."""

_POSES = 6000
"""Number of bank poses, evenly spread, used for the statistics."""


def usual_joints(bank: Bank) -> NDArray[np.float64]:
    """Return the joints (N, 19, 3) of a bank's poses and their mirror images, in trunk axes, metres."""
    step = max(1, bank.poses // _POSES)
    joints = kernels.in_trunk_axes_all(np.ascontiguousarray(bank.pose_nodes[::step][:, JOINT_NODES]))
    return np.concatenate([joints, joints[:, MIRROR_JOINTS] * np.array([-1.0, 1.0, 1.0])])


class PosePrior:
    """Measures how unusual poses are.

    Parameters
    ----------
    usual : (N, 19, 3) float64
        `usual_joints` of a bank.

    Attributes
    ----------
    mean, whiten : (57,), (57, 57) float64
        Mean of the joints' coordinates, and the inverse of their covariance's lower Cholesky factor.
    """

    def __init__(self, usual: NDArray[np.float64]) -> None:
        rows = usual.reshape(len(usual), -1)
        self.mean = rows.mean(axis=0)
        covariance = np.cov(rows.T) + _NOISE_M**2 * np.eye(rows.shape[1])
        self.whiten = np.ascontiguousarray(np.linalg.inv(np.linalg.cholesky(covariance)))

    def distance(self, nodes: Nodes, scale: float) -> float:
        """Compute a pose's distance from the bank's mean, in standard deviations.

        Parameters
        ----------
        nodes : (21, 3) float64
            In any frame, metres.
        scale : float
        """
        return float(kernels.distance(nodes[JOINT_NODES], scale, self.mean, self.whiten))
