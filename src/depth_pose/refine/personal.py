r"""Personal builds: a person's size and proportions, accumulated over the frames of a track.

After the final fit of a frame the residuals that posed the body (`depth_pose.refine.articulated`) are
linearised once more by pose :math:`\theta`, logarithm of the size and build :math:`x = (\log s, \beta)`, as
in M. Ye and R. Yang, *Real-time simultaneous pose and shape estimation for articulated objects using a single
depth camera* (CVPR 2014). There each frame solves for both. Here the pose belongs to the frame and is
marginalised out; the rest is added to the information on the person,

.. math:: \Lambda = \Lambda_{xx} - \Lambda_{x\theta} \Lambda_{\theta\theta}^{-1} \Lambda_{\theta x}, \qquad
   b = g_x - \Lambda_{x\theta} \Lambda_{\theta\theta}^{-1} g_\theta + \Lambda x_0,

so that a parameter is learned only from poses that determine it: a thigh's length is not observable where the
whole leg could as well be turned or shifted. The sums over frames, with slow exponential forgetting, and the
prior of `depth_pose.body.build` give the build,

.. math:: x = (\Lambda_{prior} + \sum \Lambda)^{-1} (\Lambda_{prior}\, x_{prior} + \sum b).

Only distances along the skin's normal count. The tangential distance to the nearest points is small for every
length and would confirm any build. The remaining bias of each parameter is corrected by `_LACKING`. Clothes
make people look larger and nearer; the finder's joint proposals measure by how much
(`depth_pose.refine.proposed_bones`, `depth_pose.refine.proposed_depth`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.body.build import BUILD_NAMES, MOST, BuildSpace, prior_information
from depth_pose.body.build_file import KnownBuild
from depth_pose.body.pose import BodyPose
from depth_pose.core.skeleton import NODE_PARENTS
from depth_pose.refine import _build_kernels as kernels
from depth_pose.refine._articulated_kernels import USUAL_POINTS
from depth_pose.refine.articulated import ArticulatedFitter
from depth_pose.refine.proposed_bones import LENGTHS, BoneLengths, ProposedBones
from depth_pose.refine.proposed_depth import DEPTHS, TrunkDepth, observe_depth
from depth_pose.refine.running_median import forget
from depth_pose.refine.tuning import BuildTuning, FitTuning
from depth_pose.track.state import Shape
from depth_pose.track.target import FitTarget

Array = NDArray[np.float64]


_SIZE_SPREAD = 0.03
"""Standard deviation of the logarithm of the matcher's size; its grid has steps of 4 %."""

_GIVEN_SPREAD = 1e-4
"""Standard deviation of the logarithm of a configured size."""

_LEAST_SPREAD = 0.01
"""Least standard deviation of a build from a file: people dress differently."""

_STEP = 0.004
"""A new body is built (about 1 ms) once a parameter differs by more than this from the build in use."""

_FIRST_FRAMES = 3.0
"""Number of well-fitting frames before a learned build is used; early poses are least certain."""

_FITS_WELL = 0.2
"""Rendered-depth disagreement (0 to 1) above which a frame's weight falls, by the fourth power of the
ratio."""

_EVERY_NS, _KNOWN_EVERY_NS, _KNOWN_FRAMES = 60_000_000, 200_000_000, 20
"""Least time between learning updates (ns), and the same once this number of frames has been used: six sets
of simulated people come out the same as with the first time throughout."""

_FOOT = BUILD_NAMES.index("foot")
"""Index of the foot's length, which follows the other bones: noise and shoes bias the foot's points."""


_LACKING = {
    "neck_head": 0.010,
    "shoulder_width": 0.006,
    "hip_width": -0.007,
    "upper_arm": 0.008,
    "forearm": 0.011,
    "thigh": 0.014,
}
"""Bias of each learned parameter, as a share, from smoothing, noise and the fit; measured on 36 simulated
people."""

BUILD_BIAS = np.array([0.0, *(_LACKING.get(part, 0.0) for part in BUILD_NAMES)])
"""`_LACKING` as a vector (14,) of log size and build, added to the measured values."""


def _lies_below() -> NDArray[np.bool_]:
    """Return for each node (row) whether it equals or lies below another one (column), (21, 21)."""
    below = np.eye(len(NODE_PARENTS), dtype=bool)
    for n, parent in enumerate(NODE_PARENTS):
        if parent >= 0:
            below[n] |= below[parent]
    return below


_LIES_BELOW = _lies_below()


class Evidence(NamedTuple):
    """A frame's evidence on log size and build, (14,).

    Its information (14, 14), and the information times the value, (14,).
    """

    information: Array
    vector: Array


class Proposed(NamedTuple):
    """Evidence of proposed joints on a build: bone lengths, and depth of the trunk."""

    bones: BoneLengths
    depth: TrunkDepth


class BuildEvidence:
    """Computes the evidence of fitted frames on a person's build.

    Parameters
    ----------
    space : BuildSpace
    tuning : BuildTuning
    fit : FitTuning
        Constants of the fit that supplies the residuals.
    """

    def __init__(self, space: BuildSpace, tuning: BuildTuning, fit: FitTuning) -> None:
        self._fitter = ArticulatedFitter(space.template, fit)
        self._shapes = kernels.Shapes(
            np.ascontiguousarray(space.vertices.transpose(1, 2, 0)),
            np.ascontiguousarray(space.nodes.transpose(1, 2, 0)),
        )
        self._sigma = tuning.sigma
        self._settings = self._fitter.settings._replace(
            free_space_weight=tuning.free_space * fit.free_space_weight
        )

    def find(self, body: Body, target: FitTarget, pose: BodyPose, build: NDArray[np.float32]) -> Evidence:
        """Linearise the residuals of a fitted body.

        Parameters
        ----------
        body : Body
            The body of ``build``.
        target : FitTarget
            The data that it was fitted to.
        pose : BodyPose
        build : (13,) float32
        """
        articulation, settings = self._fitter.of(body).articulation, self._settings
        parts = len(BUILD_NAMES)
        nodes = np.empty(body.nodes.shape)
        sums = kernels.Sums(np.zeros((len(nodes), 6, 8 + parts)), np.zeros((1 + parts, 2 + parts)))
        own = kernels.Pose(pose.rotations, pose.root, pose.scale)
        kernels.add_up(target, articulation, self._shapes, own, settings, self._sigma, nodes, sums)
        sums.motion[:, :, 7 + _FOOT] = sums.build[1 + _FOOT] = sums.build[:, 1 + _FOOT] = 0.0
        motions = _segment_motions(articulation.free, nodes - pose.root)
        moved = (sums.motion[:, :, :6].transpose(0, 2, 1) @ motions).reshape(-1, motions.shape[2])
        rows = motions.reshape(moved.shape)
        joint = rows.T @ sums.motion[:, :, 6:].reshape(len(rows), -1)
        inertia = rows.T @ moved
        hold = np.full(len(inertia), settings.damping)
        hold[3:] += settings.prior * np.repeat(articulation.stiffness, 3)
        inertia[np.diag_indices_from(inertia)] += len(target.points) / USUAL_POINTS * hold
        left = sums.build - joint[:, :-1].T @ np.linalg.solve(inertia, joint)
        x = np.concatenate([[np.log(pose.scale)], build]) + BUILD_BIAS
        return Evidence(left[:, :-1], left[:, -1] + left[:, :-1] @ x)


def _segment_motions(free: NDArray[np.int64], nodes: Array) -> Array:
    """Compute each segment's rotation and shift of the root by pose parameter, (21, 6, 3 + 3 F)."""
    turning = free >= 0
    turned, moves = np.nonzero(_LIES_BELOW & turning)  # pairs of segment and node that rotates it
    (x, y, z), first = nodes[moves].T, 3 + 3 * free[moves]
    out = np.zeros((len(nodes), 6, 3 + 3 * int(turning.sum())))
    out[:, [3, 4, 5], [0, 1, 2]] = 1.0
    for a in range(3):
        out[turned, a, first + a] = 1.0
    out[turned, 3, first + 1], out[turned, 3, first + 2] = -z, y
    out[turned, 4, first], out[turned, 4, first + 2] = z, -x
    out[turned, 5, first], out[turned, 5, first + 1] = -y, x
    return out


class PersonalBuilds:
    """Estimates size and proportions from the evidence on one person (`Shape`).

    Parameters
    ----------
    tuning : BuildTuning
    space : BuildSpace
    known : KnownBuild, optional
        Previous estimate; the prior of adults by default.
    """

    def __init__(self, tuning: BuildTuning, space: BuildSpace, known: KnownBuild | None = None) -> None:
        self._tuning = tuning
        self._prior, self._prior_vector = np.zeros((_SIZE, _SIZE)), np.zeros(_SIZE)
        if known is None:
            self._prior[1:, 1:] = prior_information()
        else:
            spread = np.maximum([known.scale_spread, *known.spread], _LEAST_SPREAD)
            self._prior = np.diag(spread**-2)
            self._prior_vector = self._prior @ [np.log(known.scale), *known.build]
        self._bones, self._is_known = ProposedBones(space), known is not None

    def take_size(self, shape: Shape, scale: float, is_given: bool) -> Shape:
        """Begin a frame with the matcher's size, and update size and build in use.

        They follow the best estimate in steps, so that bodies are rarely rebuilt.

        Parameters
        ----------
        shape : Shape
        scale : float
            Size found by the matcher, one more observation.
        is_given : bool
            Whether the size is configured and fixed.
        """
        if shape.bones is None:
            shape = _begun(shape)
        told = (_GIVEN_SPREAD if is_given else _SIZE_SPREAD) ** -2, float(np.log(scale)), is_given
        given = (told, shape.stamp_ns)
        shape = shape._replace(told=told)
        if given == shape.solved_at:
            return shape
        x = self._solve(shape)[0]
        now = np.concatenate([[np.log(shape.scale)], shape.build]) if shape.scale > 0.0 else np.inf
        if np.abs(x - now).max() > _STEP:
            shape = shape._replace(scale=float(np.float32(np.exp(x[0]))), build=x[1:].astype(np.float32))
        return shape._replace(solved_at=given)

    def add(
        self,
        shape: Shape,
        stamp_ns: int,
        score: float,
        evidence: Evidence | None,
        proposed: Proposed | None = None,
    ) -> Shape:
        """Add a frame's evidence; earlier evidence decays slowly.

        Parameters
        ----------
        shape : Shape
            After `take_size`.
        stamp_ns : int
        score : float
            Rendered-depth disagreement of the fitted body; a higher one lowers the weight.
        evidence : Evidence or None
            None if the frame fits too badly.
        proposed : Proposed, optional
            None if the person does not stand. Does not depend on the quality of the fit.
        """
        assert shape.bones is not None and shape.depth is not None, "a size comes before any evidence"
        kept = 1.0
        if shape.stamp_ns is not None:
            kept = float(np.exp((shape.stamp_ns - stamp_ns) * 1e-9 / self._tuning.memory))
        bones, depth, row = forget(shape.bones, kept), forget(shape.depth, kept), kept * shape.depth_row
        if proposed is not None:
            lengths, deep = proposed
            bones = LENGTHS.add(bones, lengths.lengths, lengths.sure)
            depth = DEPTHS.add(depth, np.array([deep.depth]), np.array([deep.sure]))
            row = row + deep.sure * deep.row
        shape = shape._replace(
            stamp_ns=stamp_ns,
            information=kept * shape.information,
            vector=kept * shape.vector,
            bones=bones,
            depth=depth,
            depth_row=row,
        )
        if evidence is None:
            return shape
        share = min(1.0, _FITS_WELL / max(score, 1e-9)) ** 4
        return shape._replace(
            information=shape.information + share / self._tuning.noise**2 * evidence.information,
            vector=shape.vector + share / self._tuning.noise**2 * evidence.vector,
            frames=shape.frames + 1,
            weight=shape.weight + share,
        )

    def known(self, shape: Shape) -> KnownBuild:
        """Return the best estimate and its uncertainty, after the first frame."""
        x, total = self._solve(shape)
        spread = np.sqrt(np.diag(np.linalg.inv(total)))
        return KnownBuild(float(np.exp(x[0])), float(spread[0]), x[1:], spread[1:], shape.frames)

    def _solve(self, shape: Shape) -> tuple[Array, Array]:
        """Solve for log size and build, (14,), and their total information, (14, 14).

        Evidence from the skin is excluded until enough frames support it.
        """
        assert shape.bones is not None and shape.depth is not None, "a size comes before any evidence"
        total, vector = self._prior.copy(), self._prior_vector.copy()
        if self._is_known or shape.weight >= _FIRST_FRAMES:
            total += shape.information
            vector += shape.vector
        weight, size, is_given = shape.told
        total[0, 0] += weight
        vector[0] += weight * size
        observed = observe_depth(shape.depth, shape.depth_row, total, vector)
        x: Array = np.asarray(np.linalg.solve(*observed), np.float64)
        x[1:] = np.clip(x[1:], -MOST, MOST)
        if not is_given:
            x[0] -= self._bones.excess(shape.bones, x)
        return x, total


_SIZE = 1 + len(BUILD_NAMES)
"""Parameters: log size and build."""


def is_due(shape: Shape, stamp_ns: int) -> bool:
    """Check that the last frame with evidence is long enough ago; adjacent frames are redundant."""
    every_ns = _EVERY_NS if shape.frames < _KNOWN_FRAMES else _KNOWN_EVERY_NS
    return shape.stamp_ns is None or stamp_ns - shape.stamp_ns >= every_ns


def _begun(shape: Shape) -> Shape:
    """Return a shape with the average build and no evidence."""
    return shape._replace(
        build=np.zeros(len(BUILD_NAMES), np.float32),
        information=np.zeros((_SIZE, _SIZE)),
        vector=np.zeros(_SIZE),
        bones=LENGTHS.empty(),
        depth=DEPTHS.empty(),
        depth_row=np.zeros(_SIZE),
    )
