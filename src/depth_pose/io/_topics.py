"""Topics and messages of a recording, whatever its format."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

MCAP_MAGIC = b"\x89MCAP0\r\n"
DB3_MAGIC = b"SQLite format 3\x00"
BAG_MAGIC = b"#ROSBAG V2.0\n"
MAGICS = (MCAP_MAGIC, DB3_MAGIC, BAG_MAGIC)
"""What recordings begin with."""

MOST_WAITING = 256 << 20
"""Bytes of messages that may wait for earlier ones in chunks that overlap. Set by hand: twice the largest
chunk."""

MAX_CHUNK = 128 << 20
"""The most bytes of a chunk or a message, packed or not: twice the largest image that is taken, in
metres. Set by hand."""


@dataclass(frozen=True)
class Topic:
    """A topic of a recording.

    Attributes
    ----------
    name, kind : str
        Its name and message type.
    count : int
        How many messages the recording says that it has.
    definition : str
        The type's definition; empty where the recording has none.
    qos : str
        What its publishers offered, as rosbag2 writes it (YAML); empty where the recording does not say.
    """

    name: str
    kind: str
    count: int
    definition: str = ""
    qos: str = ""


@dataclass(frozen=True)
class RawMessage:
    """One message as it was recorded: CDR bytes and log time, nanoseconds."""

    topic: str
    log_time_ns: int
    data: bytes


def counted(count: int, what: str) -> str:
    """Say how many, for instance ``3 messages``."""
    return f"{count} {what}{'' if count == 1 else 's'}"


class Place(NamedTuple):
    """Where in a file messages are: a chunk, or a run of messages that are in none.

    Attributes
    ----------
    first_ns, last_ns : int
        Log times.
    start, end : int
        Offsets in the file.
    channels : frozenset of int or None
        Channels that have messages there; None where that is not known.
    is_chunk : bool
    """

    first_ns: int
    last_ns: int
    start: int
    end: int
    channels: frozenset[int] | None
    is_chunk: bool = True


def in_order(places: Iterable[Place], read: Callable[[Place], Iterable[RawMessage]]) -> Iterator[RawMessage]:
    """Give the messages of all places by log time; those of one time in the file's order.

    Of more than `MOST_WAITING` that wait, in places that overlap, the earliest are given out.

    Parameters
    ----------
    places : iterable of Place
    read : callable
        Gives a place's messages; is called when all that is earlier was given out.
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
    """Something in a recording cannot be read; the text says what, and fits behind 'because'."""


class RecordingFile(Protocol):
    """One file of a recording, in whatever format."""

    @property
    def topics(self) -> list[Topic]:
        """Those that can be read."""

    @property
    def others(self) -> dict[str, str]:
        """Topics that cannot be read, and why."""

    def messages(self, topics: Iterable[str]) -> Iterator[RawMessage]:
        """Give the topics' messages by log time."""

    @property
    def damage(self) -> list[str]:
        """What could not be read so far, one line each."""
