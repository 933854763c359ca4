"""Records of an MCAP file, parsed defensively: lengths, sizes and checksums are verified first.

Layout and names follow the MCAP specification (mcap.dev/spec). Unreadable data raises `DamageError`;
allocations are limited by the file's size and `MAX_CHUNK`.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any, BinaryIO, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Metadata, MetadataIndex, Schema, Statistics

from depth_pose.io._topics import MAX_CHUNK, MCAP_MAGIC, DamageError

RECORD = struct.Struct("<BQ")
"""Head of each record: kind, and length of the content."""

MAX_SUMMARY = 16 << 20
"""Maximum size of a summary (bytes), the index of 90,000 chunks; a file with a larger one is scanned."""

_FOOTER = struct.Struct("<BQQQI")
_CHUNK = struct.Struct("<QQQI")
_MESSAGE = struct.Struct("<HIQQ")
_LENGTH = struct.Struct("<Q")


class Message(NamedTuple):
    """A message: channel number, log time in nanoseconds, and bytes."""

    channel: int
    log_time_ns: int
    data: bytes


@dataclass
class Summary:
    """Summary of a file, from its end."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    statistics: Statistics | None = None


def size_of(stream: BinaryIO) -> int:
    """Return the size of an open file, bytes."""
    return os.fstat(stream.fileno()).st_size


def is_finished(stream: BinaryIO) -> bool:
    """Check that a file ends like a properly closed one."""
    size = size_of(stream)
    stream.seek(max(size - len(MCAP_MAGIC), 0))
    return size > len(MCAP_MAGIC) and stream.read(len(MCAP_MAGIC)) == MCAP_MAGIC


def read_summary(stream: BinaryIO) -> Summary | None:
    """Read the summary of a finished file; None if it has none.

    Raises
    ------
    DamageError
        If it cannot be read, or its checksum is wrong.
    """
    size = size_of(stream)
    end = size - len(MCAP_MAGIC) - _FOOTER.size
    if end < len(MCAP_MAGIC):
        raise DamageError("it has no footer")
    stream.seek(end)
    footer = stream.read(_FOOTER.size)
    kind, length, start, _, crc = _FOOTER.unpack(footer)
    if kind != Opcode.FOOTER or length != _FOOTER.size - RECORD.size:
        raise DamageError("its footer is damaged")
    if start == 0:
        return None
    if not len(MCAP_MAGIC) <= start <= end:
        raise DamageError("its footer points outside the file")
    if end - start > MAX_SUMMARY:
        raise DamageError(f"it has {end - start >> 20} MiB, and {MAX_SUMMARY >> 20} are read")
    stream.seek(start)
    data = stream.read(end - start)
    if crc and zlib.crc32(footer[:-4], zlib.crc32(data)) != crc:
        raise DamageError("the checksum of its index is wrong")
    summary = Summary()
    for kind, body in records(data):
        take(summary, kind, body)
    return summary


def take(summary: Summary, kind: int, body: bytes) -> None:
    """Add a record to a summary."""
    if kind == Opcode.SCHEMA:
        schema = parse(Schema, body)
        summary.schemas[schema.id] = schema
    elif kind == Opcode.CHANNEL:
        channel = parse(Channel, body)
        summary.channels[channel.id] = channel
    elif kind == Opcode.CHUNK_INDEX:
        summary.chunks.append(parse(ChunkIndex, body))
    elif kind == Opcode.METADATA_INDEX:
        summary.metadata.append(parse(MetadataIndex, body))
    elif kind == Opcode.STATISTICS:
        summary.statistics = parse(Statistics, body)


def parse(kind: Any, body: bytes) -> Any:
    """Parse a record of one of mcap's classes."""
    try:
        return kind.read(ReadDataStream(BytesIO(body)))
    except (McapError, struct.error, ValueError) as error:
        raise DamageError(f"a {kind.__name__} record cannot be read") from error


def spans(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield (opcode, start, end) for each record in a buffer."""
    at, size = 0, len(data)
    while at < size:
        if at + RECORD.size > size:
            raise DamageError("a record is cut off")
        kind, length = RECORD.unpack_from(data, at)
        at += RECORD.size
        if length > size - at:
            raise DamageError("a record is longer than its chunk or summary")
        if kind == 0:
            raise DamageError("there are zeros where a record should be")
        yield kind, at, at + length
        at += length


def records(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield (opcode, content) for each record in a buffer."""
    return ((kind, data[begin:end]) for kind, begin, end in spans(data))


def read_metadata_record(stream: BinaryIO, index: MetadataIndex) -> Any:
    """Read the metadata record that an index points to."""
    if index.offset > size_of(stream) or index.length > size_of(stream) - index.offset:
        raise DamageError("an index points outside the file")
    stream.seek(index.offset)
    for kind, body in records(stream.read(bounded(index.length))):
        if kind == Opcode.METADATA:
            return parse(Metadata, body)
    raise DamageError("there is no metadata where the index says")


def read_record_head(stream: BinaryIO, at: int) -> tuple[int, int]:
    """Return a record's kind and content length, after checking that the file holds all of it."""
    if at > size_of(stream):
        raise DamageError("the file ends there")
    stream.seek(at)
    head = stream.read(RECORD.size)
    if len(head) < RECORD.size:
        raise DamageError("the file ends there")
    kind, length = RECORD.unpack(head)
    if length > size_of(stream) - at - RECORD.size:
        raise DamageError("a record is longer than the file")
    return kind, length


def read_chunk(stream: BinaryIO, at: int) -> tuple[int, int, bytes]:
    """Read a chunk and verify its checksum; return first and last log time, and its decompressed records."""
    kind, length = read_record_head(stream, at)
    if kind != Opcode.CHUNK:
        raise DamageError("there is no chunk where the index says")
    return open_chunk(stream.read(bounded(length)))


def bounded(size: int) -> int:
    """Return a size after checking it against `MAX_CHUNK`."""
    if size > MAX_CHUNK:
        raise DamageError(f"a chunk of {size} bytes is more than the {MAX_CHUNK >> 20} MiB allowed")
    return size


def open_chunk(body: bytes) -> tuple[int, int, bytes]:
    """Decompress a chunk's content; return first and last log time, and its records."""
    try:
        first_ns, last_ns, size, crc = _CHUNK.unpack_from(body)
        (named,) = struct.unpack_from("<I", body, _CHUNK.size)
        at = _CHUNK.size + 4 + named
        (packed,) = _LENGTH.unpack_from(body, at)
    except struct.error as error:
        raise DamageError("a chunk is too short") from error
    at += _LENGTH.size
    if packed != len(body) - at:
        raise DamageError("a chunk's length is wrong")
    data = _unpack(body[_CHUNK.size + 4 : at - _LENGTH.size], memoryview(body)[at:], bounded(size))
    if len(data) != size:
        raise DamageError(f"a chunk of {size} bytes unpacks to {len(data)}")
    if crc and zlib.crc32(data) != crc:
        raise DamageError("a chunk's checksum is wrong")
    return first_ns, last_ns, data


def _unpack(name: bytes, packed: memoryview, size: int) -> bytes:
    """Decompress to at most the declared number of bytes."""
    try:
        if name == b"zstd":
            declared = zstandard.frame_content_size(packed)
            if declared not in (-1, size):
                raise DamageError(f"a chunk of {size} bytes unpacks to {declared}")
            return zstandard.ZstdDecompressor().decompress(packed, max_output_size=max(size, 1))
        if name == b"lz4":
            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size))
    except (zstandard.ZstdError, RuntimeError, EOFError, ValueError) as error:
        raise DamageError("a chunk cannot be unpacked") from error
    if name:
        raise DamageError(f"a chunk is packed with {name.decode(errors='replace')[:20]!r}, not zstd or lz4")
    return bytes(packed)


def messages(data: bytes, summary: Summary | None = None) -> list[Message]:
    """Return the messages in a chunk's records; add schemas and channels among them to the summary."""
    found = []
    for kind, begin, end in spans(data):
        if kind == Opcode.MESSAGE:
            if end - begin < _MESSAGE.size:
                raise DamageError("a message is cut off")
            channel, _, log_time_ns, _ = _MESSAGE.unpack_from(data, begin)
            found.append(Message(channel, log_time_ns, data[begin + _MESSAGE.size : end]))
        elif summary is not None and kind in (Opcode.SCHEMA, Opcode.CHANNEL):
            take(summary, kind, data[begin:end])
    return found


def message_head(body: bytes) -> tuple[int, int]:
    """Return channel and log time from the beginning of a message record's content."""
    if len(body) < _MESSAGE.size:
        raise DamageError("a message is cut off")
    channel, _, log_time_ns, _ = _MESSAGE.unpack_from(body)
    return channel, log_time_ns
