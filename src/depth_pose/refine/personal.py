r"""Personal builds: a person's size and proportions, gathered over the frames in which they are followed.

After the final fit of a frame the same residuals that posed the body (`depth_pose.refine.articulated`) are
linearised once more by pose :math:`\theta`, logarithm of the size and build :math:`x = (\log s, \beta)`,
as in M. Ye and R. Yang, *Real-time simultaneous pose and shape estimation for articulated objects using a
single depth camera* (CVPR 2014). There each frame solves for both; here the pose is the frame's own and is
marginalised out, and what is left adds to the information on the person,

.. math:: \Lambda = \Lambda_{xx} - \Lambda_{x\theta} \Lambda_{\theta\theta}^{-1} \Lambda_{\theta x}, \qquad
   b = g_x - \Lambda_{x\theta} \Lambda_{\theta\theta}^{-1} g_\theta + \Lambda x_0,

so that a part is only learned from poses that tell it: a thigh's length does not show where the whole leg
could as well be turned or shifted. Sums of them over frames, slowly forgotten, and the prior of
`depth_pose.body.build` give the build,

.. math:: x = (\Lambda_{prior} + \sum \Lambda)^{-1} (\Lambda_{prior}\, x_{prior} + \sum b).

Only distances along the skin's normal count: the distance to the nearest points along the skin is small
however wrong a length is, and would call every build right. What frames say too little of a part even so is
added, `_LACKING`. Clothes make people look larger and nearer than they are; how much they do is told by the
joints that the finder proposes (`depth_pose.refine.proposed_bones`, `depth_pose.refine.proposed_depth`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.body.build import BUILD_NAMES, MOST, BuildSpace, prior_information
from depth_pose.body.build_file import KnownBuild
from depth_pose.body.pose import BodyPose
from depth_pose.core.config import FitConfig, PersonalConfig
from depth_pose.core.skeleton import NODE_PARENTS
from depth_pose.refine import _build_kernels as kernels
from depth_pose.refine._articulated_kernels import USUAL_POINTS
from depth_pose.refine.articulated import ArticulatedFitter
from depth_pose.refine.proposed_bones import BoneLengths, ProposedBones
from depth_pose.refine.proposed_depth import ProposedDepth, TrunkDepth
from depth_pose.track.target import FitTarget

Array = NDArray[np.float64]


_SIZE_SPREAD = 0.03
"""Standard deviation of the logarithm of the matcher's size: its grid has steps of 4 %."""

_GIVEN_SPREAD = 1e-4
"""The same where the size is given."""

_LEAST_SPREAD = 0.01
"""A build from a file is not taken to be surer than this: people dress differently."""

_STEP = 0.004
"""The build in use follows once a part differs by more than this: a body is made anew, in about 1 ms."""

_FIRST_FRAMES = 3.0
"""A build is not used before so many frames that fit well told it: the first poses are least sure, and a
body that has adapted to a wrong one makes the right one look worse. Of 2 and 3 (docs/method.md)."""

_FITS_WELL = 0.2
"""Frames that disagree more than this, 0 to 1, say less of a build: the fourth power of what this is of their
disagreement. People in the open have 0.15 to 0.25, people in bed or behind a desk 0.3 to 0.4."""

_EVERY_NS = 60_000_000
"""Builds are learned from at most every so many nanoseconds, so that it takes less than 1 ms a frame."""

_FOOT = BUILD_NAMES.index("foot")
"""The foot's length is not learned from points: noise eats toes and soles, shoes add to them. It goes with
the other bones."""


_LACKING = {
    "neck_head": 0.010,
    "shoulder_width": 0.006,
    "hip_width": -0.007,
    "upper_arm": 0.008,
    "forearm": 0.011,
    "thigh": 0.014,
}
"""What frames say too little of each part, as a share: smoothing, noise and the fit's spread round limbs off.

With these, bones of 36 people of our own come out as long as they are, on the median; forearms and thighs
were 2 and 2.3 % short (docs/method.md)."""

_LACK = np.array([0.0, *(_LACKING.get(part, 0.0) for part in BUILD_NAMES)])
"""The same of log size and build, (14,)."""


def _lies_below() -> NDArray[np.bool_]:
    """Tell of each node (rows) whether it is another one (columns) or lies below it, (21, 21)."""
    below = np.eye(len(NODE_PARENTS), dtype=bool)
    for n, parent in enumerate(NODE_PARENTS):
        if parent >= 0:
            below[n] |= below[parent]
    return below


_LIES_BELOW = _lies_below()


class Evidence(NamedTuple):
    """What a frame says of log size and build: information (14, 14), and that times the value, (14,)."""

    information: Array
    vector: Array


class Proposed(NamedTuple):
    """What proposed joints say of a build: lengths of bones, and how deep the trunk is."""

    bones: BoneLengths
    depth: TrunkDepth


class BuildEvidence:
    """Finds what fitted frames say of a person's build.

    Parameters
    ----------
    space : BuildSpace
    config : PersonalConfig
    fit : FitConfig
        Settings of the fit whose residuals they are.
    """

    def __init__(self, space: BuildSpace, config: PersonalConfig, fit: FitConfig) -> None:
        self._fitter = ArticulatedFitter(space.template, fit)
        self._shapes = kernels.Shapes(
            np.ascontiguousarray(space.vertices.transpose(1, 2, 0)),
            np.ascontiguousarray(space.nodes.transpose(1, 2, 0)),
        )
        self._sigma = config.sigma
        self._settings = self._fitter.settings._replace(
            free_space_weight=config.free_space * fit.free_space_weight
        )

    def find(self, body: Body, target: FitTarget, pose: BodyPose, build: NDArray[np.float32]) -> Evidence:
        """Linearise the residuals of a fitted body.

        Parameters
        ----------
        body : Body
            That of ``build``.
        target : FitTarget
            What it was fitted to.
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
        x = np.concatenate([[np.log(pose.scale)], build]) + _LACK
        return Evidence(left[:, :-1], left[:, -1] + left[:, :-1] @ x)


def _segment_motions(free: NDArray[np.int64], nodes: Array) -> Array:
    """Motion of each segment, turn and shift of the root, by each parameter of the pose, (21, 6, 3 + 3 F)."""
    turning = free >= 0
    turned, moves = np.nonzero(_LIES_BELOW & turning)  # which segments turn about which nodes
    (x, y, z), first = nodes[moves].T, 3 + 3 * free[moves]
    out = np.zeros((len(nodes), 6, 3 + 3 * int(turning.sum())))
    out[:, [3, 4, 5], [0, 1, 2]] = 1.0
    for a in range(3):
        out[turned, a, first + a] = 1.0
    out[turned, 3, first + 1], out[turned, 3, first + 2] = -z, y
    out[turned, 4, first], out[turned, 4, first + 2] = z, -x
    out[turned, 5, first], out[turned, 5, first + 1] = -y, x
    return out


class PersonalBuild:
    """What is known of one person's size and build.

    Parameters
    ----------
    config : PersonalConfig
    space : BuildSpace
    known : KnownBuild, optional
        What was known before; else people are like other adults.

    Attributes
    ----------
    frames : int
        Frames that said something.
    build : (13,) float32
        The build in use; it follows the best estimate in steps, so that bodies are seldom made anew.
    scale : float
        The size that goes with it, as float32; 0 before the first frame.
    """

    def __init__(self, config: PersonalConfig, space: BuildSpace, known: KnownBuild | None = None) -> None:
        self._config = config
        size = 1 + len(BUILD_NAMES)
        self._information, self._vector = np.zeros((size, size)), np.zeros(size)
        self._prior, self._prior_vector = np.zeros((size, size)), np.zeros(size)
        if known is None:
            self._prior[1:, 1:] = prior_information()
        else:
            spread = np.maximum([known.scale_spread, *known.spread], _LEAST_SPREAD)
            self._prior = np.diag(spread**-2)
            self._prior_vector = self._prior @ [np.log(known.scale), *known.build]
        self._bones, self._depth = ProposedBones(space), ProposedDepth()
        self._stamp_ns: int | None = None
        self._solved_for: tuple[tuple[float, float], bool, int | None] | None = None
        self._is_known = known is not None
        self.frames, self._told = 0, 0.0
        self.build = np.zeros(len(BUILD_NAMES), np.float32)
        self.scale = 0.0

    def take_size(self, scale: float, is_given: bool) -> None:
        """Begin a frame with the matcher's size, and bring the build in use up to date.

        Parameters
        ----------
        scale : float
            As the matcher found it, one more thing that is known.
        is_given : bool
            Whether it was not found but given, and is to be kept.
        """
        self._size = (_GIVEN_SPREAD if is_given else _SIZE_SPREAD) ** -2, float(np.log(scale))
        self._is_given = is_given
        given = (self._size, is_given, self._stamp_ns)
        if given == self._solved_for:
            return
        self._solved_for = given
        x = self._solve()[0]
        now = np.concatenate([[np.log(self.scale)], self.build]) if self.scale > 0.0 else np.inf
        if np.abs(x - now).max() > _STEP:
            self.scale, self.build = float(np.float32(np.exp(x[0]))), x[1:].astype(np.float32)

    def _is_used(self) -> bool:
        return self._is_known or self._told >= _FIRST_FRAMES

    def is_due(self, stamp_ns: int) -> bool:
        """Tell whether the last frame that said something is long enough ago: neighbours say the same."""
        return self._stamp_ns is None or stamp_ns - self._stamp_ns >= _EVERY_NS

    def add(
        self, stamp_ns: int, score: float, evidence: Evidence | None, proposed: Proposed | None = None
    ) -> None:
        """Add what a frame says; what earlier ones said is slowly forgotten.

        Parameters
        ----------
        stamp_ns : int
        score : float
            Rendered-depth disagreement of the fitted body: how little the evidence counts.
        evidence : Evidence or None
            None where the frame fits too badly to say anything.
        proposed : Proposed, optional
            None where nobody stands. It does not depend on how well the body fits.
        """
        if self._stamp_ns is not None:
            kept = float(np.exp((self._stamp_ns - stamp_ns) * 1e-9 / self._config.memory))
            self._information *= kept
            self._vector *= kept
            self._bones.forget(kept)
            self._depth.forget(kept)
        self._stamp_ns = stamp_ns
        if proposed is not None:
            self._bones.add(proposed.bones)
            self._depth.add(proposed.depth)
        if evidence is None:
            return
        share = min(1.0, _FITS_WELL / max(score, 1e-9)) ** 4
        self._information += share / self._config.noise**2 * evidence.information
        self._vector += share / self._config.noise**2 * evidence.vector
        self.frames += 1
        self._told += share

    def known(self) -> KnownBuild:
        """Give the best estimate and its uncertainty; once there was a frame."""
        x, total = self._solve()
        spread = np.sqrt(np.diag(np.linalg.inv(total)))
        return KnownBuild(float(np.exp(x[0])), float(spread[0]), x[1:], spread[1:], self.frames)

    def _solve(self) -> tuple[Array, Array]:
        """Best estimate of log size and build, (14,), and all information on it, (14, 14).

        What skin says is left out while it is not used.
        """
        total, vector = self._prior.copy(), self._prior_vector.copy()
        if self._is_used():
            total += self._information
            vector += self._vector
        weight, size = self._size
        total[0, 0] += weight
        vector[0] += weight * size
        x: Array = np.asarray(np.linalg.solve(*self._depth.observe(total, vector)), np.float64)
        x[1:] = np.clip(x[1:], -MOST, MOST)
        if not self._is_given:
            x[0] -= self._bones.excess(x)
        return x, total
