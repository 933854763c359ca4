"""Compiled scores of poses (`depth_pose.refine.objective` has the equation), and fits from many starts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.body._skin_kernels import skin
from depth_pose.body.rendered_depth import SCORE_BAND_M, Observation
from depth_pose.core._raster_kernels import score_mesh
from depth_pose.core.kernels import njit
from depth_pose.core.skeleton import JOINT_NODES
from depth_pose.refine._aim_kernels import mean_deviation
from depth_pose.refine._articulated_kernels import fit
from depth_pose.refine._plausible_kernels import excess

_FARTHEST = 5.0
"""Maximum distance that counts between a joint and the measured one, standard deviations; 8 is the same."""


class Criteria(NamedTuple):
    """What the poses of one person in one frame are scored by.

    Attributes
    ----------
    observed : Observation
        The half-resolution window.
    places, sigmas : (J, 3), (J, 2) float32
        The measured joints and their deviations, metres; no rows without a measurement.
    mean, whiten : (57,), (57, 57) float64
        The pose prior's (`depth_pose.refine.pose_prior.PosePrior`).
    proposal_error, prior_excess : float
        Weights of the terms (`depth_pose.refine.objective.Weights`).
    """

    observed: Observation
    places: NDArray[np.float32]
    sigmas: NDArray[np.float32]
    mean: NDArray[np.float64]
    whiten: NDArray[np.float64]
    proposal_error: float
    prior_excess: float


@njit(cache=True)
def score_body(criteria, vertices, faces, nodes, scale, score):
    """Render a posed body, and write its score: `Score`, as (5,)."""
    zbuffer, seen = np.empty(criteria.observed.depth.shape, np.float32), np.empty(5)
    score_mesh(vertices, faces, criteria.observed, SCORE_BAND_M, zbuffer, seen)
    joints, proposal_error, open_share = nodes[JOINT_NODES], 0.0, 1.0
    if criteria.places.shape[0] > 0:
        proposal_error = mean_deviation(joints, criteria.places, criteria.sigmas, _FARTHEST)
        open_share = min(1.0, proposal_error)
    prior_excess = open_share * excess(joints, scale, criteria.mean, criteria.whiten)
    score[0] = seen[0] + criteria.proposal_error * proposal_error + criteria.prior_excess * prior_excess
    score[1], score[2], score[3], score[4] = seen[0], seen[1], proposal_error, prior_excess


class Fits(NamedTuple):
    """Fits from several starts (S), which the arrays of the poses hold before.

    Attributes
    ----------
    rotations, roots, scales : (S, 21, 3, 3), (S, 3), (S,) float64
        The poses.
    vertices, nodes : (S, V, 3), (S, 21, 3) float64
        Of the whole skin.
    scores : (S, 5) float64
        `depth_pose.refine.objective.Score`.
    """

    rotations: NDArray[np.float64]
    roots: NDArray[np.float64]
    scales: NDArray[np.float64]
    vertices: NDArray[np.float64]
    nodes: NDArray[np.float64]
    scores: NDArray[np.float64]


@njit(cache=True)
def fit_best(target, body, settings, glance, rough, skinned, criteria, count, fits):
    """Fit roughly the ``count`` starts that are best after a glance; return the number of the best fit.

    Each fit poses the whole skin and is scored. Without levels for a glance the first starts are fitted.
    """
    starts = fits.scales.shape[0]
    glances, best = np.zeros(starts), -1
    for k in range(0 if glance.shape[0] > 0 else starts, starts + min(count, starts)):
        is_glance = k < starts
        s = k if is_glance else int(np.argmin(glances))
        rotations, root, scale = fits.rotations[s], fits.roots[s], fits.scales[s]
        vertices, nodes, score = fits.vertices[s], fits.nodes[s], fits.scores[s]
        fit(target, body, settings, glance if is_glance else rough, scale, rotations, root)
        skin(skinned, rotations, root, scale, vertices, nodes)
        score_body(criteria, vertices, skinned.faces, nodes, scale, score)
        if is_glance:
            glances[s] = score[0]
        else:
            glances[s] = np.inf
            if best < 0 or score[0] < fits.scores[best, 0]:
                best = s
    return best
