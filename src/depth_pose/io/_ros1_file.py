"""One ROS 1 bag (format 2.0): its topics, and its messages by log time, as those of ROS 2.

Layout: wiki.ros.org/Bags/Format/2.0. A bag that was not closed has no index and is read all the same. The
format has no checksums.
"""

from __future__ import annotations

import bz2
import struct
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

import lz4.frame

from depth_pose.io._mcap_records import size_of
from depth_pose.io._ros1_messages import to_cdr, why_not
from depth_pose.io._topics import MAX_CHUNK, DamageError, Place, RawMessage, Topic, counted, in_order

MAGIC = b"#ROSBAG V2.0\n"

_MESSAGE, _BAG, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = range(2, 8)
"""Kinds of records."""

_MOST_HEAD = 1 << 20
"""The most bytes of a record's header: definitions are not in it. Set by hand."""

_U32 = struct.Struct("<I")
_TIME = struct.Struct("<II")


class _Connection(NamedTuple):
    topic: str
    kind: str
    md5: str


class _Record(NamedTuple):
    """A record: its header's fields, and where its data are."""

    fields: dict[bytes, bytes]
    data_at: int
    size: int

    @property
    def kind(self) -> int:
        return self.fields.get(b"op", b"\0")[0] if self.fields.get(b"op") else 0

    def number(self, name: bytes) -> int:
        value = self.fields.get(name, b"")
        if len(value) != 4:
            raise DamageError(f"a record has no {name.decode()}")
        return int(_U32.unpack(value)[0])

    def text(self, name: bytes) -> str:
        return self.fields.get(name, b"").decode(errors="replace")

    @property
    def time_ns(self) -> int:
        value = self.fields.get(b"time", b"")
        if len(value) != 8:
            raise DamageError("a message has no time")
        seconds, rest = _TIME.unpack(value)
        return int(seconds) * 1_000_000_000 + int(rest)


class Ros1File:
    """A ROS 1 bag.

    Parameters
    ----------
    path : Path
        The file; its first bytes are those of one.

    Attributes
    ----------
    topics : list of Topic
        Those whose messages become ROS 2's.
    others : dict of str to str
        The other topics, and why not.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topics: list[Topic] = []
        self.others: dict[str, str] = {}
        self._connections: dict[int, _Connection] = {}
        self._places: list[Place] = []
        self._found: Counter[int] = Counter()
        self._bad: dict[int, str] = {}
        self._fault = ""
        with path.open("rb") as stream:
            self._scan(stream)
        self._list_topics()

    def _scan(self, stream: BinaryIO) -> None:
        """Go from record to record; chunks are only unpacked where no index stands behind them."""
        at, size = len(MAGIC), size_of(stream)
        chunk: tuple[int, int] | None = None
        times: list[int] = []
        channels: Counter[int] = Counter()
        finished = False
        while at < size:
            try:
                record = _read_record(stream, at, size)
                kind = record.kind
                if kind == _INDEX and chunk is not None:
                    self._take_index(stream, record, times, channels)
                else:
                    self._close_chunk(stream, chunk, times, channels)
                    chunk, times, channels = None, [], Counter()
                if kind == _CHUNK:
                    chunk = (at, record.data_at + record.size)
                elif kind == _CONNECTION:
                    self._take_connection(record, _data_of(stream, record))
                elif kind == _BAG:
                    finished = any(record.fields.get(b"index_pos", b""))
            except DamageError as error:
                self._fault = f"is damaged at byte {at}, the rest is not read: {error}"
                break
            at = record.data_at + record.size
        self._close_chunk(stream, chunk, times, channels)
        if not finished:
            self._fault = "ends too early: it was not closed (rosbag reindex)"

    def _take_index(
        self, stream: BinaryIO, record: _Record, times: list[int], channels: Counter[int]
    ) -> None:
        """Take times and number of a chunk's messages of one connection."""
        data = _data_of(stream, record)
        for seconds, rest, _ in struct.iter_unpack("<III", data[: len(data) // 12 * 12]):
            times.append(seconds * 1_000_000_000 + rest)
            channels[record.number(b"conn")] += 1

    def _close_chunk(
        self, stream: BinaryIO, chunk: tuple[int, int] | None, times: list[int], channels: Counter[int]
    ) -> None:
        if chunk is None:
            return
        if not times or not set(channels) <= set(self._connections):
            times, channels = [], Counter()
            try:
                for number, time_ns, _ in self._open_chunk(stream, chunk[0]):
                    times.append(time_ns)
                    channels[number] += 1
            except DamageError as error:
                self._bad[chunk[0]] = str(error)
                return
        if times:
            self._found += channels
            self._places.append(Place(min(times), max(times), *chunk, frozenset(channels)))

    def _open_chunk(self, stream: BinaryIO, at: int) -> list[tuple[int, int, bytes]]:
        """Give a chunk's messages: connection, time, bytes."""
        record = _read_record(stream, at, size_of(stream))
        data = _unpack(record, _data_of(stream, record))
        found = []
        inside = 0
        while inside < len(data):
            one, inside = _record_in(data, inside)
            if one.kind == _CONNECTION:
                self._take_connection(one, data[one.data_at : inside])
            elif one.kind == _MESSAGE:
                found.append((one.number(b"conn"), one.time_ns, data[one.data_at : inside]))
        return found

    def _take_connection(self, record: _Record, data: bytes) -> None:
        fields = _fields(data)
        kind = fields.get(b"type", b"").decode(errors="replace").replace("/", "/msg/", 1)
        md5 = fields.get(b"md5sum", b"").decode(errors="replace")
        self._connections[record.number(b"conn")] = _Connection(record.text(b"topic"), kind, md5)

    def _list_topics(self) -> None:
        topics: dict[str, Topic] = {}
        for number, connection in sorted(self._connections.items()):
            why = why_not(connection.kind, connection.md5)
            if why:
                self.others[connection.topic] = why
                continue
            before = topics[connection.topic].count if connection.topic in topics else 0
            topics[connection.topic] = Topic(connection.topic, connection.kind, before + self._found[number])
        self.topics = list(topics.values())

    def messages(self, topics: Iterable[str]) -> Iterator[RawMessage]:
        """Give the topics' messages by log time; those of one time in the file's order."""
        wanted = set(topics) & {topic.name for topic in self.topics}
        numbers = {
            n: c for n, c in self._connections.items() if c.topic in wanted and not why_not(c.kind, c.md5)
        }
        with self.path.open("rb") as stream:
            places = [p for p in self._places if p.channels is None or p.channels & numbers.keys()]
            yield from in_order(places, lambda place: self._messages_at(stream, place, numbers))

    def _messages_at(
        self, stream: BinaryIO, place: Place, numbers: dict[int, _Connection]
    ) -> list[RawMessage]:
        try:
            found = self._open_chunk(stream, place.start)
            return [
                RawMessage(numbers[number].topic, time_ns, to_cdr(data, numbers[number].kind))
                for number, time_ns, data in found
                if number in numbers
            ]
        except DamageError as error:
            self._bad[place.start] = str(error)
            return []

    @property
    def damage(self) -> list[str]:
        """What could not be read, as far as reading has come: one line, or none."""
        parts = [self._fault] if self._fault else []
        if self._bad:
            first = min(self._bad)
            parts.append(
                f"has {counted(len(self._bad), 'damaged chunk')}, left out "
                f"(the first at byte {first}: {self._bad[first]})"
            )
        return [f"{self.path} {'; '.join(parts)}"] if parts else []


# Records


def _fields(head: bytes) -> dict[bytes, bytes]:
    """Read ``name=value`` fields."""
    found, at = {}, 0
    while at + 4 <= len(head):
        (size,) = _U32.unpack_from(head, at)
        at += 4
        if size > len(head) - at:
            raise DamageError("a header's field is cut off")
        name, is_field, value = head[at : at + size].partition(b"=")
        if not is_field:
            raise DamageError("a header's field has no name")
        found[name] = value
        at += size
    return found


def _read_record(stream: BinaryIO, at: int, end: int) -> _Record:
    """Read a record's header; its data are in the file as a whole."""
    stream.seek(at)
    (size,) = _U32.unpack(_exactly(stream, 4))
    if size > min(_MOST_HEAD, end - at):
        raise DamageError("a record's header is longer than can be")
    fields = _fields(_exactly(stream, size))
    (length,) = _U32.unpack(_exactly(stream, 4))
    data_at = at + 8 + size
    if length > end - data_at:
        raise DamageError("a record is longer than the file")
    return _Record(fields, data_at, length)


def _record_in(data: bytes, at: int) -> tuple[_Record, int]:
    """Read a record's header in a chunk's data; gives it and where the record ends."""
    try:
        (size,) = _U32.unpack_from(data, at)
        data_at = at + 8 + size
        (length,) = _U32.unpack_from(data, data_at - 4)
    except struct.error as error:
        raise DamageError("a record is cut off") from error
    if data_at + length > len(data):
        raise DamageError("a record is longer than its chunk")
    return _Record(_fields(data[at + 4 : at + 4 + size]), data_at, length), data_at + length


def _exactly(stream: BinaryIO, size: int) -> bytes:
    data = stream.read(size)
    if len(data) != size:
        raise DamageError("the file ends there")
    return data


def _data_of(stream: BinaryIO, record: _Record) -> bytes:
    if record.size > MAX_CHUNK:
        raise DamageError(f"a record of {record.size} bytes is more than the {MAX_CHUNK >> 20} MiB taken")
    stream.seek(record.data_at)
    return _exactly(stream, record.size)


def _unpack(record: _Record, packed: bytes) -> bytes:
    """Unpack a chunk to the size that it declares, which is bounded."""
    size = record.number(b"size")
    if size > MAX_CHUNK:
        raise DamageError(f"a chunk of {size} bytes is more than the {MAX_CHUNK >> 20} MiB that are taken")
    name = record.text(b"compression")
    try:
        if name == "bz2":
            data = bz2.BZ2Decompressor().decompress(packed, max_length=size)
        elif name == "lz4":
            data = bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size))
        elif name == "none":
            data = packed
        else:
            raise DamageError(f"a chunk is packed with {name[:20]!r}, not bz2 or lz4")
    except (OSError, RuntimeError, EOFError, ValueError) as error:
        raise DamageError("a chunk cannot be unpacked") from error
    if len(data) != size:
        raise DamageError(f"a chunk of {size} bytes unpacks to {len(data)}")
    return data
