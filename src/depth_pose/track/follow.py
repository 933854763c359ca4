"""Followed person: one of the people in view, kept as long as it is visible."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from depth_pose.core.config import FollowConfig
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.track.state import MEMORY_NS

_PELVIS = JOINT_INDEX["pelvis"]


class Follower:
    """Chooses the person published on ``/depth_pose/skeleton``."""

    def __init__(self, config: FollowConfig) -> None:
        self.config = config
        self.reset()

    def reset(self) -> None:
        """Follow nobody."""
        self._body_id = ""
        self._seen_ns = 0

    def choose(self, skeletons: Sequence[Skeleton], stamp_ns: int, frame_id: str) -> Skeleton:
        """Return the followed person's skeleton, or a lost one.

        Parameters
        ----------
        skeletons : sequence of Skeleton
            All skeletons of the frame.
        stamp_ns, frame_id
            Stamp and frame id of the frame.
        """
        for skeleton in skeletons:
            if self._body_id and skeleton.body_id == self._body_id:
                self._seen_ns = stamp_ns
                return skeleton
        is_awaited = self._body_id and 0 <= stamp_ns - self._seen_ns <= MEMORY_NS
        if not skeletons or (is_awaited and self.config.patient):
            return Skeleton.lost(stamp_ns, frame_id)
        chosen = min(skeletons, key=self._rank)
        self._body_id, self._seen_ns = chosen.body_id, stamp_ns
        return chosen

    def _rank(self, skeleton: Skeleton) -> float:
        """Return the rank of a skeleton; the least is followed."""
        x, y, z = skeleton.positions[_PELVIS]
        if self.config.whom == "nearest":
            return float(np.linalg.norm([x, y, z]))
        if self.config.whom == "centre":
            return float(abs(np.arctan2(x, z)))
        number = skeleton.body_id.rpartition("_")[2]  # ids of other programs may have no number
        return float(number) if number.isdecimal() else float("inf")  # the first track
