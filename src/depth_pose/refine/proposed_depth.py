r"""How deep inside their clothes people are, as the finder proposes their joints.

From the front nothing in the skin tells a deep trunk from one that stands a little nearer: under a coat the
fitted trunk lies 2 to 7 cm before the true one. The finder's second look learned joints of people in clothes;
the median over frames of how much deeper its joints of the trunk lie is right within 2 cm. With :math:`d`
that depth, :math:`r` how the trunk's skin moves towards the camera with its breadth and depth, and
:math:`z = d - r^T x` what proposals find lacking of the trunk's depth,

.. math:: \Lambda \leftarrow \Lambda + w\, r r^T, \qquad b \leftarrow b + w\, d\, r, \qquad
   w = \frac{(2 o)^2}{v\; r^T \Lambda^{-1} r}, \qquad o = \max(0, z - z_0):

one more observation of the build (`refine.personal`), weighted as one of two witnesses, of whom skin
errs by :math:`2 o`, and proposals have the variance :math:`v`. Within :math:`z_0` skin is believed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.build import BUILD_NAMES, BuildSpace
from depth_pose.body.pose import FittedBody
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES, NODE_INDEX
from depth_pose.refine.proposed_bones import FIRST_FRAMES
from depth_pose.refine.running_median import RunningMedian
from depth_pose.refine.upright_stance import SUREST, Standing

Array = NDArray[np.float64]

_JOINTS = [JOINT_INDEX[joint] for joint in ("pelvis", "spine", "chest", "neck", "left_hip", "right_hip")]
_NODES = np.asarray(JOINT_NODES)[_JOINTS]
_SEGMENTS = [NODE_INDEX[node] for node in ("pelvis", "spine", "chest")]
_GIRTHS = [BUILD_NAMES.index(girth) for girth in ("trunk_breadth", "trunk_depth")]
_ROW = [1 + girth for girth in _GIRTHS]

_BELIEVED_M = 0.05
"""Proposals object above this, metres. With .03 simulated people in clothes gain 3 mm more, but joints of
real people near the camera move away (docs/method.md)."""

_ERROR_M = 0.012
"""Standard deviation of the proposed depth of one person's trunk, metres; 11 to 15 mm are measured."""

_NEAREST_M, _STEP_M, _STEPS = -0.3, 0.005, 140
"""Depths are counted in steps of 5 mm, up to 40 cm."""


class TrunkDepth(NamedTuple):
    """How deep proposals see the trunk's joints.

    Attributes
    ----------
    depth : float
        Metres below the skin, less that of the bank's body at the same size.
    row : (14,) float64
        Metres that a build adds to it; the size, the first, is not told by it.
    sure : float
        How much the frame counts, 0 to 1.
    """

    depth: float
    row: Array
    sure: float


class TrunkSkin:
    """The skin of the trunk, of which depths are measured.

    Parameters
    ----------
    space : BuildSpace
    """

    def __init__(self, space: BuildSpace) -> None:
        body = space.template
        segment = np.argmax(body.weights, axis=1)
        own = np.isin(segment, _SEGMENTS)
        self._segment, self._normals = segment[own], body.normals[own]
        self._moves = space.vertices[_GIRTHS][:, own]

    def measure(self, standing: Standing, fitted: FittedBody, build: NDArray[np.float32]) -> TrunkDepth:
        """Give how deep a frame's proposals see the joints of a fitted body, (13,) its build."""
        nodes, pose, weights = fitted.nodes[_NODES], fitted.pose, standing.weights[_JOINTS]
        ray = nodes.mean(axis=0)
        ray /= np.linalg.norm(ray)
        deeper = (standing.places[_JOINTS] - nodes) @ ray
        back = -(ray @ pose.rotations)[self._segment]  # the way to the camera, in each segment's rest frame
        facing = np.maximum((self._normals * back).sum(axis=1), 0.0)
        row = np.zeros(1 + len(BUILD_NAMES))
        row[_ROW] = pose.scale * ((self._moves * back).sum(axis=2) @ facing) / facing.sum()
        depth = float(weights @ deeper / max(weights.sum(), 1e-9) + row[1:] @ build)
        return TrunkDepth(depth, row, standing.sure * (float(weights.mean()) / SUREST) ** 2)


class ProposedDepth:
    """Proposed depth of one person's trunk: the weighted median over frames."""

    def __init__(self) -> None:
        self._told = RunningMedian(1, _NEAREST_M, _STEP_M, _STEPS)
        self._row = np.zeros(1 + len(BUILD_NAMES))

    def forget(self, kept: float) -> None:
        """Keep a share of what earlier frames proposed."""
        self._told.forget(kept)
        self._row *= kept

    def add(self, told: TrunkDepth) -> None:
        """Add what a frame proposes."""
        self._told.add(np.array([told.depth]), np.array([told.sure]))
        self._row += told.sure * told.row

    def observe(self, information: Array, vector: Array) -> tuple[Array, Array]:
        """Add what proposals find lacking to what is known of log size and build, (14, 14) and (14,)."""
        total = float(self._told.total[0])
        if total < FIRST_FRAMES:
            return information, vector
        row, depth = self._row / total, float(self._told.medians()[0])
        told = np.linalg.solve(information, np.stack([vector, row], axis=1))
        objects = max(0.0, depth - float(row @ told[:, 0]) - _BELIEVED_M)
        weight = (2.0 * objects / _ERROR_M) ** 2 / float(row @ told[:, 1])
        return information + weight * np.outer(row, row), vector + weight * depth * row
