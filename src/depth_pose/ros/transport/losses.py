"""Where a frame went that a sensor sent and a node never saw: the node was busy, or the transport lost it."""

from __future__ import annotations

import os
from collections import deque
from typing import Any

from depth_pose.ros import PROFILE_VARIABLE

BUSY_TIMES_KEPT = 64
"""Busy times that are remembered, two seconds' worth at 30 frames a second."""

_SLACK_NS = 5_000_000
"""A frame that came so shortly before or after a busy time may have come within it. Set by hand."""

_MOST_LOOKED_FOR = 1000
"""Of more frames that are missing, as after hours without a network, the rest was never there."""


def cure() -> str:
    """Return the advice against lost frames: on one machine, more shared memory for the driver."""
    return (
        f"start the sensor's driver with {PROFILE_VARIABLE}={os.environ[PROFILE_VARIABLE]}, for larger "
        "segments of shared memory (on another machine: docs/topics.md, Two machines)"
    )


class BusyTimes:
    """When a node was busy with a frame, nanoseconds of the system's clock; plain Python, no ROS."""

    def __init__(self) -> None:
        self._times: deque[tuple[int, int]] = deque(maxlen=BUSY_TIMES_KEPT)

    def add(self, begin_ns: int, end_ns: int) -> None:
        """Record the time of a frame."""
        self._times.append((begin_ns, end_ns))

    def covers(self, moment_ns: int) -> bool:
        """Whether the node was busy at a moment."""
        return any(begin <= moment_ns <= end for begin, end in self._times)


def count_lost(before: dict[str, Any], after: dict[str, Any], busy: BusyTimes) -> tuple[int, int]:
    """Distinguish messages missed by a busy node from those lost in transport.

    A message that comes while the node waits is taken at once; one that comes while it is busy is lost to the
    next where the queue holds one. Those between two that were taken are thought of as sent at equal
    distances, and as long under way as the later of the two.

    Parameters
    ----------
    before, after : mapping
        What rclpy tells of two messages of one publisher, taken one after the other:
        ``publication_sequence_number``, ``source_timestamp`` and ``received_timestamp`` (nanoseconds).
    busy : BusyTimes

    Returns
    -------
    busy, transport : int
        How many were missed because the node was busy, and how many the transport lost.
    """
    missing = after["publication_sequence_number"] - before["publication_sequence_number"] - 1
    sent_ns = before["source_timestamp"]
    step_ns = (after["source_timestamp"] - sent_ns) // (missing + 1)
    flight_ns = after["received_timestamp"] - after["source_timestamp"]
    while_busy = sum(
        any(busy.covers(sent_ns + k * step_ns + flight_ns + off) for off in (-_SLACK_NS, 0, _SLACK_NS))
        for k in range(1, min(missing, _MOST_LOOKED_FOR) + 1)
    )
    return while_busy, missing - while_busy
