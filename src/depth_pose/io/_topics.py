"""Topics and messages of a recording, for any format."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

MCAP_MAGIC = b"\x89MCAP0\r\n"
DB3_MAGIC = b"SQLite format 3\x00"
BAG_MAGIC = b"#ROSBAG V2.0\n"
MAGICS = (MCAP_MAGIC, DB3_MAGIC, BAG_MAGIC)
"""First bytes of the supported recordings."""

MOST_WAITING = 256 << 20
"""Maximum bytes of messages waiting for earlier ones in overlapping chunks: two chunks."""

MAX_CHUNK = 128 << 20
"""Maximum bytes of a chunk or a message, compressed or not: twice the largest accepted image."""


@dataclass(frozen=True)
class Topic:
    """A topic of a recording.

    Attributes
    ----------
    name, kind : str
        Its name and message type.
    count : int
        Number of messages, from the recording's index.
    definition : str
        The type's definition; empty if the recording has none.
    qos : str
        QoS of its publishers, as rosbag2 writes it (YAML); empty if the recording has none.
    """

    name: str
    kind: str
    count: int
    definition: str = ""
    qos: str = ""


@dataclass(frozen=True)
class RawMessage:
    """One recorded message: CDR bytes and log time, nanoseconds."""

    topic: str
    log_time_ns: int
    data: bytes


def counted(count: int, what: str) -> str:
    """Format a count with its noun, for instance ``3 messages``."""
    return f"{count} {what}{'' if count == 1 else 's'}"


class Place(NamedTuple):
    """Location of messages in a file: a chunk, or a run of messages outside chunks.

    Attributes
    ----------
    first_ns, last_ns : int
        Log times.
    start, end : int
        Offsets in the file.
    channels : frozenset of int or None
        Channels with messages there; None if unknown.
    is_chunk : bool
    """

    first_ns: int
    last_ns: int
    start: int
    end: int
    channels: frozenset[int] | None
    is_chunk: bool = True


def in_order(places: Iterable[Place], read: Callable[[Place], Iterable[RawMessage]]) -> Iterator[RawMessage]:
    """Yield the messages of all places by log time; equal times in file order.

    If more than `MOST_WAITING` bytes wait in overlapping places, the earliest messages are yielded.

    Parameters
    ----------
    places : iterable of Place
    read : callable
        Returns a place's messages; called after all earlier messages were yielded.
    """
    waiting: list[tuple[int, int, int, RawMessage]] = []
    held = 0
    for place in sorted(places, key=lambda p: (p.first_ns, p.start)):
        while waiting and (waiting[0][0] < place.first_ns or held > MOST_WAITING):
            message = heapq.heappop(waiting)[3]
            held -= len(message.data)
            yield message
        for i, message in enumerate(read(place)):
            waiting.append((message.log_time_ns, place.start, i, message))
            held += len(message.data)
        heapq.heapify(waiting)
    while waiting:
        yield heapq.heappop(waiting)[3]


class DamageError(Exception):
    """Unreadable data in a recording; the text completes a sentence after 'because'."""


class RecordingFile(Protocol):
    """One file of a recording, in any format."""

    @property
    def topics(self) -> list[Topic]:
        """Readable topics."""

    @property
    def others(self) -> dict[str, str]:
        """Unreadable topics, with the reasons."""

    def messages(self, topics: Iterable[str]) -> Iterator[RawMessage]:
        """Yield the topics' messages by log time."""

    @property
    def damage(self) -> list[str]:
        """Return the damage found so far, one line each."""
