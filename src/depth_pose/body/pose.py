"""Poses of the skinned body, as passed between matching, fitting and recovery."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.skeleton import JOINT_NODES, Nodes, Source


@dataclass(frozen=True)
class BodyPose:
    """A pose of the body in the camera frame.

    Attributes
    ----------
    rotations : (21, 3, 3) float64
        Segment rotations, rest pose to camera frame.
    root : (3,) float64
        Pelvis, metres.
    scale : float
        Size relative to the bank's body.
    """

    rotations: NDArray[np.float64]
    root: NDArray[np.float64]
    scale: float


@dataclass(frozen=True)
class FittedBody:
    """A pose, and the mesh (V, 3) and nodes (21, 3) found for it, camera frame, metres."""

    pose: BodyPose
    vertices: NDArray[np.float64]
    nodes: Nodes


@dataclass(frozen=True)
class Fitted:
    """The body fitted to one person in one frame.

    Attributes
    ----------
    body_id : str
    stamp_ns : int
    source : Source
        REFINED, RECOVERED, or LOST where there was nothing to start from.
    body : FittedBody or None
        None where it is lost.
    build : (13,) float32
        The person's proportions (`depth_pose.body.build.BUILD_NAMES`).
    score : float
        Rendered-depth disagreement (`depth_pose.body.rendered_depth`), 0 to 1; 1 where it is lost.
    mean_depth_error : float
        Mean depth difference where body and person overlap, metres.
    """

    body_id: str
    stamp_ns: int
    source: Source
    body: FittedBody | None
    build: NDArray[np.float32]
    score: float
    mean_depth_error: float

    @classmethod
    def lost(cls, stamp_ns: int, body_id: str) -> Fitted:
        """Return the answer for a person without a pose."""
        return cls(body_id, stamp_ns, Source.LOST, None, np.zeros(0, np.float32), 1.0, 0.0)

    @cached_property
    def pose(self) -> BodyPose:
        """The fitted pose.

        Raises
        ------
        ValueError
            Where the person is lost.
        """
        return self._known.pose

    @cached_property
    def nodes(self) -> Nodes:
        """The body's nodes (21, 3), camera frame, metres."""
        return self._known.nodes

    @cached_property
    def joints(self) -> NDArray[np.float64]:
        """Joint centres (19, 3) (`depth_pose.core.skeleton.JOINTS`), camera frame, metres."""
        return self.nodes[JOINT_NODES]

    @property
    def is_lost(self) -> bool:
        """Whether no pose is known."""
        return self.body is None

    @cached_property
    def _known(self) -> FittedBody:
        if self.body is None:
            raise ValueError(f"{self.body_id} has no pose in this frame")
        return self.body
