"""The functions of `depth_pose.core.odds` for compiled loops."""

from __future__ import annotations

from depth_pose.core import odds
from depth_pose.core.kernels import njit

logistic = njit(cache=True)(odds.logistic)
