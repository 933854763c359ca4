r"""Articulated fit: the pose of a skinned body that explains a partial cloud best.

In the manner of Ye and Yang, *Real-time simultaneous pose and shape estimation for articulated objects using
a single depth camera* (CVPR 2014). The visible vertices :math:`v_m(\theta)` of the posed body are the centres
of a Gaussian mixture with one variance and an outlier class; the points :math:`x_n` are samples of it. Each
iteration does

*E-step*  :math:`p_{mn} = e^{-\|x_n - v_m\|^2 / 2\sigma^2} / (u + \sum_k e^{-\|x_n - v_k\|^2 / 2\sigma^2})`

*M-step*  one damped Gauss-Newton step on

.. math:: \sum_m P_m \left[ a\,(n_m \cdot (v_m - y_m))^2 + b\,\|v_m - y_m\|^2 \right]
   + E_{free} + E_{joints} + E_{floor} + E_{prior}, \qquad
   P_m = \sum_n p_{mn},\; y_m = \sum_n p_{mn} x_n / P_m

with a variance that decreases from coarse to fine. :math:`E_{free}` keeps vertices out of space that was seen
to be free: beside the silhouette, and in front of the observed surface. :math:`E_{joints}` takes the finder's
proposals :math:`q_j` of the joints :math:`x_j(\theta)` as observations,

.. math:: E_{joints} = w\,\sigma^2 \sum_j \rho_j\, (x_j - q_j)^T C_j^{-1} (x_j - q_j), \qquad
   C_j = (\sigma_{j\perp}^2 + \sigma_0^2)(1 - d_j d_j^T) + (\sigma_{j\parallel}^2 + \sigma_0^2)\, d_j d_j^T

with the deviations that the joint net states across and along the ray :math:`d_j`, a floor :math:`\sigma_0`
for what all frames of a person have in common, and the robust weights :math:`\rho_j` of Geman and McClure
(*Statistical methods for tomographic image reconstruction*, 1987). The factor :math:`\sigma^2` states them in
the units of the mixture, whose own :math:`1 / \sigma^2` is left out: proposals decide more at the coarse
stages, and where there are no points, as under a desk or beyond the image's border. Where points share noise,
:math:`w` is larger (`depth_pose.refine.noise`). Backs of heels, vertices
of the skin, are observed alike; an ankle and its heel count half each. :math:`E_{floor}` takes
the heights of the soles above the floor, where it is known, as observations of 0, in the same units and with
the same robust weights: balls of feet near it stand on it, and heels, which may be raised, are not below it.
:math:`E_{prior}` keeps each joint near the start, and each ankle near the rest pose, least about its hinge.
The parameters are a translation and, for every free node, a rotation vector in the camera frame that turns
the whole subtree: a vertex moves by :math:`\delta t + \sum_k \omega_k \times (v_m - p_k)`, summed over the
free nodes above the segment that moves it most. All vertices of a segment therefore share one 6 x 6 matrix of
a free rigid motion, and the normal equations of the joint angles are assembled from those 21 (the composite
rigid body algorithm of M. Walker and D. Orin, *Efficient dynamic computer simulation of robotic mechanisms*,
1982).
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.body.feet import find_balls, find_heels, heel_vertices
from depth_pose.body.pose import BodyPose
from depth_pose.core.skeleton import NODE_INDEX, NODE_PARENTS, NODES
from depth_pose.refine import _articulated_kernels as kernels
from depth_pose.refine._tree_kernels import Articulation, Feet
from depth_pose.refine.tuning import FitTuning
from depth_pose.track.target import FitTarget

_STIFFNESS: dict[str, float] = {
    "pelvis": 0.0,
    "spine": 1.0,
    "chest": 1.0,
    "neck": 1.0,
    "clavicle": 3.0,
    "shoulder": 0.1,
    "elbow": 0.1,
    "wrist": 2.0,
    "hip": 0.1,
    "knee": 0.1,
    "ankle": 0.3,
}
"""Relative stiffness of each free node toward the start; other nodes follow their parent. Set by hand:
parts that depth shows poorly (collar bones, hands, feet) are stiff."""

_NEUTRAL: dict[str, tuple[float, float, float]] = {"ankle": (0.2, 2.0, 2.0)}
"""Relative stiffness of a free node toward the rest pose, about its parent's x, y and z: an ankle is a hinge
about the first, and turns little about the shank and about the foot. Chosen on development clips."""


class FitCost(NamedTuple):
    """Sums of weighted squares (m^2), by term of the module's equation; the prior is in the information."""

    points: float
    free_space: float
    joints: float
    floor: float


class FitResult(NamedTuple):
    """A fitted pose, and the normal equations of the last iteration.

    Attributes
    ----------
    pose : BodyPose
    cost : FitCost
        Before the last step.
    information : (P, P) float64
        Information on the translation (1/m^2) and on each free node's rotation (1/rad^2), with the prior.
    step : (P,) float64
        The last step, metres and radians: near 0 where the fit has converged.
    iterations : int
    points : int
        Number of the cloud's points.
    """

    pose: BodyPose
    cost: FitCost
    information: NDArray[np.float64]
    step: NDArray[np.float64]
    iterations: int
    points: int

    @property
    def last_turn(self) -> float:
        """Largest rotation of the last step, radians."""
        return float(np.abs(self.step[3:]).max())


class Levels(NamedTuple):
    """Standard deviations of the iterations of each stage, metres: `FitTuning`, by the same names."""

    glance: NDArray[np.float64]
    rough: NDArray[np.float64]
    fine: NDArray[np.float64]


class ArticulatedFitter:
    """Fits one body; all data that is constant between frames is prepared here."""

    def __init__(self, body: Body, tuning: FitTuning = FitTuning()) -> None:
        self.body = body
        self.tuning = tuning
        self.articulation = articulate(body, _STIFFNESS, _NEUTRAL)
        numbers = {n: float(getattr(self.tuning, n)) for n in kernels.Settings._fields if n != "root_prior"}
        self.settings = kernels.Settings(root_prior=0.0, **numbers)
        self.levels = Levels(*(np.array(getattr(tuning, name)) for name in Levels._fields))

    def of(self, body: Body) -> ArticulatedFitter:
        """Return the same fitter for another build of its body."""
        if body is self.body:
            return self
        other = copy(self)
        other.body = body
        other.articulation = self.articulation._replace(skin=body.skin, normals=body.normals)
        return other

    def fit(self, target: FitTarget, start: BodyPose, sigmas: tuple[float, ...] | None = None) -> FitResult:
        """Fit the body's pose to a cloud.

        Parameters
        ----------
        target : FitTarget
        start : BodyPose
        sigmas : tuple of float, optional
            Standard deviation of each iteration, metres, in place of the configured ones.

        Returns
        -------
        FitResult
        """
        levels = np.array(self.tuning.sigmas if sigmas is None else sigmas)
        rotations, root = start.rotations.copy(), start.root.copy()
        cost, matrix, step = kernels.fit(
            target, self.articulation, self.settings, levels, start.scale, rotations, root
        )
        return FitResult(
            pose=BodyPose(rotations, root, start.scale),
            cost=FitCost(*cost.tolist()),
            information=matrix / levels[-1] ** 2,
            step=step,
            iterations=len(levels),
            points=len(target.points),
        )


def articulate(
    body: Body,
    stiffness: Mapping[str, float],
    neutral: Mapping[str, tuple[float, float, float]] | None = None,
) -> Articulation:
    """Prepare a body for fits of its pose.

    Parameters
    ----------
    body : Body
    stiffness : mapping
        Relative stiffness toward the start of each free node, by its name without the side.
    neutral : mapping, optional
        The same toward the rest pose, about the axes of the node's parent.
    """
    free = np.full(len(NODES), -1)
    kinds: list[str] = []
    for name, node in NODE_INDEX.items():
        kind = name.split("_")[-1]
        if kind in stiffness:
            free[node] = len(kinds)
            kinds.append(kind)
    to_start = np.array([stiffness[kind] for kind in kinds])
    to_rest = np.array([(neutral or {}).get(kind, (0.0, 0.0, 0.0)) for kind in kinds])
    above = _parameters_above(free)
    return Articulation(body.skin, body.normals, free, above, to_start, to_rest, _find_feet(body))


def _find_feet(body: Body) -> Feet:
    lowest = [(part, False) for part in find_balls(body)] + [(part, True) for part in find_heels(body)]
    return Feet(
        np.array([v for part, _ in lowest for v in part], np.int64),
        np.array([is_heel for part, is_heel in lowest for _ in part], np.bool_),
        np.array([1.0 / len(part) for part, _ in lowest for _ in part]),
        heel_vertices(body),
        np.array([NODE_INDEX["left_ankle"], NODE_INDEX["right_ankle"]]),
    )


def _parameters_above(free: NDArray[np.int64]) -> NDArray[np.int64]:
    """Find the number of each parameter's next one toward the root (`Articulation.above`)."""
    above = [-1, 0, 1]
    last = np.full(len(free), 2)  # the last parameter of each node, or of its nearest free ancestor
    for node, parent in enumerate(NODE_PARENTS):
        if parent >= 0:
            last[node] = last[parent]
        if free[node] >= 0:
            first = 3 + 3 * int(free[node])
            above += [int(last[node]), first, first + 1]
            last[node] = first + 2
    return np.array(above)
