"""A recording of any format as topics and serialised messages; damaged and truncated ones included.

All reading of recordings goes through this module: decoding frames, reading skeletons, and playing topics.
"""

from __future__ import annotations

import re
import stat
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO

from depth_pose.core.errors import InputError
from depth_pose.io import _mcap_records as mcap
from depth_pose.io._formats import ENDINGS, READ, images_hint, open_file
from depth_pose.io._rosbag2_folder import (
    METADATA,
    Metadata,
    PackedMessages,
    Unpacker,
    missing_counts,
    read_metadata_file,
)
from depth_pose.io._topics import MCAP_MAGIC, DamageError, RawMessage, RecordingFile, Topic
from depth_pose.io.image_folder import IMAGE_ENDINGS, ImageFolder, image_files
from depth_pose.io.image_options import ImageOptions

__all__ = ["RawMessage", "Recording", "Span", "Topic", "read_metadata", "read_span", "recording_files"]


class Recording:
    """A recording: a file, or a folder with the files of one recording, or with images.

    Parameters
    ----------
    path : Path or str
        MCAP, rosbag2's .db3, ROS 1's .bag, a folder of these, or a folder of PNG or NPY depth images.
    images : ImageOptions, optional
        Camera, unit and rate of a folder of images.

    Attributes
    ----------
    topics : dict of str to Topic
        Topics whose messages are, or are converted to, those of ROS 2.
    others : dict of str to str
        Topics that cannot be read, and why.
    unit_m : float or None
        Metres per unit of the depth, if given; None for a folder of images, which applies it.

    Raises
    ------
    InputError
        If there is no such file, or it is not a recording.
    """

    def __init__(self, path: Path | str, images: ImageOptions | None = None) -> None:
        self.path = Path(path)
        self.topics: dict[str, Topic] = {}
        self.others: dict[str, str] = {}
        self._first: dict[str, RawMessage] = {}
        self._said: Mapping[str, int] = {}  # messages by topic, from metadata.yaml
        self._damage: list[str] = []
        self._unpacked = Unpacker()
        self._files = self._open(images or ImageOptions())
        is_applied = isinstance(self._files[0], ImageFolder)
        self.unit_m = images.depth_scale if images is not None and not is_applied else None
        for file in self._files:
            for topic in file.topics:
                self._add(topic)
            self.others.update(file.others)

    def _open(self, images: ImageOptions) -> list[RecordingFile]:
        if not self.path.is_dir():
            head = _head(self.path)
            path = self._unpacked(self.path)
            file = open_file(path, head if path == self.path else _head(path))
            return [PackedMessages(file, path) if _is_packed(self.path) else file]
        if (self.path / METADATA).is_file():
            return self._open_rosbag2(read_metadata_file(self.path))
        files = recording_files(self.path)
        if not files:
            hint = images_hint(self.path)
            raise InputError(f"{self.path} has no recording in it; supported formats are {READ}{hint}")
        if files[0].suffix.lower() in IMAGE_ENDINGS:
            return [ImageFolder(self.path, images)]
        if not _may_be_parts(files):
            raise InputError(
                f"{self.path} holds several recordings, not the parts of one; choose one of them"
            )
        opened = [part for path in files if (part := self._open_part(path)) is not None]
        if not opened:
            raise InputError("; ".join(self._damage))
        return opened

    def _open_rosbag2(self, metadata: Metadata) -> list[RecordingFile]:
        files: list[RecordingFile] = []
        self._said = metadata.counts
        for path in metadata.files:
            if not path.exists():
                self._damage.append(f"{path} does not exist; {self.path / METADATA} lists it")
                continue
            if (file := self._open_part(path)) is not None:
                files.append(PackedMessages(file, path) if metadata.is_packed else file)
        if not files:
            raise InputError("; ".join(self._damage) or f"{self.path / METADATA} lists no files")
        return files

    def _open_part(self, path: Path) -> RecordingFile | None:
        """Open one of several files; one that cannot be read is damage: the others may be whole."""
        try:
            _head(path)
            unpacked = self._unpacked(path)
            return open_file(unpacked, _head(unpacked))
        except InputError as error:
            self._damage.append(str(error))
            return None

    def _add(self, topic: Topic) -> None:
        before = self.topics.get(topic.name)
        count = topic.count + (before.count if before else 0)
        self.topics[topic.name] = Topic(topic.name, topic.kind, count, topic.definition, topic.qos)

    def messages(self, *topics: str) -> Iterator[RawMessage]:
        """Yield the topics' messages by log time, file after file."""
        if not self._said:
            for file in self._files:
                yield from file.messages(topics)
            return
        read: Counter[str] = Counter()
        for file in self._files:
            for message in file.messages(topics):
                read[message.topic] += 1
                yield message
        missing = missing_counts(self._said, read, topics)
        if missing and not self.damage:
            counts = ", ".join(f"{n} of {of} on {topic}" for topic, (n, of) in sorted(missing.items()))
            self._damage.append(f"{self.path} does not have the number of messages in {METADATA}: {counts}")

    def first(self, topic: str) -> RawMessage | None:
        """Return the topic's first message, or None."""
        if topic not in self._first:
            for message in self.messages(topic):
                self._first[topic] = message
                break
        return self._first.get(topic)

    @property
    def notes(self) -> list[str]:
        """Return what is assumed of a folder of images, a line each."""
        return [note for file in self._files if isinstance(file, ImageFolder) for note in file.notes]

    @property
    def damage(self) -> list[str]:
        """Return the damage found so far: a line for each damaged file."""
        return self._damage + [line for file in self._files for line in file.damage]


def read_metadata(path: Path | str, name: str) -> dict[str, str] | None:
    """Return the named metadata record of an MCAP file; None without such a file or record."""
    try:
        with open_regular(Path(path)) as stream:
            if stream.read(len(MCAP_MAGIC)) != MCAP_MAGIC:
                return None
            summary = mcap.read_summary(stream)
            for index in summary.metadata if summary else ():
                if index.name == name:
                    found: dict[str, str] = mcap.read_metadata_record(stream, index).metadata
                    return found
    except (DamageError, InputError, OSError):
        pass
    return None


def _may_be_parts(files: list[Path]) -> bool:
    """Check that files may be parts of one recording: equal names but for numbers, consecutive times."""
    if len({re.sub(r"\d+", "", file.name) for file in files}) > 1:
        return False
    spans = [span for file in files if (span := read_span(file)) is not None and span.end_ns]
    return all(before.end_ns <= after.start_ns for before, after in pairwise(spans))


@dataclass(frozen=True)
class Span:
    """Summary of an MCAP file: first and last log time, nanoseconds, and its topics."""

    start_ns: int
    end_ns: int
    topics: frozenset[str]


def read_span(path: Path | str) -> Span | None:
    """Return the span of an MCAP file; None without a summary."""
    try:
        with open_regular(Path(path)) as stream:
            if stream.read(len(MCAP_MAGIC)) != MCAP_MAGIC:
                return None
            summary = mcap.read_summary(stream)
    except (DamageError, InputError, OSError):
        return None
    if summary is None or summary.statistics is None:
        return None
    found = summary.statistics
    topics = frozenset(channel.topic for channel in summary.channels.values())
    return Span(found.message_start_time, found.message_end_time, topics)


def recording_files(path: Path) -> list[Path]:
    """Return the files of a recording in order; from a folder those of one format, images last."""
    if not path.is_dir():
        return [path]
    if (path / METADATA).is_file():
        try:
            named = [file for file in read_metadata_file(path).files if file.exists()]
        except InputError:
            named = []
        if named:
            return named
    for ending in ENDINGS:
        files = sorted(path.glob(f"*{ending}"), key=_by_number)
        if files:
            return files
    return image_files(path)


def _is_packed(file: Path) -> bool:
    """Check that a file belongs to a folder with individually compressed messages."""
    try:
        found = read_metadata_file(file.parent) if (file.parent / METADATA).is_file() else None
    except InputError:
        return False
    return found is not None and found.is_packed and file in found.files


def _head(file: Path) -> bytes:
    """Return a file's first bytes."""
    try:
        with open_regular(file) as stream:
            return stream.read(64)
    except OSError as error:
        raise InputError(f"{file} cannot be read: {error.strerror}") from error


def open_regular(file: Path) -> BinaryIO:
    """Open a regular file for reading; refuse pipes and devices, which may never end.

    Raises
    ------
    InputError
        If it is a pipe or device.
    OSError
        If it cannot be opened.
    """
    if not stat.S_ISREG(file.stat().st_mode):
        raise InputError(f"{file} cannot be read: it is a pipe, a device or the like, not a file")
    return file.open("rb")


def _by_number(file: Path) -> tuple[list[int], str]:
    return [int(digits) for digits in re.findall(r"\d+", file.stem)][-1:], file.name
