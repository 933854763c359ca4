"""People's fitted bodies, posed again from their skeletons."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.body.build import BuildSpace
from depth_pose.core.result import Skeleton
from depth_pose.refine.skeleton_pose import pose_from_skeleton


class BodyMaker:
    """Poses the bank's body, in each person's size and build, by their skeletons.

    This needs nothing from the nodes: a viewer that shows bodies costs them no time.
    """

    def __init__(self, bank: Path) -> None:
        self._space = BuildSpace(Bank.load(bank).body)

    def __call__(self, skeleton: Skeleton) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """Return vertices (V, 3) in the skeleton's frame, metres, and faces (F, 3)."""
        body = self._space.body(skeleton.build)
        pose = pose_from_skeleton(body, skeleton)
        return body.pose(pose.rotations, pose.root, pose.scale).vertices, body.faces
