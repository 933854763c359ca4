"""One SQLite file of rosbag2 (``.db3``): its topics, and its messages by log time.

It has tables ``topics`` (name, type, serialization_format, offered_qos_profiles) and ``messages`` (topic_id,
timestamp, data). SQLite has no checksums: a changed byte inside a message is not noticed.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import closing
from pathlib import Path

from depth_pose.core.errors import InputError
from depth_pose.io._topics import MAX_CHUNK, RawMessage, Topic, counted

MAGIC = b"SQLite format 3\x00"


class Db3File:
    """A SQLite file of rosbag2.

    Parameters
    ----------
    path : Path
        The file; its first bytes are those of one.

    Attributes
    ----------
    topics : list of Topic
        Those in ROS 2's encoding.
    others : dict of str to str
        Topics in another encoding, and in which.

    Raises
    ------
    InputError
        Where it is a database of something else, or cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topics: list[Topic] = []
        self.others: dict[str, str] = {}
        self._numbers: dict[int, str] = {}
        self._fault = ""
        try:
            with closing(self._connect()) as database:
                self._check(database)
                self._list_topics(database)
        except (sqlite3.Error, ValueError, TypeError) as error:
            raise InputError(
                f"{path} is damaged, or ends too early: {error}; "
                "'sqlite3 FILE .recover | sqlite3 NEW.db3' saves what can be"
            ) from error

    def _connect(self) -> sqlite3.Connection:
        """Open for reading only, with a limit on sizes."""
        alone = not self.path.with_name(f"{self.path.name}-wal").exists()
        uri = f"{self.path.absolute().as_uri()}?mode=ro{'&immutable=1' if alone else ''}"
        database = sqlite3.connect(uri, uri=True, check_same_thread=False)
        database.execute("PRAGMA trusted_schema = OFF")
        if hasattr(database, "setlimit"):  # Python 3.11
            database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_CHUNK)
        return database

    def _check(self, database: sqlite3.Connection) -> None:
        """Hold that both tables are plain ones: a view may be anything, and endless."""
        for name in ("topics", "messages"):
            query = "SELECT type, sql FROM sqlite_master WHERE name = ?"
            found = database.execute(query, (name,)).fetchone()
            if found is None or found[0] != "table" or not str(found[1]).upper().startswith("CREATE TABLE"):
                raise InputError(f"{self.path} is an SQLite file, but not rosbag2's: it has no table {name}")

    def _list_topics(self, database: sqlite3.Connection) -> None:
        columns = {row[1] for row in database.execute("PRAGMA table_info(topics)")}
        qos = "offered_qos_profiles" if "offered_qos_profiles" in columns else "''"
        rows = database.execute(f"SELECT id, name, type, serialization_format, {qos} FROM topics").fetchall()
        definitions = self._definitions(database)
        counts = self._counts(database)
        for number, name, kind, encoding, offered in rows:
            if encoding != "cdr":
                self.others[str(name)] = str(encoding)
                continue
            self._numbers[int(number)] = str(name)
            count, text = counts.get(number, 0), definitions.get(kind, "")
            self.topics.append(Topic(str(name), str(kind), count, text, str(offered or "")))

    def _definitions(self, database: sqlite3.Connection) -> dict[str, str]:
        try:
            query = "SELECT topic_type, encoded_message_definition FROM message_definitions"
            return {str(kind): str(text) for kind, text in database.execute(query)}
        except sqlite3.Error:  # older files have no such table
            return {}

    def _counts(self, database: sqlite3.Connection) -> dict[int, int]:
        """Count the messages of each topic, as far as can be."""
        counts: dict[int, int] = {}
        try:
            for (number,) in database.execute("SELECT topic_id FROM messages"):
                counts[number] = counts.get(number, 0) + 1
        except sqlite3.Error as error:
            self._fault = str(error)
        return counts

    def messages(self, topics: Iterable[str]) -> Iterator[RawMessage]:
        """Give the topics' messages by log time; those of one time in the file's order."""
        wanted = set(topics)
        numbers = {n: name for n, name in self._numbers.items() if name in wanted}
        places = ", ".join("?" * len(numbers))
        query = f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({places})"
        read = 0
        try:
            with closing(self._connect()) as database:
                for number, ns, data in database.execute(f"{query} ORDER BY timestamp, id", list(numbers)):
                    if not isinstance(data, bytes) or not isinstance(ns, int):
                        self._fault = "a message is not bytes"
                        continue
                    read += 1
                    yield RawMessage(numbers[number], ns, data)
        except sqlite3.Error as error:
            self._fault = f"{error}, after {counted(read, 'message')}"

    @property
    def damage(self) -> list[str]:
        """What could not be read, as far as reading has come: one line, or none."""
        return [f"{self.path} is damaged: {self._fault}"] if self._fault else []
