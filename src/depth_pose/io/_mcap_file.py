"""One MCAP file: its topics, and its messages by log time; damaged chunks are skipped, counted and reported.

A finished file is read by its index if the index's checksum is right. Any other file is scanned from the
beginning, record by record. In both cases the checksum of each chunk is verified, and at the end the number
of messages is compared with the statistics.
"""

from __future__ import annotations

import os
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Channel

from depth_pose.io import _mcap_records as mcap
from depth_pose.io._mcap_records import Summary
from depth_pose.io._topics import MCAP_MAGIC, DamageError, Place, RawMessage, Topic, counted, in_order

_RUN = 4 << 20
"""Approximate size (bytes) of a run of messages outside chunks."""

_BLOCK = 1 << 20
"""Bytes read at once for the checksum of the data."""

_MOST_BAD = 10_000
"""Maximum number of bad chunks and records; after that the rest of the file is not read."""

_PRIVATE = 0x80
"""First record kind reserved for applications; such records are skipped."""


class McapFile:
    """An MCAP file.

    Parameters
    ----------
    path : Path
        A file with the first bytes of MCAP.

    Attributes
    ----------
    topics : list of Topic
        Topics in the encoding of ROS 2.
    others : dict of str to str
        Topics in another encoding, and that encoding.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topics: list[Topic] = []
        self.others: dict[str, str] = {}
        self._summary = Summary()
        self._places: list[Place] = []
        self._said: Counter[str] | None = None  # messages by topic, from the statistics
        self._found: Counter[int] = Counter()  # messages by channel, from the scan
        self._bad: dict[int, str] = {}  # damaged chunks: offset and reason
        self._faults: list[str] = []
        self._ros1: dict[int, str] = {}  # channels whose messages are converted, and their types
        self._missing: dict[str, tuple[int, int]] = {}  # topics: messages read and expected
        with path.open("rb") as stream:
            if not self._read_index(stream):
                self._scan(stream)
        self._list_topics()

    # Contents

    def _read_index(self, stream: BinaryIO) -> bool:
        """Read topics and chunks from the summary; return False if it is unusable."""
        if not mcap.is_finished(stream):
            self._faults.append("ends too early")
            return False
        try:
            found = mcap.read_summary(stream)
        except DamageError as error:
            self._faults.append(f"was read without its index: {error}")
            return False
        if found is None or found.statistics is None:
            return False
        statistics = found.statistics
        if not set(statistics.channel_message_counts) <= set(found.channels):
            return False
        self._said = Counter()
        for number, count in statistics.channel_message_counts.items():
            self._said[found.channels[number].topic] += count
        if not found.chunks or len(found.chunks) != statistics.chunk_count:
            return False
        places = [
            Place(
                chunk.message_start_time,
                chunk.message_end_time,
                chunk.chunk_start_offset,
                chunk.chunk_start_offset + chunk.chunk_length,
                frozenset(chunk.message_index_offsets) or None,
            )
            for chunk in found.chunks
        ]
        if not _are_apart(places):  # otherwise a small file could be read for ever
            self._faults.append("was read without its index: it lists chunks twice")
            return False
        self._summary, self._places = found, places
        return True

    def _scan(self, stream: BinaryIO) -> None:
        """Read topics and chunks from all records, up to the first invalid one."""
        size, at = mcap.size_of(stream), len(MCAP_MAGIC)
        self._summary = Summary()
        run: list[Place] = []
        while at < size:
            try:
                kind, length = mcap.read_record_head(stream, at)
            except DamageError as error:
                if "ends too early" not in self._faults:
                    self._faults.append(f"is damaged at byte {at}, the rest is not read: {error}")
                break
            if kind == Opcode.DATA_END:
                self._check_data_end(stream, at, length)
                break
            if kind == 0:
                self._faults.append(f"has zeros from byte {at} on, where records should be")
                break
            if Opcode.DATA_END < kind < _PRIVATE:
                self._bad[at] = f"a record of the unknown kind {kind}"
                if len(self._bad) > _MOST_BAD:
                    self._faults.append(f"is damaged: from byte {at} on it is not read")
                    break
            self._scan_record(stream, kind, at, length, run)
            at += mcap.RECORD.size + length
        self._close_run(run)

    def _scan_record(self, stream: BinaryIO, kind: int, at: int, length: int, run: list[Place]) -> None:
        try:
            if kind == Opcode.CHUNK:
                self._scan_chunk(stream, at, length)
            elif kind == Opcode.MESSAGE:
                self._scan_message(stream, at, mcap.bounded(length), run)
            elif kind in (Opcode.SCHEMA, Opcode.CHANNEL):
                mcap.take(self._summary, kind, stream.read(mcap.bounded(length)))
        except DamageError as error:
            self._bad[at] = str(error)

    def _scan_message(self, stream: BinaryIO, at: int, length: int, run: list[Place]) -> None:
        """Add a message outside chunks to the current run."""
        channel, time_ns = mcap.message_head(stream.read(min(length, 64)))
        end = at + mcap.RECORD.size + length
        self._found[channel] += 1
        if run and (end - run[0].start > _RUN or at != run[-1].end):
            self._close_run(run)
        run.append(Place(time_ns, time_ns, at, end, None, is_chunk=False))

    def _scan_chunk(self, stream: BinaryIO, at: int, length: int) -> None:
        found = mcap.messages(mcap.read_chunk(stream, at)[2], self._summary)
        if found:
            times = [message.log_time_ns for message in found]
            channels = Counter(message.channel for message in found)
            self._found += channels
            end = at + mcap.RECORD.size + length
            self._places.append(Place(min(times), max(times), at, end, frozenset(channels)))

    def _close_run(self, run: list[Place]) -> None:
        """Finish a run of messages outside chunks."""
        if run:
            first, last = min(p.first_ns for p in run), max(p.last_ns for p in run)
            self._places.append(Place(first, last, run[0].start, run[-1].end, None, is_chunk=False))
            run.clear()

    def _check_data_end(self, stream: BinaryIO, at: int, length: int) -> None:
        """Verify the checksum of all data if no chunk has been found damaged."""
        wanted = int.from_bytes(stream.read(min(length, 4)), "little")
        if not wanted or self._bad:
            return
        if os.fstat(stream.fileno()).st_blocks * 512 < at // 2:  # a hole of terabytes would be read as zeros
            self._faults.append("has holes, so the checksum of its data is not verified")
            return
        crc, left = 0, at
        stream.seek(0)
        while left:
            block = stream.read(min(left, _BLOCK))
            crc, left = zlib.crc32(block, crc), left - len(block)
        if crc != wanted:
            self._faults.append("is damaged: the checksum of its data is wrong")

    def _list_topics(self) -> None:
        if self._said is not None and self._summary.statistics is not None:
            counts = Counter(self._summary.statistics.channel_message_counts)
        else:
            counts = self._found
        topics: dict[str, Topic] = {}
        for number, channel in self._summary.channels.items():
            schema = self._summary.schemas.get(channel.schema_id)
            if schema is not None and channel.message_encoding == "ros1":
                self._convert(number, channel, schema.name.replace("/", "/msg/", 1))
            if schema is None or (channel.message_encoding != "cdr" and number not in self._ros1):
                self.others.setdefault(channel.topic, _why_not(channel))
                continue
            before = topics[channel.topic].count if channel.topic in topics else 0
            topics[channel.topic] = Topic(
                channel.topic,
                self._ros1.get(number, schema.name),
                before + counts[number],
                "" if number in self._ros1 else schema.data.decode(errors="replace"),
                channel.metadata.get("offered_qos_profiles", ""),
            )
        self.topics = list(topics.values())

    def _convert(self, number: int, channel: Channel, kind: str) -> None:
        """Schedule the conversion of a channel's messages if possible; otherwise record the reason."""
        from depth_pose.io._ros1_messages import why_not

        reason = why_not(kind, channel.metadata.get("md5sum", ""))
        if reason:
            self.others[channel.topic] = reason
        else:
            self._ros1[number] = kind

    # Messages

    def messages(self, topics: Iterable[str]) -> Iterator[RawMessage]:
        """Yield the topics' messages by log time; equal times in file order."""
        wanted = set(topics)
        numbers = {
            number: channel.topic
            for number, channel in self._summary.channels.items()
            if channel.topic in wanted and (channel.message_encoding == "cdr" or number in self._ros1)
        }
        read: Counter[str] = Counter()
        with self.path.open("rb") as stream:
            places = [p for p in self._places if p.channels is None or p.channels & numbers.keys()]
            for message in in_order(places, lambda place: self._messages_at(stream, place, numbers)):
                read[message.topic] += 1
                yield message
        if self._said is not None:
            for topic in wanted & set(self._said):
                if read[topic] != self._said[topic]:
                    self._missing[topic] = (read[topic], self._said[topic])

    def _messages_at(self, stream: BinaryIO, place: Place, numbers: dict[int, str]) -> list[RawMessage]:
        found = [m for m in self._all_messages_at(stream, place) if m.channel in numbers]
        if self._ros1:
            from depth_pose.io._ros1_messages import to_cdr

            try:
                found = [
                    m._replace(data=to_cdr(m.data, self._ros1[m.channel])) if m.channel in self._ros1 else m
                    for m in found
                ]
            except DamageError as error:
                self._bad[place.start] = str(error)
                return []
        return [RawMessage(numbers[m.channel], m.log_time_ns, m.data) for m in found]

    def _all_messages_at(self, stream: BinaryIO, place: Place) -> list[mcap.Message]:
        if place.start in self._bad:
            return []
        try:
            if place.is_chunk:
                return mcap.messages(mcap.read_chunk(stream, place.start)[2])
            stream.seek(place.start)
            return mcap.messages(stream.read(place.end - place.start))
        except DamageError as error:
            self._bad[place.start] = str(error)
            return []

    @property
    def damage(self) -> list[str]:
        """Return the damage found so far: one line, or none."""
        parts = list(self._faults)
        if self._bad:
            first = min(self._bad)
            parts.append(
                f"has {counted(len(self._bad), 'damaged chunk')}, left out "
                f"(the first at byte {first}: {self._bad[first]})"
            )
        if self._missing:
            counts = ", ".join(f"{n} of {of} on {topic}" for topic, (n, of) in sorted(self._missing.items()))
            parts.append(f"does not have the stated number of messages: {counts}")
        elif parts and self._found:
            parts.append(f"gave {counted(self._found.total(), 'message')}")
        return [f"{self.path} {'; '.join(parts)}"] if parts else []


def _are_apart(places: list[Place]) -> bool:
    """Check that no two places overlap in the file."""
    order = sorted(places, key=lambda place: place.start)
    return all(before.end <= after.start for before, after in pairwise(order))


def _why_not(channel: Channel) -> str:
    names = {"json": "JSON", "protobuf": "protobuf", "flatbuffer": "FlatBuffers", "ros1": "ROS 1's encoding"}
    encoding = channel.message_encoding
    return f"in {names.get(encoding, encoding or 'an unspecified encoding')}, not ROS 2's CDR"
