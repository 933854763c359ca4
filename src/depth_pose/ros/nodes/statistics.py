"""Counts and times of a node for its diagnostics: rate, latency, drops by reason, values of its stage."""

from __future__ import annotations

import time
from collections import Counter, deque

import numpy as np

WINDOW = 256
"""Number of frames for medians and percentiles."""

MAX_LATENCY_S = 5.0
"""A stamp older than this, or from the future, is not from the node's clock."""


class NodeStatistics:
    """Counts and times of one node; plain Python, no ROS."""

    def __init__(self) -> None:
        self.answered = 0
        self.drops: Counter[str] = Counter()
        self.counts: Counter[str] = Counter()
        self.values: dict[str, float] = {}
        self._latency_s: deque[float] = deque(maxlen=WINDOW)
        self._process_s: deque[float] = deque(maxlen=WINDOW)
        self._times: deque[float] = deque(maxlen=WINDOW)
        self._reported: Counter[str] = Counter()

    def answer(self, process_s: float, latency_s: float) -> None:
        """Count an answered frame.

        Parameters
        ----------
        process_s : float
            Time the node spent on it, seconds.
        latency_s : float
            Node's clock minus stamp, seconds; left out if implausible.
        """
        self.answered += 1
        self._times.append(time.monotonic())
        self._process_s.append(process_s)
        if 0.0 <= latency_s <= MAX_LATENCY_S:
            self._latency_s.append(latency_s)
        else:
            self._latency_s.clear()

    def drop(self, reason: str, count: int = 1) -> None:
        """Count frames without an answer."""
        self.drops[reason] += count

    def rate_hz(self) -> float:
        """Answers per second over the last two seconds."""
        since = time.monotonic() - 2.0
        return sum(t >= since for t in self._times) / 2.0

    def new_drops(self) -> Counter[str]:
        """Return the drops since the last call."""
        new = self.drops - self._reported
        self._reported = self.drops.copy()
        return new

    def as_text(self) -> dict[str, str]:
        """Return all of it as the key-value pairs of a ``DiagnosticStatus``."""
        out = {
            "rate_hz": f"{self.rate_hz():.1f}",
            "answered": str(self.answered),
            "dropped": str(sum(self.drops.values())),
        }
        for name, window in (("process_ms", self._process_s), ("latency_ms", self._latency_s)):
            for which, q in (("median", 50), ("p95", 95)):
                known = f"{1e3 * np.percentile(window, q):.1f}" if window else "unknown"
                out[f"{name}_{which}"] = known
        out |= {f"dropped: {reason}": str(n) for reason, n in sorted(self.drops.items())}
        out |= {name: str(n) for name, n in sorted(self.counts.items())}
        out |= {name: f"{value:.4g}" for name, value in sorted(self.values.items())}
        return out
