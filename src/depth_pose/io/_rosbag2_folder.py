"""A folder that rosbag2 wrote: what its ``metadata.yaml`` says, and what was packed as a whole."""

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
"""How names end of files that rosbag2 packed as a whole."""

_MOST_METADATA = 16 << 20
"""Bytes of ``metadata.yaml``, at most; a larger one is refused. Set by hand."""
_ZSTD_HEADER = 18
"""Most bytes of a frame's header (RFC 8878)."""

_BLOCK = 1 << 20
"""Bytes that are unpacked at once. Set by hand."""

_MOST_RATIO = 200
"""Most bytes that one packed byte may stand for; noisy depth has 2 to 5, simulated depth 20. Set by hand."""

_ALWAYS = 256 << 20
"""Bytes that may be unpacked whatever the ratio. Set by hand."""

LEFT_FREE = 1 << 30
"""Bytes that unpacking leaves free on the disk. Set by hand."""


@dataclass(frozen=True)
class Metadata:
    """What ``metadata.yaml`` says.

    Attributes
    ----------
    files : tuple of Path
        The recording's files, in their order.
    counts : mapping of str to int
        Messages by topic, in all files together.
    is_packed : bool
        Whether each message is packed by itself.
    """

    files: tuple[Path, ...]
    counts: Mapping[str, int]
    is_packed: bool


def read_metadata_file(folder: Path) -> Metadata:
    """Read a folder's ``metadata.yaml``.

    Raises
    ------
    InputError
        Where it cannot be read; the message says how to make it anew.
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
        raise InputError(f"{said}; 'ros2 bag reindex {folder}' makes it anew") from error
    return Metadata(tuple(folder / name for name in names), counts, mode == "message")


def unpack(file: Path, folder: Path) -> Path:
    """Unpack a file that was packed as a whole into a folder; gives the unpacked one.

    Raises
    ------
    InputError
        Where it is no recording, is damaged, or unpacks to more than there is room or reason for. Nothing is
        left of it then.
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
    """Unpack to at most as many bytes as there is room for."""
    import zstandard

    reason = max(_MOST_RATIO * file.stat().st_size, _ALWAYS)
    declared = zstandard.frame_content_size(source.read(_ZSTD_HEADER))
    source.seek(0)
    reader = zstandard.ZstdDecompressor().stream_reader(source)
    size = 0
    while block := reader.read(_BLOCK):
        if not size and not block.startswith(MAGICS):
            raise InputError(f"{file} cannot be read: what is packed in it is no recording")
        size += len(block)
        if max(size, declared) > reason:
            raise InputError(f"{file} is refused: it unpacks to over {_MOST_RATIO} times its size")
        if max(size, declared) > room:
            raise InputError(f"{file} cannot be unpacked: {out.name} has too little room")
        out.write(block)


class Unpacker:
    """Holds a folder for unpacked files, which goes when nobody needs it any more."""

    def __init__(self) -> None:
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    def __call__(self, file: Path) -> Path:
        """Give the file, unpacked if it is packed."""
        if file.suffix != PACKED:
            return file
        if self._folder is None:
            self._folder = tempfile.TemporaryDirectory(prefix="depth_pose_")
        return unpack(file, Path(self._folder.name))


class PackedMessages:
    """A file whose messages are packed one by one (zstd).

    Parameters
    ----------
    file : RecordingFile
        The file as it is.
    path : Path
        Its name.
    """

    def __init__(self, file: RecordingFile, path: Path) -> None:
        self._file, self._path = file, path
        self.topics: list[Topic] = file.topics
        self.others = file.others
        self._bad = 0

    def messages(self, topics: Iterable[str]) -> Iterator[RawMessage]:
        """Give the topics' messages, unpacked."""
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
        """What could not be read, as far as reading has come."""
        bad = [f"{self._path} is damaged: {counted(self._bad, 'message')} cannot be unpacked"]
        return self._file.damage + (bad if self._bad else [])


def missing_counts(said: Mapping[str, int], read: Mapping[str, int], topics: Iterable[str]) -> dict[str, Any]:
    """Give the topics whose messages are not as many as said: read, and said."""
    return {t: (read.get(t, 0), said[t]) for t in topics if t in said and read.get(t, 0) != said[t]}
