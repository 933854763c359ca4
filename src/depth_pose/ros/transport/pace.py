"""Whether the nodes keep up with the sensor: one line a minute where they do not."""

from __future__ import annotations

import math

FIRST_S, EVERY_S = 10.0, 60.0
"""Seconds of the first window, so that a slow machine is named soon, and of each later one."""

_ENOUGH = 0.9
"""Share of the sensor's frames that must be answered."""


class Pace:
    """Counts of frames that began and were answered since the last line."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Begin anew."""
        self._since_s, self._window_s = math.nan, FIRST_S
        self._begun = self._answered = self._busy = 0

    def begin(self) -> None:
        """Count a frame that went to the next node."""
        self._begun += 1

    def arrive(self) -> None:
        """Count a frame whose skeletons were published."""
        self._answered += 1

    def look(self, busy: int, now_s: float) -> str:
        """Return a line at the end of a window in which too few frames were answered, otherwise nothing.

        Parameters
        ----------
        busy : int
            Frames that this node has ever left out because it, or one after it, was busy.
        now_s : float
            Monotonic clock; called once a second.
        """
        sent = self._begun + busy - self._busy
        if math.isnan(self._since_s) or not sent:  # a window begins with its first frame
            self._since_s, self._busy = now_s, busy
        took_s = now_s - self._since_s
        if took_s < self._window_s:
            return ""
        answered = self._answered or self._begun  # without a recovery node nobody says what was answered
        self._since_s, self._window_s, self._busy = now_s, EVERY_S, busy
        self._begun = self._answered = 0
        if answered >= _ENOUGH * sent:
            return ""
        return (
            f"this machine is too slow for the sensor: {answered / took_s:.1f} of {sent / took_s:.1f} frames "
            f"a second were answered in {took_s:.0f} s, the newest ones; a zone, fewer people "
            "(segment.most_people) or a lower frame rate of the driver help: docs/small_computers.md"
        )
