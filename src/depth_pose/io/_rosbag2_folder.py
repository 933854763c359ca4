"""A rosbag2 folder: its ``metadata.yaml``, and files that were compressed as a whole."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any, BinaryIO

from depth_pose.core.errors import DepthPoseError, InputError
from depth_pose.core.reading import parse_long_yaml, read_text
from depth_pose.io._topics import MAGICS, MAX_CHUNK, RawMessage, RecordingFile, Topic, counted

METADATA = "metadata.yaml"

PACKED = ".zstd"
"""Extension of files that rosbag2 compressed as a whole."""

_MOST_METADATA = 16 << 20
"""Maximum size of ``metadata.yaml`` (bytes)."""
_ZSTD_HEADER = 18
"""Maximum size of a frame header (bytes, RFC 8878)."""

_BLOCK = 1 << 20
"""Bytes decompressed at once."""

_MOST_RATIO = 200
"""Maximum compression ratio; noisy depth has 2 to 5, simulated depth 20."""

_ALWAYS = 256 << 20
"""Bytes that may be decompressed at any ratio."""

LEFT_FREE = 1 << 30
"""Bytes of disk space that decompression leaves free."""


@dataclass(frozen=True)
class Metadata:
    """Content of ``metadata.yaml``.

    Attributes
    ----------
    files : tuple of Path
        The recording's files, in their order.
    counts : mapping of str to int
        Number of messages by topic, in all files.
    is_packed : bool
        Whether each message is compressed individually.
    """

    files: tuple[Path, ...]
    counts: Mapping[str, int]
    is_packed: bool


def read_metadata_file(folder: Path) -> Metadata:
    """Read a folder's ``metadata.yaml``.

    Raises
    ------
    InputError
        If it cannot be read; the message says how to recreate it.
    """
    path = folder / METADATA
    try:
        found = parse_long_yaml(path, read_text(path, _MOST_METADATA))
        info = found["rosbag2_bagfile_information"]
        names = [PurePath(str(name)).name for name in info["relative_file_paths"]]
        counts = {
            str(entry["topic_metadata"]["name"]): int(entry["message_count"])
            for entry in info["topics_with_message_count"]
        }
        mode = str(info.get("compression_mode") or "").lower()
    except (DepthPoseError, ValueError, TypeError, KeyError, AttributeError) as error:
        text = " ".join(str(error).split())
        said = text if isinstance(error, DepthPoseError) else f"{path} cannot be read: {text}"
        raise InputError(f"{said}; 'ros2 bag reindex {folder}' recreates it") from error
    return Metadata(tuple(folder / name for name in names), counts, mode == "message")


def unpack(file: Path, folder: Path) -> Path:
    """Decompress a file that was compressed as a whole into a folder; return the new file.

    Raises
    ------
    InputError
        If it is not a recording, is damaged, or decompresses to more than the limits allow. No partial file
        remains.
    """
    import zstandard

    target = folder / file.name.removesuffix(PACKED)
    try:
        with file.open("rb") as source, target.open("wb") as out:
            _unpack_stream(file, source, out, shutil.disk_usage(folder).free - LEFT_FREE)
    except BaseException as error:
        target.unlink(missing_ok=True)
        if isinstance(error, OSError | zstandard.ZstdError):
            reason = getattr(error, "strerror", None) or error
            raise InputError(f"{file} cannot be unpacked: {reason}") from error
        raise
    return target


def _unpack_stream(file: Path, source: BinaryIO, out: BinaryIO, room: int) -> None:
    """Decompress to at most ``room`` bytes."""
    import zstandard

    reason = max(_MOST_RATIO * file.stat().st_size, _ALWAYS)
    declared = zstandard.frame_content_size(source.read(_ZSTD_HEADER))
    source.seek(0)
    reader = zstandard.ZstdDecompressor().stream_reader(source)
    size = 0
    while block := reader.read(_BLOCK):
        if not size and not block.startswith(MAGICS):
            raise InputError(f"{file} cannot be read: the compressed file is not a recording")
        size += len(block)
        if max(size, declared) > reason:
            raise InputError(f"{file} is refused: it unpacks to over {_MOST_RATIO} times its size")
        if max(size, declared) > room:
            raise InputError(f"{file} cannot be unpacked: {out.name} has too little space")
        out.write(block)


class Unpacker:
    """Holds a folder for decompressed files, which is removed after its last use."""

    def __init__(self) -> None:
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    def __call__(self, file: Path) -> Path:
        """Return the file, decompressed if it is compressed."""
        if file.suffix != PACKED:
            return file
        if self._folder is None:
            self._folder = tempfile.TemporaryDirectory(prefix="depth_pose_")
        return unpack(file, Path(self._folder.name))


class PackedMessages:
    """A file with individually compressed messages (zstd).

    Parameters
    ----------
    file : RecordingFile
        The file with compressed messages.
    path : Path
        Its name.
    """

    def __init__(self, file: RecordingFile, path: Path) -> None:
        self._file, self._path = file, path
        self.topics: list[Topic] = file.topics
        self.others = file.others
        self._bad = 0

    def messages(self, topics: Iterable[str]) -> Iterator[RawMessage]:
        """Yield the topics' messages, decompressed."""
        import zstandard

        unpacker, bad = zstandard.ZstdDecompressor(), 0
        for message in self._file.messages(topics):
            try:
                if zstandard.frame_content_size(message.data) > MAX_CHUNK:
                    raise zstandard.ZstdError("too large")
                data = unpacker.decompress(message.data, max_output_size=MAX_CHUNK)
            except zstandard.ZstdError:
                bad += 1
                self._bad = max(self._bad, bad)
                continue
            yield RawMessage(message.topic, message.log_time_ns, data)

    @property
    def damage(self) -> list[str]:
        """Return the damage found so far."""
        bad = [f"{self._path} is damaged: {counted(self._bad, 'message')} cannot be unpacked"]
        return self._file.damage + (bad if self._bad else [])


def missing_counts(said: Mapping[str, int], read: Mapping[str, int], topics: Iterable[str]) -> dict[str, Any]:
    """Return the topics whose number of messages differs from the expected: read, and expected."""
    return {t: (read.get(t, 0), said[t]) for t in topics if t in said and read.get(t, 0) != said[t]}
