"""SQLite files that compute, and bags whose index leads astray: one line, soon, in little memory."""

from __future__ import annotations

import sqlite3
import struct
import tempfile
import time
from contextlib import closing
from pathlib import Path

import pytest
from damaged import IMAGE, INFO, messages
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from depth_pose.core.errors import InputError
from depth_pose.io.bounded_bag import BoundedReader
from depth_pose.io.recording import Recording
from little_memory import little_memory

JAZZY, NOETIC = get_typestore(Stores.ROS2_JAZZY), get_typestore(Stores.ROS1_NOETIC)
MOST_S, MOST_MB = 5.0, 300

ENDLESS = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c)"


def _db3(folder: Path) -> Path:
    with Writer2(folder / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connections = {}
        for topic, kind, ns, data in messages(3):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=JAZZY)
            writer.write(connections[topic], ns, data)
    return folder / "bag" / "bag.db3"


def _change(path: Path, *statements: str) -> None:
    with closing(sqlite3.connect(path)) as database:
        database.execute("BEGIN")
        for statement in statements:
            database.execute(statement)
        database.commit()


def _read(path: Path) -> int:
    """Read all messages within the bounds; returns how many there are."""
    Recording(path.parent / "whole.db3")  # what is imported once is not counted
    start = time.process_time()
    try:
        with little_memory(MOST_MB):
            recording = Recording(path)
            return sum(1 for _ in recording.messages(*recording.topics))
    finally:
        assert time.process_time() - start < MOST_S


HOSTILE = {
    "definitions that never end": (
        (
            "DROP TABLE message_definitions",
            "CREATE VIEW message_definitions AS "
            f"{ENDLESS} SELECT x AS id, 'a' AS topic_type, 'ros2msg' AS encoding, "
            "'b' AS encoded_message_definition, '' AS type_description_hash FROM c",
        ),
        "'message_definitions' is a view that runs code",
    ),
    "messages that never end": (
        (
            "DROP TABLE messages",
            f"CREATE VIEW messages AS {ENDLESS} "
            "SELECT x AS id, 1 AS topic_id, x AS timestamp, zeroblob(1000000000) AS data FROM c",
        ),
        "'messages' is a view",
    ),
    "a schema that is a view": (
        (
            "DROP TABLE schema",
            f"CREATE VIEW schema AS {ENDLESS} SELECT max(x) AS schema_version, '' AS ros_distro FROM c",
        ),
        "'schema' is a view",
    ),
    "a generated column": (
        ("ALTER TABLE topics ADD COLUMN more BLOB GENERATED ALWAYS AS (zeroblob(900000000)) VIRTUAL",),
        "'topics' is a table that runs code",
    ),
    "a generated column without the words": (
        ("ALTER TABLE message_definitions ADD COLUMN more AS (hex(zeroblob(400000000)))",),
        "'message_definitions' is a table that runs code",
    ),
    "a trigger": (
        ("CREATE TRIGGER t AFTER INSERT ON messages BEGIN DELETE FROM messages; END",),
        "'t' is a trigger",
    ),
    "a virtual table": (("CREATE VIRTUAL TABLE v USING fts5(a)",), "'v' is a virtual table"),
    "an index of expressions": (
        ("CREATE INDEX i ON messages (length(data) * 2)",),
        "'i' is an index that runs code",
    ),
    "very many tables": (
        tuple(f"CREATE TABLE t{i}(a)" for i in range(300)),
        "at most 200 tables",
    ),
    "a message of a gigabyte": (
        ("UPDATE messages SET data = zeroblob(900000000) WHERE id = 1",),
        "a message has 858 MiB; at most 128 are read",
    ),
    "messages that are text": (
        ("UPDATE messages SET data = 'text' WHERE id = 1",),
        "1 of its messages are not bytes",
    ),
    "times that are text": (
        ("UPDATE messages SET timestamp = 'noon' WHERE id = 1",),
        "1 of its messages are not bytes with a time",
    ),
    "topics that are blobs": (
        ("UPDATE messages SET topic_id = zeroblob(100000000)",),
        "6 of its messages are not bytes with a time and a topic",
    ),
    "a topic without a name": (
        ("UPDATE topics SET name = x'00' WHERE id = 1",),
        "a topic has no number, name",
    ),
    "definitions of half a gigabyte": (
        tuple(
            "INSERT INTO message_definitions(topic_type, encoding, encoded_message_definition, "
            "type_description_hash) VALUES ('a', 'ros2msg', CAST(zeroblob(100000000) AS TEXT), '')"
            for _ in range(2)
        ),
        "topics or definitions have over 16 MB",
    ),
    "a name of a hundred megabytes": (
        ("UPDATE topics SET name = CAST(zeroblob(100000000) AS TEXT) WHERE id = 1",),
        "topics or definitions have over 16 MB",
    ),
    "very many topics": (
        (
            f"INSERT INTO topics SELECT x, '/t' || x, 'a/msg/B', 'cdr', '', '' FROM ({ENDLESS} "
            "SELECT x FROM c LIMIT 20000) WHERE x > 9",
        ),
        "over 10000 topics",
    ),
    "very long qualities of service": (
        ("UPDATE topics SET offered_qos_profiles = '- ' || hex(zeroblob(300000))",),
        "offered_qos_profiles have over 512 kB",
    ),
    "qualities of service like a bomb": (
        (
            "UPDATE topics SET offered_qos_profiles = "
            "'a0: &a0 {x: 1}' || char(10) || "
            + " || ".join(
                f"'a{i}: &a{i} {{<<: [{','.join([f'*a{i - 1}'] * 9)}]}}' || char(10)" for i in range(1, 30)
            ),
        ),
        "offered_qos_profiles",
    ),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_database_that_is_more_than_tables_is_refused(tmp_path: Path, name: str) -> None:
    statements, says = HOSTILE[name]
    path = _db3(tmp_path)
    (path.parent / "whole.db3").write_bytes(path.read_bytes())
    assert _read(path) == 6
    _change(path, *statements)
    with pytest.raises(InputError, match=says) as found:
        _read(path)
    assert str(found.value).startswith(str(path)) and "\n" not in str(found.value)


def test_the_tables_of_older_and_newer_recorders_are_read(tmp_path: Path) -> None:
    """SQLite's own tables of statistics, and indexes that it makes itself."""
    path = _db3(tmp_path)
    (path.parent / "whole.db3").write_bytes(path.read_bytes())
    _change(path, "CREATE TABLE more(a TEXT UNIQUE, b INTEGER PRIMARY KEY AUTOINCREMENT)", "ANALYZE")
    assert _read(path) == 6


# ROS 1 bags


def _bag(path: Path, packed: Writer1.CompressionFormat | None = None, frames: int = 3) -> Path:
    writer = Writer1(path)
    if packed is not None:
        writer.set_compression(packed)
    writer.chunk_threshold = 10_000
    with writer:
        connections = {}
        for topic, kind, ns, data in messages(frames):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=NOETIC)
            writer.write(connections[topic], ns, bytes(JAZZY.cdr_to_ros1(data, kind)))
    return path


def _record(data: bytes, **fields: bytes) -> bytes:
    head = b"".join(
        struct.pack("<I", len(name) + 1 + len(value)) + name.encode() + b"=" + value
        for name, value in fields.items()
    )
    return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data


def _u32(value: int) -> bytes:
    return struct.pack("<I", value)


def _built(path: Path, index: bytes, chunk: bytes, infos: int, packed: bytes = b"none") -> Path:
    """A bag of one chunk, an index of it, and as many infos that name it."""
    head_size = 4096

    def head(index_at: int) -> bytes:
        fields = {"op": b"\x03", "conn_count": _u32(1), "chunk_count": _u32(infos)}
        record = _record(b"", **fields, index_pos=struct.pack("<Q", index_at))
        return record[:-4] + _u32(head_size - len(record)) + b" " * (head_size - len(record))

    body = _record(chunk, op=b"\x05", compression=packed, size=_u32(len(chunk))) + index
    kind = {"topic": IMAGE.encode(), "type": b"sensor_msgs/Image"}
    text = {"md5sum": b"060021388200f6f0f447d0fcd9c64743", "message_definition": b""}
    about = b"".join(_u32(len(n) + 1 + len(v)) + n.encode() + b"=" + v for n, v in {**kind, **text}.items())
    connection = _record(about, op=b"\x07", conn=_u32(0), topic=IMAGE.encode())
    start = len(b"#ROSBAG V2.0\n") + head_size
    info = _record(
        _u32(0) + _u32(1), op=b"\x06", ver=_u32(1), chunk_pos=struct.pack("<Q", start),
        start_time=bytes(8), end_time=bytes(8), count=_u32(1),
    )  # fmt: skip
    path.write_bytes(b"#ROSBAG V2.0\n" + head(start + len(body)) + body + connection + info * infos)
    return path


def _index(count: int, offset: int = 0) -> bytes:
    entries = struct.pack("<III", 0, 0, offset) * count
    return _record(entries, op=b"\x04", ver=_u32(1), conn=_u32(0), count=_u32(count))


def _message(size: int) -> bytes:
    return _record(bytes(size), op=b"\x02", conn=_u32(0), time=bytes(8))


def test_bags_are_built_as_rosbags_reads_them(tmp_path: Path) -> None:
    with BoundedReader(_built(tmp_path / "a.bag", _index(1), _message(100), 1)) as reader:
        ((connection, ns, data),) = reader.messages()
    assert (connection.topic, ns, data) == (IMAGE, 0, bytes(100))


def _hostile_bag(path: Path, name: str) -> Path:
    if name == "an index of gigabytes":
        return _built(path, _index(2_000_000), _message(8), 1)
    if name == "a chunk that is named often":
        return _built(path, _index(1000), _message(8), 100_000)
    if name == "a message that is named often":
        return _built(path, _index(1_000_000), _message(1 << 20), 1)
    if name == "a message that is named twice":
        return _built(path, _index(80_000), _message(1 << 20), 1)
    _bag(path)
    with path.open("r+b") as stream:  # a sparse file, whose first record is 3 GiB
        stream.seek(13)
        stream.write(_u32(3 << 30))
        stream.truncate(4 << 30)
    return path


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("an index of gigabytes", "its index has more than 11 MiB"),
        ("a chunk that is named often", "its index has more than 5 MiB"),
        ("a message that is named often", "its index has more than 6 MiB"),
        ("a record of gigabytes", "a record of 3221225472 bytes is more than the 128 MiB allowed"),
    ],
)
def test_a_bag_that_asks_for_too_much_is_refused(tmp_path: Path, name: str, says: str) -> None:
    (tmp_path / "whole.db3").write_bytes(_db3(tmp_path).read_bytes())
    with pytest.raises(InputError, match=says) as found:
        _read(_hostile_bag(tmp_path / "a.bag", name))
    assert "\n" not in str(found.value)


def test_an_index_that_names_a_message_often_is_not_followed(tmp_path: Path) -> None:
    path = _hostile_bag(tmp_path / "a.bag", "a message that is named twice")
    start = time.process_time()
    with little_memory(MOST_MB + 100), BoundedReader(path) as reader:
        count = 0
        with pytest.raises(Exception, match="lists messages twice"):
            for _ in reader.messages():
                count += 1
    assert count == 1
    assert time.process_time() - start < 2 * MOST_S


@pytest.mark.parametrize("packed", [Writer1.CompressionFormat.BZ2, Writer1.CompressionFormat.LZ4])
def test_a_chunk_that_unpacks_to_gigabytes_is_not_unpacked(
    tmp_path: Path, packed: Writer1.CompressionFormat
) -> None:
    import bz2

    import lz4.frame

    block = bytes(64 << 20)
    if packed == Writer1.CompressionFormat.BZ2:
        compressor = bz2.BZ2Compressor(1)
        bomb = compressor.compress(bytes(160 << 20)) + compressor.flush()
    else:
        with lz4.frame.LZ4FrameCompressor() as small:
            bomb = small.begin() + b"".join(small.compress(block) for _ in range(40)) + small.flush()
    path = _built(tmp_path / "a.bag", _index(1), bomb, 1, packed.name.lower().encode())
    with little_memory(MOST_MB):
        recording = Recording(path)
        assert list(recording.messages(IMAGE)) == []
    assert "unpacks to more than the 128 MiB allowed" in recording.damage[0]


def test_whole_bags_of_many_chunks_pass_the_bounds(tmp_path: Path) -> None:
    recording = Recording(_bag(tmp_path / "a.bag", Writer1.CompressionFormat.LZ4, 40))
    for _ in range(3):
        assert sum(1 for _ in recording.messages(IMAGE, INFO)) == 80
    assert recording.damage == []


# Packed as a whole


def _packed(folder: Path, data: bytes, repeat: int, declared: int = -1) -> Path:
    """A recording's folder whose file unpacks to some bytes, and zeros after them."""
    import zstandard

    folder.mkdir()
    (folder / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  relative_file_paths: [a.db3.zstd]\n"
        "  topics_with_message_count: []\n  compression_mode: FILE\n"
    )
    compressor = zstandard.ZstdCompressor().compressobj(size=declared)
    parts = [compressor.compress(data), *(compressor.compress(bytes(1 << 20)) for _ in range(repeat))]
    end = zstandard.COMPRESSOBJ_FLUSH_FINISH if declared < 0 else zstandard.COMPRESSOBJ_FLUSH_BLOCK
    parts.append(compressor.flush(end))
    (folder / "a.db3.zstd").write_bytes(b"".join(parts))
    return folder


@pytest.mark.parametrize(
    ("data", "repeat", "declared", "says"),
    [
        (b"", 2000, -1, "the compressed file is not a recording"),
        (b"SQLite format 3\0", 2000, -1, "unpacks to over 200 times its size"),
        (b"SQLite format 3\0", 1, 4 << 40, "unpacks to over 200 times its size"),
    ],
    ids=["zeros", "a database of zeros", "declared"],
)
def test_a_packed_file_of_gigabytes_is_refused_before_it_fills_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, data: bytes, repeat: int, declared: int, says: str
) -> None:
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    folder = _packed(tmp_path / "bag", data, repeat, declared)
    start = time.process_time()
    with little_memory(MOST_MB), pytest.raises(InputError, match=says) as found:
        Recording(folder)
    assert time.process_time() - start < MOST_S
    assert "\n" not in str(found.value)
    assert not [path for path in (tmp_path / "tmp").rglob("*") if path.is_file()]
