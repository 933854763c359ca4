r"""Depth of the joints below the clothes, from the finder's proposals.

From the front the visible surface does not distinguish a deep trunk from one that stands a little nearer:
under a coat the fitted trunk lies 2 to 7 cm in front of the true one. The joint net is trained on
joints of people in clothes, and the median over frames of the depth difference to its trunk joints is right
within 2 cm. With :math:`d` that depth, :math:`r` the derivative of the trunk's skin toward the camera by
breadth and depth, and :math:`z = d - r^T x` the depth that the trunk lacks according to the proposals,

.. math:: \Lambda \leftarrow \Lambda + w\, r r^T, \qquad b \leftarrow b + w\, d\, r, \qquad
   w = \frac{(2 o)^2}{v\; r^T \Lambda^{-1} r}, \qquad o = \max(0, z - z_0):

one more observation of the build (`refine.personal`). The weight assumes that the skin has the error :math:`2
o` and the proposals the variance :math:`v`. Up to :math:`z_0` only the skin counts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.build import BUILD_NAMES, BuildSpace
from depth_pose.body.pose import FittedBody
from depth_pose.core.rotations import length_of
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES, NODE_INDEX
from depth_pose.refine.proposed_bones import FIRST_FRAMES
from depth_pose.refine.running_median import Bins
from depth_pose.refine.upright_stance import SUREST, Standing
from depth_pose.track.state import Histogram

Array = NDArray[np.float64]

_JOINTS = [JOINT_INDEX[joint] for joint in ("pelvis", "spine", "chest", "neck", "left_hip", "right_hip")]
_NODES = np.asarray(JOINT_NODES)[_JOINTS]
_SEGMENTS = [NODE_INDEX[node] for node in ("pelvis", "spine", "chest")]
_GIRTHS = [BUILD_NAMES.index(girth) for girth in ("trunk_breadth", "trunk_depth")]
_ROW = [1 + girth for girth in _GIRTHS]

_BELIEVED_M = 0.05
"""Missing depth (m) above which proposals count (:math:`z_0`); lower values harm people near the camera."""

_ERROR_M = 0.012
"""Standard deviation (m) of the proposed trunk depth of one person; measured 11 to 15 mm."""

DEPTHS = Bins(1, -0.3, 0.005, 140)
"""Histogram of the depths: 5 mm steps from -30 to 40 cm."""


class TrunkDepth(NamedTuple):
    """Proposed depth of the trunk's joints in one frame.

    Attributes
    ----------
    depth : float
        Metres below the skin, less the same depth of the bank's body at that size.
    row : (14,) float64
        Derivative by log size and build, metres; 0 for the size.
    sure : float
        Weight of the frame, 0 to 1.
    """

    depth: float
    row: Array
    sure: float


class TrunkSkin:
    """The trunk's skin, from which depths are measured.

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
        """Compute the depth of a frame's proposed joints in a fitted body with this build, (13,)."""
        nodes, pose, weights = fitted.nodes[_NODES], fitted.pose, standing.weights[_JOINTS]
        ray = nodes.mean(axis=0)
        ray /= length_of(ray)
        deeper = (standing.places[_JOINTS] - nodes) @ ray
        back = -(ray @ pose.rotations)[self._segment]  # direction to the camera in each segment's rest frame
        facing = np.maximum((self._normals * back).sum(axis=1), 0.0)
        row = np.zeros(1 + len(BUILD_NAMES))
        row[_ROW] = pose.scale * ((self._moves * back).sum(axis=2) @ facing) / facing.sum()
        depth = float(weights @ deeper / max(weights.sum(), 1e-9) + row[1:] @ build)
        return TrunkDepth(depth, row, standing.sure * (float(weights.mean()) / SUREST) ** 2)


def observe_depth(told: Histogram, row_sum: Array, information: Array, vector: Array) -> tuple[Array, Array]:
    """Add the missing depth to what is known of log size and build.

    Parameters
    ----------
    told : Histogram
        Of `DEPTHS`, over the person's frames.
    row_sum : (14,) float64
        Weighted sum of `TrunkDepth.row`.
    information, vector : (14, 14), (14,) float64
        Information on log size and build, and that times the value.

    Returns
    -------
    tuple of (14, 14), (14,) float64
    """
    total = float(told.total[0])
    if total < FIRST_FRAMES:
        return information, vector
    row, depth = row_sum / total, float(DEPTHS.medians(told)[0])
    solved = np.linalg.solve(information, np.array([vector, row]).T)
    objects = max(0.0, depth - float(row @ solved[:, 0]) - _BELIEVED_M)
    weight = (2.0 * objects / _ERROR_M) ** 2 / float(row @ solved[:, 1])
    return information + weight * np.outer(row, row), vector + weight * depth * row
