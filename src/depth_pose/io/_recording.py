"""A recording as topics and serialised messages, whatever its format; also one that was damaged or cut short.

This is the one reader of recordings: frames are decoded from it, skeletons read, and topics played.
"""

from __future__ import annotations

import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from depth_pose.core.errors import InputError
from depth_pose.io import _mcap_records as mcap
from depth_pose.io._topics import DamageError, RawMessage, RecordingFile, Topic

__all__ = ["RawMessage", "Recording", "Span", "Topic", "read_metadata", "read_span", "recording_files"]


class Recording:
    """A recording: a file, or a folder of the files of one.

    Parameters
    ----------
    path : Path or str
        The file or folder.

    Attributes
    ----------
    topics : dict of str to Topic
        Those whose messages are, or become, ROS 2's.
    others : dict of str to str
        Topics that cannot be read, and why.

    Raises
    ------
    InputError
        Where there is no such file, or it is no recording.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.topics: dict[str, Topic] = {}
        self.others: dict[str, str] = {}
        self._first: dict[str, RawMessage] = {}
        self._files = [_open(file) for file in _files(self.path)]
        for file in self._files:
            for topic in file.topics:
                self._add(topic)
            self.others.update(file.others)

    def _add(self, topic: Topic) -> None:
        before = self.topics.get(topic.name)
        count = topic.count + (before.count if before else 0)
        self.topics[topic.name] = Topic(topic.name, topic.kind, count, topic.definition, topic.qos)

    def messages(self, *topics: str) -> Iterator[RawMessage]:
        """Give the topics' messages by log time, file after file."""
        for file in self._files:
            yield from file.messages(topics)

    def first(self, topic: str) -> RawMessage | None:
        """Give the topic's first message, or None."""
        if topic not in self._first:
            for message in self.messages(topic):
                self._first[topic] = message
                break
        return self._first.get(topic)

    @property
    def damage(self) -> list[str]:
        """What could not be read, as far as reading has come: a line for each file that is damaged."""
        return [line for file in self._files for line in file.damage]


def read_metadata(path: Path | str, name: str) -> dict[str, str] | None:
    """Give the named metadata record of an MCAP file; None where there is no such file or record."""
    try:
        with Path(path).open("rb") as stream:
            if stream.read(len(mcap.MAGIC)) != mcap.MAGIC:
                return None
            summary = mcap.read_summary(stream)
            for index in summary.metadata if summary else ():
                if index.name == name:
                    found: dict[str, str] = mcap.read_metadata_record(stream, index).metadata
                    return found
    except (DamageError, OSError):
        pass
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
            if stream.read(len(mcap.MAGIC)) != mcap.MAGIC:
                return None
            summary = mcap.read_summary(stream)
    except (DamageError, OSError):
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
    """Give the files of a path, checked to be such."""
    files = recording_files(path)
    if not files:
        raise InputError(f"{path} has no .mcap files in it")
    return files


def _open(file: Path) -> RecordingFile:
    """Open a file by what it begins with."""
    from depth_pose.io._mcap_file import McapFile

    magic = _magic(file)
    if magic.startswith(mcap.MAGIC):
        return McapFile(file)
    hint = "; convert it with 'ros2 bag convert'" if magic.startswith(b"SQLite") else ""
    raise InputError(f"{file} is not an MCAP recording{hint}")


def _magic(file: Path) -> bytes:
    """Give a file's first bytes; what is no file is not opened."""
    try:
        if not stat.S_ISREG(file.stat().st_mode):
            raise InputError(f"{file} cannot be read: it is a pipe, a device or the like, not a file")
        with file.open("rb") as stream:
            return stream.read(64)
    except OSError as error:
        raise InputError(f"{file} cannot be read: {error.strerror}") from error


def _by_number(file: Path) -> tuple[list[int], str]:
    return [int(digits) for digits in re.findall(r"\d+", file.stem)][-1:], file.name
