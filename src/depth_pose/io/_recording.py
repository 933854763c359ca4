"""An MCAP recording as topics and serialised messages; also one that was cut short.

This is the one reader of recordings: frames are decoded from it, and the nodes' topics played from it.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, SeekingReader
from mcap.records import Schema

from depth_pose.core.errors import InputError

_MAGIC = b"\x89MCAP0\r\n"


def _damage_types() -> tuple[type[Exception], ...]:
    """Give what reading a damaged file may raise."""
    types: list[type[Exception]] = [McapError, ValueError, struct.error, KeyError, OverflowError, OSError]
    types += [RuntimeError, EOFError]  # lz4
    try:
        from zstandard import ZstdError
    except ImportError:
        return tuple(types)
    return (*types, ZstdError)


_DAMAGE = _damage_types()


@dataclass(frozen=True)
class Topic:
    """A topic of a recording: its name, message type, number of messages, and the type's definition."""

    name: str
    kind: str
    count: int
    definition: str = ""


@dataclass(frozen=True)
class RawMessage:
    """One message as it was recorded: CDR bytes and log time, nanoseconds."""

    topic: str
    log_time_ns: int
    data: bytes


class Recording:
    """An MCAP file, or a folder of them as rosbag2 writes it.

    Parameters
    ----------
    path : Path or str
        The file or folder.

    Attributes
    ----------
    topics : dict of str to Topic
        Those in ROS 2's encoding.
    damage : list of str
        What could not be read, one line for each file that ends too early; empty if all is well.

    Raises
    ------
    InputError
        Where there is no such file, or it is no MCAP file.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.damage: list[str] = []
        self.topics: dict[str, Topic] = {}
        self._first: dict[str, RawMessage] = {}
        self._indexed: dict[Path, bool] = {}
        for file in _files(self.path):
            self._indexed[file] = self._read_index(file) or self._scan(file)

    def _add(self, name: str, schema: Schema, count: int) -> None:
        before = self.topics[name].count if name in self.topics else 0
        self.topics[name] = Topic(name, schema.name, before + count, schema.data.decode(errors="replace"))

    def _read_index(self, file: Path) -> bool:
        """Take the topics from the file's summary; False where it has no usable one."""
        with file.open("rb") as stream:
            try:
                summary = SeekingReader(stream, record_size_limit=file.stat().st_size).get_summary()
            except _DAMAGE:
                return False
        if summary is None or summary.statistics is None or not summary.chunk_indexes:
            return False
        counts = summary.statistics.channel_message_counts
        if not set(counts) <= set(summary.channels):
            return False
        for number, channel in summary.channels.items():
            schema = summary.schemas.get(channel.schema_id)
            if schema is not None and channel.message_encoding == "cdr":
                self._add(channel.topic, schema, counts.get(number, 0))
        return True

    def _scan(self, file: Path) -> bool:
        """Take the topics from all messages of a file without a usable summary; gives False."""
        whole = False
        messages = 0
        with file.open("rb") as stream:
            try:
                reader = NonSeekingReader(stream, record_size_limit=file.stat().st_size)
                for schema, channel, message in reader.iter_messages(log_time_order=False):
                    messages += 1
                    if schema is None or channel.message_encoding != "cdr":
                        continue
                    self._add(channel.topic, schema, 1)
                    if channel.topic not in self._first:
                        raw = RawMessage(channel.topic, message.log_time, message.data)
                        self._first[channel.topic] = raw
                whole = True
            except _DAMAGE:
                pass
        if not whole:
            self.damage.append(f"{file} ends too early; the first {messages} messages are readable")
        return False

    def messages(self, *topics: str) -> Iterator[RawMessage]:
        """Give the topics' messages, by log time; in the file's order where it has no index."""
        for file, indexed in self._indexed.items():
            with file.open("rb") as stream:
                yield from self._messages_of(file, stream, indexed, topics)

    def _messages_of(
        self, file: Path, stream: BinaryIO, indexed: bool, topics: tuple[str, ...]
    ) -> Iterator[RawMessage]:
        limit = file.stat().st_size
        reader = (
            SeekingReader(stream, validate_crcs=True, record_size_limit=limit)
            if indexed
            else NonSeekingReader(stream, record_size_limit=limit)
        )
        messages = reader.iter_messages(topics=list(topics), log_time_order=indexed)
        read = 0
        while True:
            try:
                _, channel, message = next(messages)
            except StopIteration:
                return
            except _DAMAGE as error:
                if indexed:  # a scan has said so already
                    line = f"{file} is damaged after {read} messages of {', '.join(topics)}: {error}"
                    if line not in self.damage:
                        self.damage.append(line)
                return
            read += 1
            yield RawMessage(channel.topic, message.log_time, message.data)

    def first(self, topic: str) -> RawMessage | None:
        """Give the topic's first message, or None."""
        if topic not in self._first:
            for message in self.messages(topic):
                self._first[topic] = message
                break
        return self._first.get(topic)


def read_metadata(path: Path | str, name: str) -> dict[str, str] | None:
    """Give the named metadata record of an MCAP file; None where there is no such file or record."""
    try:
        with Path(path).open("rb") as stream:
            reader = SeekingReader(stream, record_size_limit=Path(path).stat().st_size)
            return next((record.metadata for record in reader.iter_metadata() if record.name == name), None)
    except _DAMAGE:
        return None


@dataclass(frozen=True)
class Span:
    """What an MCAP file says of itself: first and last log time, nanoseconds, and its topics."""

    start_ns: int
    end_ns: int
    topics: frozenset[str]


def read_span(path: Path | str) -> Span | None:
    """Give the span of an MCAP file; None where it has no summary to read it from."""
    try:
        with Path(path).open("rb") as stream:
            summary = SeekingReader(stream, record_size_limit=Path(path).stat().st_size).get_summary()
    except _DAMAGE:
        return None
    if summary is None or summary.statistics is None:
        return None
    found = summary.statistics
    topics = frozenset(channel.topic for channel in summary.channels.values())
    return Span(found.message_start_time, found.message_end_time, topics)


def recording_files(path: Path) -> list[Path]:
    """Give the MCAP files of a recording, in their order."""
    return sorted(path.glob("*.mcap"), key=_by_number) if path.is_dir() else [path]


def _files(path: Path) -> list[Path]:
    """Give the MCAP files of a path, checked to be such."""
    files = recording_files(path)
    if not files:
        raise InputError(f"{path} has no .mcap files in it")
    for file in files:
        try:
            with file.open("rb") as stream:
                magic = stream.read(len(_MAGIC))
        except OSError as error:
            raise InputError(f"{file} cannot be read: {error.strerror}") from error
        if magic != _MAGIC:
            hint = "; convert it with 'ros2 bag convert'" if magic.startswith(b"SQLite") else ""
            raise InputError(f"{file} is not an MCAP recording{hint}")
    return files


def _by_number(file: Path) -> tuple[list[int], str]:
    return [int(digits) for digits in re.findall(r"\d+", file.stem)][-1:], file.name
