"""Recordings that are well formed and odd: what a mutation of bytes hardly ever makes.

The bytes of an input choose the changes: tables that compute and values of other types in SQLite files;
records of MCAP files and ROS 1 bags that are twice there, gone, exchanged, zeros, or whose numbers are at the
ends of their ranges.
"""

from __future__ import annotations

import sqlite3
import struct
import time
import zlib
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path

import numpy as np
from decoders_recordings import bags, databases, mcaps, read_everything
from harness import Decoder, from_file

Rng = np.random.Generator

ENDLESS = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c)"
VALUES = [
    *("NULL", "-1", "0", "9223372036854775807", "1e308", "''", "'text'", "x'00'"),
    *("zeroblob(1000000)", "zeroblob(140000000)", "'- {durability: [[[[1]]]]}'", "'&a [*a]'"),
    *("char(27) || '[2J'", "'/' || char(10)"),
]
COLUMNS = {
    "topics": ["id", "name", "type", "serialization_format", "offered_qos_profiles"],
    "messages": ["id", "topic_id", "timestamp", "data"],
}
_UNCHANGED = bytes(range(64))
NUMBERS = (0, 1, 2, 7, 255, 4096, 2**16, 2**24 - 1, 2**31 - 1, 2**32 - 1)


def _pick(rng: Rng, of: list[str]) -> str:
    return of[int(rng.integers(len(of)))]


def _statement(rng: Rng) -> str:
    """Make a change of a database, that may fail."""
    table = _pick(rng, list(COLUMNS))
    column, value = _pick(rng, COLUMNS[table]), _pick(rng, VALUES)
    new = f"t{rng.integers(100)}"
    known = _pick(rng, [new, table, "schema", "message_definitions"])
    return _pick(
        rng,
        [
            f"UPDATE {table} SET {column} = {value} WHERE id = {rng.integers(4)}",
            f"UPDATE OR IGNORE {table} SET {column} = {value}",
            f"ALTER TABLE {table} ADD COLUMN {new} AS ({value}) VIRTUAL",
            f"ALTER TABLE {table} ADD COLUMN {new} DEFAULT {value}",
            f"ALTER TABLE {table} DROP COLUMN {column}",
            f"ALTER TABLE {table} RENAME COLUMN {column} TO {new}",
            f"ALTER TABLE {table} RENAME TO {new}",
            f"DROP TABLE {table}",
            f"DELETE FROM {table} WHERE id = {rng.integers(4)}",
            f"CREATE VIEW {known} AS {ENDLESS} SELECT * FROM c",
            f"CREATE VIEW {new} AS SELECT {value} AS a",
            f"CREATE TRIGGER {new} AFTER INSERT ON {table} BEGIN DELETE FROM {table}; END",
            f"CREATE VIRTUAL TABLE {new} USING fts5(a)",
            f"CREATE INDEX {new} ON {table} ({column})",
            f"CREATE INDEX {new} ON {table} (length({column}))",
            f"CREATE INDEX {new} ON {table} ({column}) WHERE {column} > {value}",
            "CREATE TABLE schema(schema_version, ros_distro)",
            f"INSERT INTO schema VALUES ({value}, {value})",
            "CREATE TABLE message_definitions(id, topic_type, encoding, encoded_message_definition, "
            "type_description_hash)",
            f"INSERT INTO message_definitions VALUES (1, 'a', {_pick(rng, ['ros2msg', 'x'])!r}, {value}, '')",
            f"INSERT INTO topics SELECT x + 9, {_pick(rng, VALUES[:8])}, 'a/msg/B', 'cdr', '' FROM "
            f"({ENDLESS} SELECT x FROM c LIMIT {_pick(rng, ['3', '20000'])})",
            f"PRAGMA application_id = {rng.integers(1 << 31)}",
            "PRAGMA journal_mode = WAL",
            "ANALYZE",
        ],
    )


def _chooser(path: Path) -> tuple[Rng, bool]:
    """Return a random generator seeded by the input, and whether anything is to be changed."""
    given = path.read_bytes()
    return np.random.default_rng(zlib.crc32(given)), given != _UNCHANGED


def _odd_database(path: Path) -> None:
    """Read a sound database with one to four changes."""
    rng, is_odd = _chooser(path)
    path.write_bytes(databases()[0])
    end = time.monotonic() + 1.0  # some of these statements would never end
    with closing(sqlite3.connect(path)) as database:
        database.set_progress_handler(lambda: time.monotonic() > end, 100)
        database.execute("PRAGMA max_page_count = 60000")
        for _ in range(int(rng.integers(1, 5)) if is_odd else 0):
            with suppress(sqlite3.Error):
                database.execute(_statement(rng))
                database.commit()
    read_everything(path)


def _change_records(records: list[bytes], rng: Rng, patch: Callable[[bytes, Rng], bytes]) -> list[bytes]:
    """Change some of a file's records."""
    for _ in range(int(rng.integers(1, 4))):
        i, j = (int(k) for k in rng.integers(len(records), size=2))
        kind = int(rng.integers(7))
        if kind == 0:
            records.insert(i, records[j])
        elif kind == 1:
            records[i] = b""
        elif kind == 2:
            records[i], records[j] = records[j], records[i]
        elif kind == 3:
            records.insert(i, bytes(int(rng.integers(1, 1 << 20))))
        elif kind == 4:
            records[i:] = [bytes(int(rng.integers(1, 8 << 20)))]
        else:
            records[i] = patch(records[i], rng)
    return records


def _patch_mcap(record: bytes, rng: Rng) -> bytes:
    """Set an aligned number within a record to one at the end of its range."""
    if len(record) < 20:
        return record
    data, wide = bytearray(record), int(rng.choice([2, 4, 8]))
    at = int(rng.choice([1, 9, 11, 13, 17, 21, 25, int(rng.integers(1, len(record) - 8))]))
    number = int(rng.choice(NUMBERS)) << int(rng.choice([0, 0, 8, 31]))
    if at + wide <= len(data):
        data[at : at + wide] = number.to_bytes(16, "little")[:wide]
    return bytes(data)


def _odd_mcap(path: Path) -> None:
    """Read an MCAP file some of whose records were changed; its index has no checksum."""
    rng, is_odd = _chooser(path)
    seeds = mcaps()
    data, at, records = seeds[int(rng.integers(len(seeds)))], 8, []
    while at < len(data) - 8:
        (length,) = struct.unpack_from("<Q", data, at + 1)
        records.append(data[at : at + 9 + length])
        at += 9 + length
    records[-1] = records[-1][:-4] + bytes(4)
    if is_odd:
        records = _change_records(records, rng, _patch_mcap)
    path.write_bytes(data[:8] + b"".join(records) + data[-8:])
    read_everything(path)


def _patch_bag(record: bytes, rng: Rng) -> bytes:
    """Set a field of a record's header, or a number of its data, to one at the end of its range."""
    names = (
        b"conn=",
        b"count=",
        b"size=",
        b"time=",
        b"chunk_pos=",
        b"index_pos=",
        b"conn_count=",
        b"chunk_count=",
    )
    found = [record.index(name) + len(name) for name in names if name in record]
    at = int(rng.choice([*found, int(rng.integers(max(len(record) - 4, 1)))]))
    return record[:at] + struct.pack("<I", int(rng.choice(NUMBERS))) + record[at + 4 :]


def _odd_bag(path: Path) -> None:
    """Read a bag some of whose records were changed; half the time its header says where the index is now."""
    rng, is_odd = _chooser(path)
    seeds = bags()
    data, at, records = seeds[int(rng.integers(len(seeds)))], 13, []
    (index_at,) = struct.unpack_from("<Q", data, data.index(b"index_pos=") + 10)
    kept = 0
    while at < len(data):
        (head,) = struct.unpack_from("<I", data, at)
        (size,) = struct.unpack_from("<I", data, at + 4 + head)
        records.append(data[at : at + 8 + head + size])
        kept += at < index_at
        at += 8 + head + size
    before, after = records[:kept], records[kept:]
    part = before if rng.integers(2) else after
    if is_odd:
        part[:] = _change_records(list(part), rng, _patch_bag)
    if rng.integers(2) and before and b"index_pos=" in before[0]:
        place = before[0].index(b"index_pos=") + 10
        now = struct.pack("<Q", 13 + sum(map(len, before)))
        before[0] = before[0][:place] + now + before[0][place + 8 :]
    path.write_bytes(data[:13] + b"".join(before + after))
    read_everything(path)


def _numbers() -> list[bytes]:
    """Bytes that choose."""
    return [_UNCHANGED]


DECODERS = (
    Decoder("db3_schema", _numbers, from_file(_odd_database, "odd.db3")),
    Decoder("mcap_records", _numbers, from_file(_odd_mcap, "odd.mcap")),
    Decoder("ros1_records", _numbers, from_file(_odd_bag, "odd.bag")),
)
