"""Damaged recordings: what is whole is read, what is not is left out, counted and told."""

from __future__ import annotations

import logging
import os
import struct
import time
from pathlib import Path

import numpy as np
import pytest
from damaged import (
    CAMERA,
    IMAGE,
    STEP_NS,
    chunk_places,
    depth_mm,
    flip,
    messages,
    record_places,
    summary_place,
    write,
)
from mcap.opcode import Opcode
from mcap.writer import CompressionType, IndexType

from depth_pose.core.errors import InputError
from depth_pose.io.damage import DAMAGE_LOG
from depth_pose.io.mcap_read import DepthReader, read_frames
from depth_pose.io.recording import Recording
from little_memory import little_memory

FRAMES = 40
NO_INDEX = {"index_types": IndexType.NONE, "use_statistics": False, "use_summary_offsets": False}


def _read(path: Path) -> tuple[list[int], list[str]]:
    """Frames that were read, each checked to be as written, and what was told."""
    reader = DepthReader(path)
    numbers = []
    for frame in reader:
        i, between = divmod(frame.stamp_ns - 1_000_000_000, STEP_NS)
        assert (between, frame.camera, frame.frame_id) == (0, CAMERA, "optical")
        np.testing.assert_array_equal(frame.depth, depth_mm(i).astype(np.float32) / np.float32(1000))
        numbers.append(i)
    return numbers, reader.damage


@pytest.mark.parametrize("packed", [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD])
@pytest.mark.parametrize("options", [{}, NO_INDEX], ids=["index", "no index"])
def test_a_whole_recording_has_no_damage(tmp_path: Path, packed: CompressionType, options: dict) -> None:
    path = write(tmp_path / "a.mcap", compression=packed, **options)
    assert _read(path) == (list(range(FRAMES)), [])
    data = [m.data for m in Recording(path).messages(IMAGE)]
    assert data == [d for topic, _, _, d in messages(FRAMES) if topic == IMAGE]


def test_any_flipped_byte_of_the_summary_is_noticed_and_loses_nothing(tmp_path: Path) -> None:
    whole = write(tmp_path / "a.mcap", 10).read_bytes()
    start, end = summary_place(tmp_path / "a.mcap")
    path = tmp_path / "b.mcap"
    for at in (*range(start, end, 7), *range(end, len(whole))):
        path.write_bytes(whole)
        flip(path, at)
        numbers, damage = _read(path)
        assert numbers == list(range(10)), at
        assert len(damage) == 1 and str(path) in damage[0], at


@pytest.mark.parametrize("packed", [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD])
@pytest.mark.parametrize("options", [{}, NO_INDEX], ids=["index", "no index"])
def test_one_bad_chunk_is_left_out_and_counted(
    tmp_path: Path, packed: CompressionType, options: dict
) -> None:
    path = write(tmp_path / "a.mcap", compression=packed, **options)
    places = chunk_places(path)
    assert len(places) > 10
    at, length = places[4]
    flip(path, at + length // 2)
    numbers, damage = _read(path)
    assert FRAMES - 4 <= len(numbers) < FRAMES and numbers[-1] == FRAMES - 1
    assert "1 damaged chunk, left out" in damage[0] and f"byte {at}" in damage[0]
    if not options:
        assert f"{len(numbers)} of {FRAMES} on {IMAGE}" in damage[0]


def test_a_chunk_whose_length_is_wrong_is_left_out(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap")
    at, _ = chunk_places(path)[4]
    flip(path, at + 3)
    numbers, damage = _read(path)
    assert FRAMES - 4 <= len(numbers) < FRAMES and numbers[-1] == FRAMES - 1
    assert "left out" in damage[0]


def test_messages_outside_chunks_are_held_against_the_data_checksum(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", use_chunking=False, enable_data_crcs=True)
    assert _read(path) == (list(range(FRAMES)), [])
    flip(path, path.stat().st_size // 2)
    (line,) = Recording(path).damage
    assert "checksum of its data is wrong" in line


def test_counts_are_held_against_the_statistics(tmp_path: Path) -> None:
    """Messages that the writer has counted and that are in no chunk."""
    path = write(tmp_path / "a.mcap")
    data = bytearray(path.read_bytes())
    (statistics,) = [at for kind, at, _ in record_places(path) if kind == Opcode.STATISTICS]
    counts = statistics + 9 + 42 + 4  # after the record's head, the whole file's counts, the map's length
    (image,) = [at for at in (counts, counts + 10) if data[at] == 2]  # the images' channel is the second
    struct.pack_into("<Q", data, image + 2, FRAMES + 3)
    struct.pack_into("<I", data, len(data) - 12, 0)  # the summary has no checksum
    path.write_bytes(data)
    reader = DepthReader(path)
    assert len(list(reader)) == FRAMES
    assert f"{FRAMES} of {FRAMES + 3} on {IMAGE}" in reader.damage[0]


def test_cut_files_say_so_and_give_what_is_whole(tmp_path: Path) -> None:
    whole = write(tmp_path / "a.mcap").read_bytes()
    first = chunk_places(tmp_path / "a.mcap")[0]
    path = tmp_path / "cut.mcap"
    before = 0
    for size in range(first[0] + first[1] + 40, len(whole), 9973):
        path.write_bytes(whole[:size])
        numbers, damage = _read(path)
        assert numbers == list(range(len(numbers))) and len(numbers) >= before
        assert len(damage) == 1 and "ends too early" in damage[0]
        before = len(numbers)
    assert before >= FRAMES - 4


def test_damage_is_told_on_its_own_log(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = write(tmp_path / "a.mcap")
    with caplog.at_level(logging.WARNING):
        assert len(list(read_frames(path))) == FRAMES
        assert not caplog.records
        flip(path, chunk_places(path)[2][0] + 100)
        assert len(list(read_frames(path))) < FRAMES
    (record,) = caplog.records
    assert record.name == DAMAGE_LOG.name and str(path) in record.getMessage()


def test_chunks_that_overlap_in_time_come_in_order(tmp_path: Path) -> None:
    import mcap.writer

    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        writer = mcap.writer.Writer(stream, chunk_size=100)
        writer.start()
        channel = writer.register_channel(
            "/n", "cdr", writer.register_schema("std_msgs/msg/Int8", "ros2msg", b"int8 data")
        )
        times = np.random.default_rng(0).permutation(200).tolist()
        for time in times:
            writer.add_message(channel, time, b"%03d" % time, time)
        writer.finish()
    assert [m.log_time_ns for m in Recording(path).messages("/n")] == sorted(times)


def test_pipes_and_devices_are_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.mcap")
    for path in (tmp_path / "pipe.mcap", Path("/dev/zero"), Path("/dev/null")):
        with pytest.raises(InputError, match="a pipe, a device"):
            Recording(path)
    with pytest.raises(InputError, match="a pipe, a device"):
        Recording(tmp_path)


def _bomb(path: Path, declared: int, real: int, packed: CompressionType) -> Path:
    """A chunk that declares one size and unpacks to another, of zeros."""
    import lz4.frame
    import zstandard
    from mcap.data_stream import RecordBuilder
    from mcap.records import Chunk

    write(path, 1, use_chunking=False, **NO_INDEX)
    head = path.read_bytes()
    zeros = bytes(16 << 20)
    if packed == CompressionType.ZSTD:
        compressor = zstandard.ZstdCompressor(write_content_size=False).compressobj()
        body = b"".join(compressor.compress(zeros) for _ in range(real // len(zeros))) + compressor.flush()
        name = "zstd"
    else:
        with lz4.frame.LZ4FrameCompressor() as compressor:
            body = compressor.begin()
            body += b"".join(compressor.compress(zeros) for _ in range(real // len(zeros)))
            body += compressor.flush()
        name = "lz4"
    builder = RecordBuilder()
    Chunk(name, body, 0, 0, 0, declared).write(builder)
    data_end = next(at for kind, at, _ in record_places(path) if kind == Opcode.DATA_END)
    path.write_bytes(head[:data_end] + builder.end())
    return path


@pytest.mark.parametrize("packed", [CompressionType.LZ4, CompressionType.ZSTD])
@pytest.mark.parametrize("declared", [1 << 20, 3 << 30])
def test_a_bomb_is_not_unpacked(tmp_path: Path, declared: int, packed: CompressionType) -> None:
    """3 GiB in a small file: sizes are held before and while unpacking."""
    path = _bomb(tmp_path / "a.mcap", declared, 3 << 30, packed)
    assert path.stat().st_size < 32 << 20
    with little_memory(128):
        reader = DepthReader(path)
        assert [f.camera for f in reader] == [CAMERA]
    assert "1 damaged chunk, left out" in reader.damage[0]


@pytest.mark.parametrize("options", [{}, {"index_types": IndexType.NONE}], ids=["index", "no index"])
def test_no_flipped_bit_gives_a_wrong_frame_or_is_kept_quiet(tmp_path: Path, options: dict) -> None:
    """Anywhere in the file: all frames as they were written, or some of them and a line about it."""
    path, whole = tmp_path / "a.mcap", write(tmp_path / "whole.mcap", 6, **options).read_bytes()
    rng = np.random.default_rng(0)
    quiet = 0
    for at in rng.integers(8, len(whole), 400):
        path.write_bytes(whole)
        flip(path, int(at), int(rng.integers(8)))
        try:
            numbers, damage = _read(path)
        except InputError:
            continue
        assert damage or numbers == list(range(6)), at
        quiet += not damage
    assert quiet < 100  # what is not read, such as the message indexes


@pytest.mark.parametrize("packed", [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD])
@pytest.mark.parametrize("options", [{}, NO_INDEX], ids=["index", "no index"])
def test_no_lost_block_gives_a_wrong_frame_or_is_kept_quiet(
    tmp_path: Path, packed: CompressionType, options: dict
) -> None:
    """As disks fail: a block is zeros, noise, or what belongs elsewhere in the file."""
    whole = write(tmp_path / "whole.mcap", 6, compression=packed, **options).read_bytes()
    path, rng = tmp_path / "a.mcap", np.random.default_rng(1)
    for size in (16, 512, 4096):
        for start in rng.integers(0, len(whole) // size, 20) * size:
            other = int(rng.integers(len(whole) - size))
            for block in (bytes(size), rng.bytes(size), whole[other : other + size]):
                path.write_bytes((whole[:start] + block + whole[start + size :])[: len(whole)])
                try:
                    numbers, damage = _read(path)
                except InputError:
                    continue
                assert damage or numbers == list(range(6)), (start, size)


@pytest.mark.parametrize("options", [{}, NO_INDEX], ids=["index", "no index"])
def test_a_tail_of_zeros_is_passed_over_at_once(tmp_path: Path, options: dict) -> None:
    """As a power cut leaves it: space that was given to the file, and never written."""
    path = write(tmp_path / "a.mcap", **options)
    places = chunk_places(path)
    end = sum(places[-2])  # the last chunk is lost as well
    for size in (20 << 20, 4 << 40):
        with path.open("r+b") as stream:
            stream.truncate(end)
            stream.truncate(end + size)
        start = time.process_time()
        with little_memory(64):
            numbers, damage = _read(path)
        assert time.process_time() - start < 2.0
        assert numbers == list(range(len(numbers))) and FRAMES - 4 <= len(numbers) < FRAMES
        assert f"zeros from byte {end} on" in damage[0] and len(damage) == 1


def test_a_summary_that_is_the_whole_file_is_not_read(tmp_path: Path) -> None:
    """A sparse file of terabytes whose footer says so; the data at its beginning come out."""
    path = write(tmp_path / "a.mcap")
    data_end = next(at for kind, at, _ in record_places(path) if kind == Opcode.DATA_END)
    footer = struct.pack("<BQQQI", Opcode.FOOTER, 20, data_end, 0, 0) + b"\x89MCAP0\r\n"
    with path.open("r+b") as stream:
        stream.truncate(data_end)
        stream.seek(4 << 40)
        stream.write(footer)
    start = time.process_time()
    with little_memory(64):
        numbers, damage = _read(path)
    assert time.process_time() - start < 2.0
    assert numbers == list(range(FRAMES))
    assert "read without its index: it has 4194303 MiB, and 16 are read" in damage[0]


def test_a_hole_is_not_summed(tmp_path: Path) -> None:
    """One record of terabytes before the end of the data, whose checksum would have to be made."""
    path = write(tmp_path / "a.mcap", use_chunking=False, enable_data_crcs=True)
    data_end = next(at for kind, at, _ in record_places(path) if kind == Opcode.DATA_END)
    rest = path.read_bytes()[data_end:]
    with path.open("r+b") as stream:
        stream.truncate(data_end)
        stream.seek(data_end)
        stream.write(struct.pack("<BQ", 0x80, 4 << 40))
        stream.seek(4 << 40, 1)
        stream.write(rest)
    start = time.process_time()
    numbers, damage = _read(path)
    assert time.process_time() - start < 2.0
    assert numbers == list(range(FRAMES)) and "has holes" in damage[0]


def test_of_very_many_bad_records_the_first_are_told(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", **NO_INDEX)
    data_end = next(at for kind, at, _ in record_places(path) if kind == Opcode.DATA_END)
    path.write_bytes(path.read_bytes()[:data_end] + struct.pack("<BQ", 0x7F, 0) * 2_000_000)
    start = time.process_time()
    with little_memory(64):
        numbers, damage = _read(path)
    assert time.process_time() - start < 2.0
    assert numbers == list(range(FRAMES)) and "from byte" in damage[0] and "it is not read" in damage[0]


def test_an_index_that_names_a_chunk_many_times_is_not_followed(tmp_path: Path) -> None:
    """Or a small file could be read for ever."""
    import io
    import struct
    import zlib

    from mcap.data_stream import RecordBuilder
    from mcap.reader import make_reader

    path = write(tmp_path / "a.mcap")
    summary = make_reader(io.BytesIO(path.read_bytes())).get_summary()
    start, _ = summary_place(path)
    builder = RecordBuilder()
    for chunk in summary.chunk_indexes[:1] * 5000:
        chunk.write(builder)
    summary.statistics.chunk_count = 5000
    for record in (*summary.schemas.values(), *summary.channels.values(), summary.statistics):
        record.write(builder)
    body = builder.end()
    footer = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, 0)
    end = footer + struct.pack("<I", zlib.crc32(footer, zlib.crc32(body))) + b"\x89MCAP0\r\n"
    path.write_bytes(path.read_bytes()[:start] + body + end)
    numbers, damage = _read(path)
    assert numbers == list(range(FRAMES))
    assert "lists chunks twice" in damage[0]
