r"""Non-rigid coherent point drift: move one point set onto another with a smooth field.

A. Myronenko and X. Song, *Point set registration: coherent point drift*, IEEE TPAMI 32, 2010, which the paper
uses to find which exemplar vertex corresponds to which input point (Sec. 6).

The source points :math:`y_m`, moved to :math:`t_m = y_m + v(y_m)`, are the centres of a Gaussian mixture with
one variance and a uniform outlier class; the target points :math:`x_n` are samples of it.

*E-step*

.. math:: p_{mn} = \frac{e^{-\|x_n - t_m\|^2 / 2\sigma^2}}{c + \sum_k e^{-\|x_n - t_k\|^2 / 2\sigma^2}},
   \qquad c = (2\pi\sigma^2)^{3/2}\, \frac{w}{1 - w}\, \frac{M}{N}

with the outlier weight w. In metres c is small, so far points are excluded by a cut: Gaussians end at 5.7
sigma, and a target beyond the reach of all sources belongs to none. The targets within reach of a source are
found through a grid.

*M-step*  The field is :math:`v = B a`, with a basis for which :math:`B B^T` approximates the
coherence kernel :math:`G_{ij} = e^{-d_{ij}^2 / 2\beta^2}` (Nystroem's method: a few vertices far
apart, their kernel's eigenvectors, extended to all vertices), so that the penalty
:math:`\frac{\lambda}{2} \mathrm{tr}(W^T G W)` of :math:`v = G W` is
:math:`\frac{\lambda}{2}\|a\|^2` and the step is a small system:

.. math:: \left( B^T D B + \lambda\sigma^2 I \right) a = B^T (P X - D Y),
   \qquad D = \mathrm{diag}(P 1)

The distance d may be Euclidean, or along the surface of a template mesh (`depth_pose.paper.coherence`): then
limbs that touch stay independent, and one basis serves all poses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import InputError
from depth_pose.core.farthest_points import farthest_rows
from depth_pose.paper import _cpd_kernels as kernels
from depth_pose.paper.tuning import CpdTuning

Array = NDArray[np.float64]

LEAST_EIGENVALUE = 1e-6
"""Least eigenvalue of a basis direction, as a share of the largest, for the pipeline's stiff fields."""


@dataclass(frozen=True)
class CpdResult:
    """Result of a registration.

    Attributes
    ----------
    moved : (M, 3) float64
        The moved source points, metres.
    probability : (M,) float64
        ``P1``: number of target points that correspond to each source point.
    target_mean : (M, 3) float64
        ``PX / P1``: mean of the corresponding target points, metres; the moved point if there
        are none.
    sigma : float
        Final standard deviation, metres.
    explained : float
        Share of the target points that are not outliers.
    iterations : int
    """

    moved: Array
    probability: Array
    target_mean: Array
    sigma: float
    explained: float
    iterations: int


def register(
    source: Array, target: Array, tuning: CpdTuning = CpdTuning(), basis: Array | None = None
) -> CpdResult:
    """Move source points onto target points, coherently.

    Parameters
    ----------
    source : (M, 3) float64
        Points to move, metres.
    target : (N, 3) float64
        Points to reach, metres, in the same frame.
    tuning : CpdTuning
    basis : (M, K) float64, optional
        Basis of displacement fields (`euclidean_basis` of the source if not given).

    Returns
    -------
    CpdResult

    Raises
    ------
    InputError
        If an array has the wrong shape, is empty, or is not finite.
    """
    source, target = _points(source, "source"), _points(target, "target")
    if basis is None:
        basis = euclidean_basis(source, tuning.basis_points, tuning.beta)
    elif basis.ndim != 2 or len(basis) != len(source):
        raise InputError(f"the basis has shape {basis.shape}, not ({len(source)}, K)")
    origin = target.mean(axis=0)
    moved, residual = np.empty_like(source), np.empty_like(source)
    p1 = np.empty(len(source))
    w = tuning.outlier_weight
    settings = kernels.DriftSettings(
        stiffness=float(tuning.stiffness),
        sigma2=float(tuning.sigma_start) ** 2,
        floor2=float(tuning.sigma_floor) ** 2,
        outlier_factor=float(w / (1 - w) * len(source) / len(target)),
        tolerance=float(tuning.tolerance),
        most=tuning.max_iterations,
    )
    sigma2, explained, iterations = kernels.drift(
        source - origin,
        target - origin,
        np.ascontiguousarray(basis, np.float64),
        settings,
        moved,
        p1,
        residual,
    )
    moved += origin
    return CpdResult(
        moved=moved,
        probability=p1,
        target_mean=moved + residual / np.maximum(p1, 1e-12)[:, None],
        sigma=float(np.sqrt(sigma2)),
        explained=float(explained),
        iterations=int(iterations),
    )


def _points(points: Array, name: str) -> Array:
    points = np.ascontiguousarray(points, np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) == 0:
        raise InputError(f"the {name} points have shape {points.shape}, not (count, 3)")
    if not np.isfinite(points).all():
        raise InputError(f"the {name} points are not all finite; leave out missing measurements")
    return points


def euclidean_basis(points: Array, count: int, beta: float, least: float = LEAST_EIGENVALUE) -> Array:
    """Compute a basis of smooth displacement fields of a point set, from Euclidean distances.

    Parameters
    ----------
    points : (M, 3) float64
        Metres.
    count : int
        Number of points from which the kernel is approximated.
    beta : float
        Width of the Gaussian kernel, metres.
    least : float
        As for `nystroem_basis`.

    Returns
    -------
    (M, K) float64
        ``B`` with ``B B^T`` approximately the kernel matrix; K at most ``count``.
    """
    points = np.ascontiguousarray(points, np.float64)
    chosen = farthest_rows(points, count)
    distances = np.linalg.norm(points[:, None] - points[chosen], axis=2)
    return nystroem_basis(distances, chosen, beta, least)


def nystroem_basis(
    distances: Array, chosen: NDArray[np.int64], beta: float, least: float = LEAST_EIGENVALUE
) -> Array:
    """Compute a low-rank factor of a Gaussian kernel matrix from some of its columns.

    Parameters
    ----------
    distances : (M, C)
        Distance of every point from the chosen ones, metres.
    chosen : (C,)
        Indices of the chosen points.
    beta : float
        Width of the kernel, metres.
    least : float
        Directions below this share of the largest eigenvalue are dropped. A direction
        matters while its eigenvalue is not small against ``lambda sigma^2``: soft fields need more.

    Returns
    -------
    (M, K) float64
    """
    columns = np.exp(-0.5 * (distances / beta) ** 2)
    among = columns[chosen]
    values, vectors = np.linalg.eigh(0.5 * (among + among.T))
    keep = values > least * values[-1]
    return np.asarray(columns @ (vectors[:, keep] / np.sqrt(values[keep])))
