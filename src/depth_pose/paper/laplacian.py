r"""Laplacian completion: deform a whole mesh by the correspondences of its visible part (Ye et al. eq. 7).

.. math:: \hat M = \arg\min_M \|L M - L M_l\|^2 + \sum_{k \in I} w_k \|m_k - x_k\|^2

with L the cotangent Laplacian (U. Pinkall and K. Polthier, *Computing discrete minimal surfaces and their
conjugates*, Experimental Mathematics 2, 1993), the posed exemplar :math:`M_l`, and input points :math:`x_k`
that correspond to its vertices. The unknown is the deformed vertex in both terms (the paper prints the
exemplar's in the second).

Only differences enter the first term, so it is solved for the displacement :math:`U = M - M_l`,

.. math:: (L^T L + D)\, U = D (X - M_l), \qquad D = \mathrm{diag}(w_k)

and L is needed only on the domain of the displacement field. It is taken from the body's *rest* mesh: a posed
limb is the rest limb moved rigidly, so cotangents differ only around the joints, and the matrix, its ordering
and the pattern of its Cholesky factor are prepared once per body. Each frame changes only the diagonal D; the
values of the factor are recomputed exactly, without iteration. Where nothing corresponds, :math:`U` is as
smooth as a thin plate.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from depth_pose.core.errors import InputError
from depth_pose.refine import _cholesky_kernels as kernels

Array = NDArray[np.float64]

_HOLD = 1e-9
"""Weight on the whole mesh, which makes the system regular where nothing corresponds."""


class LaplacianCompleter:
    """Completes one body's meshes; all data that is constant between frames is prepared here.

    Parameters
    ----------
    vertices : (V, 3) float64
        Rest mesh, metres.
    faces : (F, 3) int
    """

    def __init__(self, vertices: Array, faces: NDArray[np.integer]) -> None:
        laplacian = cotangent_laplacian(vertices, faces)
        matrix = (laplacian.T @ laplacian).tocsc()
        n = len(vertices)
        guess = splu(
            (matrix + sparse.identity(n)).tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        self._order = np.argsort(guess.perm_c)
        ordered = matrix[self._order][:, self._order].tocsc()
        ordered.sort_indices()
        first, rows = ordered.indptr.astype(np.int64), ordered.indices.astype(np.int32)
        self._matrix = kernels.Matrix(first, rows, ordered.data)
        row_first, row_cols = kernels.factor_pattern(first, rows, kernels.elimination_tree(first, rows))
        col_first, col_rows, place = kernels.columns_of_rows(row_first, row_cols)
        self._pattern = kernels.Pattern(row_first, row_cols, place, col_first, col_rows)
        self._factor = kernels.Factor(np.empty(len(row_cols)), np.empty(n))

    def complete(self, vertices: Array, targets: Array, weights: Array) -> Array:
        """Deform a posed mesh toward corresponding points: Ye et al. eq. 7.

        Parameters
        ----------
        vertices : (V, 3) float64
            The posed mesh :math:`M_l`, metres.
        targets : (V, 3) float64
            The point that corresponds to each vertex, metres; any finite value where none does.
        weights : (V,) float64
            Weight w of each correspondence, 0 where there is none.

        Returns
        -------
        (V, 3) float64
            The deformed mesh; the posed one if no weight is above 0.
        """
        n = len(self._order)
        if vertices.shape != (n, 3) or targets.shape != (n, 3) or weights.shape != (n,):
            raise InputError(
                f"mesh {vertices.shape}, targets {targets.shape} and weights {weights.shape} "
                f"do not belong to a body of {n} vertices"
            )
        w = weights[self._order]
        right = w[:, None] * (targets - vertices)[self._order]
        # Ye et al. eq. 7: its normal equations, solved for the displacement of every vertex
        kernels.factorise(self._matrix, w + _HOLD, self._pattern, self._factor)
        kernels.substitute(self._pattern, self._factor, right)
        out = np.empty_like(right)
        out[self._order] = right
        return np.asarray(vertices + out)


def cotangent_laplacian(vertices: Array, faces: NDArray[np.integer]) -> sparse.csr_matrix:
    r"""Compute the cotangent Laplacian of a mesh.

    Parameters
    ----------
    vertices : (V, 3) float64
    faces : (F, 3) int

    Returns
    -------
    (V, V) sparse
        :math:`(L f)_i = \sum_j \tfrac12 (\cot\alpha_{ij} + \cot\beta_{ij}) (f_i - f_j)`.
    """
    rows, cols, values = [], [], []
    for k in range(3):
        i, j, o = faces[:, k], faces[:, (k + 1) % 3], faces[:, (k + 2) % 3]
        a, b = vertices[i] - vertices[o], vertices[j] - vertices[o]
        twice_area = np.linalg.norm(np.cross(a, b), axis=1)
        if (twice_area <= 0).any():
            raise InputError(f"face {int(np.argmin(twice_area))} of the mesh has no area")
        half_cotangent = 0.5 * np.einsum("ij,ij->i", a, b) / twice_area
        rows += [i, j]
        cols += [j, i]
        values += [half_cotangent, half_cotangent]
    n = len(vertices)
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(cols)))
    weights = sparse.csr_matrix(entries, shape=(n, n))
    return sparse.csr_matrix(sparse.diags(np.asarray(weights.sum(axis=1)).ravel()) - weights)
