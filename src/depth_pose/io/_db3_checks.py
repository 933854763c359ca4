"""Checks of an SQLite file before rosbags reads it: plain tables of bounded size, nothing executable.

Views, triggers, virtual tables and generated columns run code of the recording's author. rosbag2 creates none
of them; a file with one is refused before a query touches its tables.
"""

from __future__ import annotations

import shutil
import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.reading import parse_long_yaml
from depth_pose.io._rosbag2_folder import LEFT_FREE
from depth_pose.io._topics import MAX_CHUNK

_MOST_SCHEMA = 200
"""Maximum number of tables and indexes; rosbag2's files have seven."""

_MOST_TEXT = 16 << 20
"""Maximum number of characters of topics and of definitions; 500 types have 2 MB."""

_MOST_ROWS = 10_000
"""Maximum number of topics, and of definitions."""

_MOST_QOS = 512 << 10
"""Maximum number of characters of all ``offered_qos_profiles``, which rosbags parses slowly (2 s): those
of 2,000 publishers."""

_SCHEMA_S = 1.0
"""Maximum time (s) for reading the schema."""

_STEPS = 10_000
"""Steps of SQLite's virtual machine between time checks, about a millisecond."""


def checked_reader(path: Path) -> tuple[Any, TemporaryDirectory[str] | None]:
    """Check a .db3 file, and open the rosbags reader on it.

    rosbags supports neither a write-ahead log (``-wal``) nor definitions in an unknown encoding, and parses
    names as URIs. Such a file is copied or linked into a temporary folder.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    reader : rosbags.rosbag2.Reader
    folder : TemporaryDirectory or None
        Must be kept as long as the reader.

    Raises
    ------
    InputError
        If a check fails.
    sqlite3.Error
        If the file is damaged.
    """
    from rosbags.rosbag2 import Reader

    with closing(_connect(path)) as database:
        tables = _check_schema(path, database)
        known = _check_texts(path, database, tables)
        _check_messages(path, database)
        log = path.with_name(f"{path.name}-wal")
        must_copy = not known or (log.exists() and log.stat().st_size > 0)
        if not must_copy and path.suffix == ".db3" and not set("?#%") & set(str(path)):
            return Reader(path), None
        folder = TemporaryDirectory(prefix="depth_pose_")
        inside = Path(folder.name) / "recording.db3"
        if must_copy:
            _copy(path, database, inside)
        else:
            inside.symlink_to(path.absolute())
        return Reader(inside), folder


def _connect(path: Path) -> sqlite3.Connection:
    """Open a database read-only, with limits on sizes."""
    alone = not path.with_name(f"{path.name}-wal").exists()
    uri = f"{path.absolute().as_uri()}?mode=ro{'&immutable=1' if alone else ''}"
    database = sqlite3.connect(uri, uri=True)
    database.execute("PRAGMA trusted_schema = OFF")
    if hasattr(database, "setlimit"):  # since Python 3.11
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _MOST_TEXT)  # messages are never loaded
    return database


def _check_schema(path: Path, database: sqlite3.Connection) -> set[str]:
    """Check that there are only plain tables and indexes; return the names of the tables."""
    end = time.monotonic() + _SCHEMA_S
    database.set_progress_handler(lambda: time.monotonic() > end, _STEPS)
    rows = database.execute(f"SELECT type, name, sql FROM sqlite_master LIMIT {_MOST_SCHEMA + 1}").fetchall()
    if len(rows) > _MOST_SCHEMA:
        raise InputError(f"{path} is refused: a recording has at most {_MOST_SCHEMA} tables and indexes")
    tables = {str(name) for kind, name, _ in rows if kind == "table"}
    for kind, name, sql in rows:
        is_virtual = kind == "table" and not str(sql).upper().startswith("CREATE TABLE")
        if kind not in ("table", "index") or is_virtual or _computes(database, kind, name):
            what = (
                "a virtual table"
                if is_virtual
                else {"table": "a table", "index": "an index"}.get(kind, f"a {kind}")
            )
            raise InputError(f"{path} is refused: {name!r} is {what} that runs code; recordings have none")
    for wanted in ("topics", "messages"):
        if wanted not in tables:
            raise InputError(f"{path} is an SQLite file, but not rosbag2's: it has no table {wanted}")
    database.set_progress_handler(None, 0)
    return tables


def _computes(database: sqlite3.Connection, kind: str, name: str) -> bool:
    """Check whether a table has generated or hidden columns, or an index has expressions."""
    if kind == "table":
        columns = database.execute("SELECT hidden FROM pragma_table_xinfo(?)", (name,))
        return any(hidden for (hidden,) in columns)
    return any(cid == -2 for (cid,) in database.execute("SELECT cid FROM pragma_index_xinfo(?)", (name,)))


def _check_texts(path: Path, database: sqlite3.Connection, tables: set[str]) -> bool:
    """Check the sizes of topics and definitions; return whether rosbags supports all encodings."""
    left = _MOST_QOS
    for row in _bounded(path, database, "SELECT * FROM topics"):
        left -= len(_checked_qos(path, dict(row)))
        if left < 0:
            raise InputError(f"{path} is refused: offered_qos_profiles have over {_MOST_QOS >> 10} kB")
    if "message_definitions" not in tables:
        return True
    known = ("ros2msg", "ros2idl")
    definitions = _bounded(path, database, "SELECT * FROM message_definitions")
    return all([row["encoding"] in known for row in definitions])  # a list, so that all are checked


def _checked_qos(path: Path, topic: dict[str, Any]) -> str:
    """Check the types of a topic's values, and that its YAML is safe to parse; return the YAML."""
    named = [topic.get(column) for column in ("name", "type", "serialization_format")]
    if not isinstance(topic.get("id"), int) or not all(isinstance(text, str) for text in named):
        raise InputError(f"{path} is damaged: a topic has no number, name, type or format")
    offered = str(topic.get("offered_qos_profiles") or "")
    try:
        parse_long_yaml(path, offered)
    except ConfigError as error:
        raise InputError(f"{path} is damaged: offered_qos_profiles of a topic: {error}") from error
    return offered


def _bounded(path: Path, database: sqlite3.Connection, query: str) -> Iterator[sqlite3.Row]:
    """Yield a query's rows, up to `_MOST_TEXT` characters."""
    cursor = database.cursor()
    cursor.row_factory = sqlite3.Row
    left = _MOST_TEXT
    too_long = InputError(f"{path} is refused: its topics or definitions have over {_MOST_TEXT >> 20} MB")
    try:
        for number, row in enumerate(cursor.execute(query)):
            if number == _MOST_ROWS:
                raise InputError(f"{path} is refused: it has over {_MOST_ROWS} topics or definitions")
            left -= sum(len(value) if isinstance(value, str | bytes) else 8 for value in row)
            if left < 0:
                raise too_long
            yield row
    except sqlite3.DataError as error:  # the connection's own limit
        raise too_long from error


def _check_messages(path: Path, database: sqlite3.Connection) -> None:
    """Check the type and size of messages, without loading them."""
    plain = "typeof(data) = 'blob' AND typeof(timestamp) = 'integer' AND typeof(topic_id) = 'integer'"
    query = f"SELECT max(CASE WHEN {plain} THEN length(data) END), sum(NOT ({plain})) FROM messages"
    largest, wrong = database.execute(query).fetchone()
    if wrong:
        raise InputError(f"{path} is damaged: {wrong} of its messages are not bytes with a time and a topic")
    if largest is not None and largest > MAX_CHUNK:
        most = MAX_CHUNK >> 20
        raise InputError(f"{path} is refused: a message has {largest >> 20} MiB; at most {most} are read")


def _copy(path: Path, database: sqlite3.Connection, target: Path) -> None:
    """Copy a database including its write-ahead log, without definitions that rosbags does not support."""
    (pages,), (size,) = (
        database.execute(f"PRAGMA {name}").fetchone() for name in ("page_count", "page_size")
    )
    if pages * size > shutil.disk_usage(target.parent).free - LEFT_FREE:
        raise InputError(f"{path} cannot be copied: the disk of {target.parent} has too little space")
    with closing(sqlite3.connect(target)) as copy:
        database.backup(copy)
        copy.execute("PRAGMA journal_mode = DELETE")
        if copy.execute("SELECT 1 FROM sqlite_master WHERE name = 'message_definitions'").fetchone():
            copy.execute("DELETE FROM message_definitions WHERE encoding NOT IN ('ros2msg', 'ros2idl')")
        copy.commit()
