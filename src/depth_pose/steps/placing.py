"""Place exemplars at the input, correct them by their rendering, and score them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.canonical import CanonicalAxes
from depth_pose.body.body import Body
from depth_pose.geometry import matrix_to_quat
from depth_pose.render import Observation
from depth_pose.skeleton import NODE_PARENTS
from depth_pose.steps import _match_kernels as kernels
from depth_pose.types import Candidate


@dataclass(frozen=True)
class ExemplarViews:
    """Poses, and how each of their views lies in canonical axes.

    Attributes
    ----------
    numbers : (N,) int64
        Number of each pose in the bank.
    pose_quats : (N, 21, 4) float32
        Segment rotations, model frame, x y z w.
    view_quats : (N, W, 4) float32
        ``R_canonical_model``.
    view_origins : (N, W, 3) float32
        Point of the model, pelvis at the origin, that comes to lie at the axes' origin, metres.
    """

    numbers: NDArray[np.int64]
    pose_quats: NDArray[np.float32]
    view_quats: NDArray[np.float32]
    view_origins: NDArray[np.float32]


@dataclass(frozen=True)
class Nearest:
    """Entries of views (pose * views + view), and their distances in the subspace."""

    entries: NDArray[np.int64]
    distances: NDArray[np.float32]


@dataclass(frozen=True)
class Placed:
    """An exemplar placed at the input, and its nodes (21, 3) in the camera frame, metres."""

    candidate: Candidate
    nodes: NDArray[np.float64]


def place_exemplars(
    body: Body,
    views: ExemplarViews,
    nearest: Nearest,
    axes: CanonicalAxes,
    scale: float,
    observed: Observation,
    band: float,
) -> list[Placed]:
    """Place exemplars at the input, correct their translations by their rendering, score them."""
    camera, skin = observed.camera, body.sparse_weights
    count, width = len(nearest.entries), views.view_quats.shape[1]
    scores, rotations = np.empty(count), np.empty((count, 3, 3))
    translations, nodes = np.empty((count, 3)), np.empty((count, len(body.nodes), 3))
    kernels.score_exemplars(
        nearest.entries, views.pose_quats, views.view_quats, views.view_origins,
        axes.rotation, axes.origin, scale,
        body.vertices, body.nodes, NODE_PARENTS, skin.nodes, skin.weights, body.faces,
        observed.depth, observed.labels, camera.fx, camera.fy, camera.cx, camera.cy,
        band, scores, rotations, translations, nodes,
    )  # fmt: skip
    quats = matrix_to_quat(rotations)
    return [
        Placed(
            Candidate(
                exemplar=int(views.numbers[entry // width]),
                view=int(entry % width),
                quat_xyzw=quats[k],
                translation=translations[k],
                distance=float(nearest.distances[k]),
                score=float(scores[k]),
            ),
            nodes[k],
        )
        for k, entry in enumerate(nearest.entries.tolist())
    ]
