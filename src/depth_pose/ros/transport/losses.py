"""Causes of frames that were sent but never received: the node was busy, or the transport lost them."""

from __future__ import annotations

import os
from collections import deque
from typing import Any

from depth_pose.ros import PROFILE_VARIABLE

BUSY_TIMES_KEPT = 64
"""Number of busy times remembered, two seconds' worth at 30 frames a second."""

_SLACK_NS = 5_000_000
"""A frame this close to a busy time may have arrived within it."""

_MOST_LOOKED_FOR = 1000
"""Maximum number of missing frames that are attributed, as after hours without a network."""


def packet_loss_advice() -> str:
    """Return advice for lost frames (same host: a larger shared-memory segment)."""
    return (
        f"start the sensor's driver with {PROFILE_VARIABLE}={os.environ[PROFILE_VARIABLE]}, for larger "
        "segments of shared memory (on another machine: docs/topics.md, Two machines)"
    )


class BusyTimes:
    """Times when a node was busy with a frame or its settings, nanoseconds of the system's clock; no ROS."""

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

    A message that arrives while the node waits is received at once; one that arrives while it is busy is
    displaced by the next, as the queue holds one. Messages between two received ones are assumed to be sent
    at equal intervals, with the transport time of the later one.

    Parameters
    ----------
    before, after : mapping
        Info from rclpy on two messages of one publisher, received one after the other:
        ``publication_sequence_number``, ``source_timestamp`` and ``received_timestamp`` (nanoseconds).
    busy : BusyTimes

    Returns
    -------
    busy, transport : int
        Number missed because the node was busy, and number lost in transport.
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
