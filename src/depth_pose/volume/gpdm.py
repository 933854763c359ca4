r"""Gaussian process dynamical model of a sequence of volumes (Sec. 3).

J. Wang, D. Fleet, A. Hertzmann, *Gaussian process dynamical models* (NIPS 2005). Both maps are
marginalised: :math:`V | X` is a Gaussian process with a radial kernel, :math:`X_{2..N} | X_{1..N-1}`
one with a radial and a linear kernel. Learning minimises

.. math:: L = \frac{D}{2} \ln |K_V| + \frac{1}{2} tr(K_V^{-1} V V') + \lambda \left(\frac{d}{2} \ln |K_X|
   + \frac{1}{2} tr(K_X^{-1} X_{out} X_{out}')\right) + \frac{1}{2} \sum_s |x_s|^2 + \sum_i \ln \theta_i

over the latent points and the kernels' parameters :math:`\theta`, by L-BFGS with analytic gradients
(the paper: scaled conjugate gradients). Several performances may be learned together: the dynamics
then has a first frame :math:`x_s` for each. Where the same frame is seen on several wearers, the
volumes' Gram matrix is the mean of theirs, as if the wearers were more dimensions of V.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, minimize

from depth_pose.volume.config import LearnConfig
from depth_pose.volume.gp import _LOG_BOUNDS, Kernel, evidence
from depth_pose.volume.tuning import LearnTuning

Array = NDArray[np.float64]

# of X to V, and of X to the next X: half of the latter's signal is linear; as usual for GPDM, not swept
_START = (Kernel(0.0, 0.0, np.log(0.05)), Kernel(np.log(0.5), 0.0, np.log(1e-2), np.log(0.5)))


@dataclass(frozen=True, eq=False)
class Dynamics:
    """Result of learning.

    Attributes
    ----------
    latent : (N, d) float64
        One point for each training frame.
    volume_kernel : Kernel
        Of X to V, for volumes divided by one standard deviation.
    motion_kernel : Kernel
        Kernel from the previous latent point to the next.
    cost : float
        Minus the logarithm of the posterior, up to a constant.
    """

    latent: Array
    volume_kernel: Kernel
    motion_kernel: Kernel
    cost: float


def chain_rows(lengths: list[int]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Rows of frames with a next one, of those next ones, and of the first frames of sequences."""
    ends = np.cumsum(np.array(lengths, np.int64))
    starts = ends - np.array(lengths, np.int64)
    before = np.concatenate([np.arange(s, e - 1) for s, e in zip(starts, ends, strict=True)])
    return before, before + 1, starts


def learn_dynamics(
    wearers: list[Array],
    lengths: list[int],
    config: LearnConfig,
    progress: Callable[[int], None] | None = None,
    tuning: LearnTuning = LearnTuning(),
) -> Dynamics:
    """Learn the latent points of volume sequences: the maximum of the posterior (Hirai et al. eq. 3).

    The paper's roles of alpha and beta change between its text and its equation: here each map has a kernel
    of its own, with the prior 1 / theta on each parameter, as in GPDM. Beyond the paper: the noise of
    the dynamics has a floor, several performances and wearers are learned
    together, and the optimiser is L-BFGS, not scaled conjugate gradients.

    Parameters
    ----------
    wearers : list of (N, D) float64
        Zero-mean volumes of all frames, divided by one standard deviation; one array for each
        wearer of the same performances.
    lengths : list of int
        Frames of each performance, in order; they sum to N.
    config : LearnConfig
    progress : callable, optional
        Called with the number of optimiser steps done.
    tuning : LearnTuning
    """
    n, outputs = wearers[0].shape
    gram = np.mean([v @ v.T for v in wearers], axis=0)
    before, after, starts = chain_rows(lengths)
    x0 = principal_points(np.mean(wearers, axis=0), config.latent)
    split = (x0.size, x0.size + 3)
    floor = tuning.noise_floor

    def cost(p: Array) -> tuple[float, Array]:
        x = p[: split[0]].reshape(n, config.latent)
        volume = evidence(Kernel.from_array(p[split[0] : split[1]]), x, gram, outputs)
        came, went = np.ascontiguousarray(x[before]), x[after]
        motion = evidence(Kernel.from_array(p[split[1] :]), came, went @ went.T, config.latent, floor)
        by_x = volume.inputs.copy()
        by_x[before] += motion.inputs
        by_x[after] += motion.solved @ went
        by_x[starts] += x[starts]
        # Hirai et al. eq. 3: minus the logarithm of the posterior, up to a constant
        value = volume.value + motion.value + 0.5 * float((x[starts] ** 2).sum())
        # p(theta) ~ 1 / theta for s, w, l and for the noise's precision
        signs = np.array([1.0, 1.0, -1.0])
        by_theta = np.concatenate([volume.parameters + signs, motion.parameters + [*signs, 1.0]])
        value += float(signs @ p[split[0] : split[1]] + np.array([*signs, 1.0]) @ p[split[1] :])
        return value, np.concatenate([by_x.ravel(), by_theta])

    done = [0]

    def tell(xk: Array) -> None:
        done[0] += 1
        if progress is not None:
            progress(done[0])

    start = np.concatenate([x0.ravel(), _START[0].as_array(), _START[1].as_array()])
    reach = np.concatenate([np.full(x0.size, np.inf), np.full(7, _LOG_BOUNDS[1])])
    found = minimize(
        cost, start, jac=True, method="L-BFGS-B", bounds=Bounds(-reach, reach), callback=tell,
        options={"maxiter": config.iterations},
    )  # fmt: skip
    return Dynamics(
        found.x[: split[0]].reshape(n, config.latent),
        Kernel.from_array(found.x[split[0] : split[1]]),
        Kernel.from_array(found.x[split[1] :]),
        float(found.fun),
    )


def principal_points(values: Array, dimensions: int) -> Array:
    """First principal components (N, d) of rows, divided by the first one's standard deviation."""
    centred = values - values.mean(axis=0)
    u, s, _ = np.linalg.svd(centred, full_matrices=False)
    points = u[:, :dimensions] * s[:dimensions]
    return np.asarray(points / max(float(points[:, 0].std()), 1e-12))
