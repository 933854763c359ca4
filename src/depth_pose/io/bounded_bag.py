"""The rosbags reader of ROS 1 bags, with limits on what a bag can make it read, decompress and keep.

Format: wiki.ros.org/Bags/Format/2.0. The reader follows the index of a bag, which may be hostile: records of
gigabytes, chunks or messages listed many times, chunks that decompress to more than the memory.
"""

from __future__ import annotations

import bz2
import io
from collections.abc import Callable, Collection, Generator
from functools import partial
from pathlib import Path, PosixPath
from typing import Any

import lz4.frame
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader

from depth_pose.io._topics import MAX_CHUNK, DamageError

_MOST_INDEX = 16 << 20
"""Maximum size of the index (bytes): 1.4 million messages, which take 190 MB during reading."""

_MOST_SHARE, _SMALL_INDEX = 0.5, 1 << 20
"""Maximum share of the file that the index may be, unless it is this small (bytes)."""

_UNPACKED_AGAIN = 8
"""Maximum bytes decompressed per byte of a chunk, as overlapping chunks are decompressed in turn."""


class _BoundedFile(io.BufferedReader):
    """A file that refuses reads that are too large, and an index that is too long."""

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        share = max(_SMALL_INDEX, int(_MOST_SHARE * path.stat().st_size))
        self.index_most = min(_MOST_INDEX, share)
        self.index_left: int | None = self.index_most

    def read(self, size: int | None = -1) -> bytes:
        """Read ``size`` bytes, within the limits."""
        if size is None or not 0 <= size <= MAX_CHUNK:
            raise DamageError(f"a record of {size} bytes is more than the {MAX_CHUNK >> 20} MiB allowed")
        if self.index_left is not None:
            self.index_left -= size
            if self.index_left < 0:
                raise DamageError(
                    f"its index has more than {self.index_most >> 20} MiB; 'rosbag filter' selects topics"
                )
        return super().read(size)


class _BoundedPath(PosixPath):
    """A path that opens a `_BoundedFile`."""

    def open(self, *_: Any, **__: Any) -> Any:
        """Open the file for reading."""
        return _BoundedFile(self)


class BoundedReader(Reader):
    """The rosbags reader with limits.

    Parameters
    ----------
    path : Path
        A ROS 1 bag.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(_BoundedPath(path))
        self._sizes: dict[int, int] = {}  # decompressed chunks: position and size
        self._unpacked = 0

    def open(self) -> None:
        """Read the index."""
        super().open()
        if isinstance(self.bio, _BoundedFile):
            self.bio.index_left = None
        self.chunks = {
            at: chunk._replace(decompressor=partial(self._unpack, at, _UNPACK.get(chunk.decompressor, bytes)))
            for at, chunk in self.chunks.items()
        }

    def _unpack(self, at: int, unpack: Callable[[bytes], bytes], packed: bytes) -> bytes:
        data = unpack(packed)
        self._sizes[at] = len(data)
        self._unpacked += len(data)
        if self._unpacked > MAX_CHUNK + _UNPACKED_AGAIN * sum(self._sizes.values()):
            raise DamageError("its index jumps between chunks")
        return data

    def messages(
        self, connections: Collection[Connection] = (), start: int | None = None, stop: int | None = None
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Yield messages by log time; fails if the index lists a message twice."""
        given = self._unpacked = 0
        for found in super().messages(connections, start, stop):
            given += len(found[2])
            if given > sum(self._sizes.values()):
                raise DamageError("its index lists messages twice")
            yield found


def _unpack_bz2(packed: bytes) -> bytes:
    decompressor = bz2.BZ2Decompressor()
    data = decompressor.decompress(packed, max_length=MAX_CHUNK)
    if not decompressor.eof:
        raise DamageError(f"a chunk unpacks to more than the {MAX_CHUNK >> 20} MiB allowed, or is cut off")
    return data


def _unpack_lz4(packed: bytes) -> bytes:
    decompressor = lz4.frame.LZ4FrameDecompressor()
    data = bytes(decompressor.decompress(packed, max_length=MAX_CHUNK))
    if not decompressor.eof:
        raise DamageError(f"a chunk unpacks to more than the {MAX_CHUNK >> 20} MiB allowed, or is cut off")
    return data


_UNPACK: dict[Callable[[bytes], bytes], Callable[[bytes], bytes]] = {
    bz2.decompress: _unpack_bz2,
    lz4.frame.decompress: _unpack_lz4,
}
"""Bounded forms of the decompression functions that rosbags uses."""
