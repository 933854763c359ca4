"""One .db3 file of rosbag2, or one ROS 1 bag, read by rosbags.

rosbags needs a complete index or table. A bag that was not closed, or a database with a damaged page, is
refused with advice on how to repair it. Unsafe content is checked first (`_db3_checks`) or bounded
(`bounded_bag`). Neither format has checksums, so a changed byte inside a message is not detected.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from depth_pose.core.errors import DepthPoseError, InputError
from depth_pose.io._ros1_messages import to_cdr, why_not
from depth_pose.io._topics import DamageError, RawMessage, Topic, counted

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

_DB3_REPAIR = "'sqlite3 FILE .recover | sqlite3 NEW.db3' recovers what it can"
_BAG_REPAIR = "ROS 1's 'rosbag reindex FILE' recreates the index"


class RosbagsFile:
    """A file that rosbags reads.

    Parameters
    ----------
    path : Path
        A .db3 file or a ROS 1 bag, by its first bytes.
    is_bag : bool
        Whether it is a ROS 1 bag.

    Attributes
    ----------
    topics : list of Topic
        Topics whose messages are, or are converted to, those of ROS 2.
    others : dict of str to str
        The other topics, and why they cannot be read.

    Raises
    ------
    InputError
        If it is damaged, refused by a check, or of another format.
    """

    def __init__(self, path: Path, is_bag: bool) -> None:
        self.path = path
        self.topics: list[Topic] = []
        self.others: dict[str, str] = {}
        self._is_bag = is_bag
        self._connections: list[Connection] = []
        self._fault = ""
        self._bad = 0
        self._reader = self._open()
        self._list_topics()

    def _open(self) -> Any:
        from depth_pose.io import _db3_checks, bounded_bag

        try:
            if self._is_bag:
                reader: Any = bounded_bag.BoundedReader(self.path)
            else:
                reader, self._folder = _db3_checks.checked_reader(self.path)
            reader.open()
        except (DepthPoseError, MemoryError):
            raise
        except DamageError as error:
            raise InputError(f"{self.path} is refused: {error}") from error
        except Exception as error:  # rosbags raises a dozen exception types
            todo = _BAG_REPAIR if self._is_bag else _DB3_REPAIR
            raise InputError(f"{self.path} is damaged, or ends too early: {_said(error)}; {todo}") from error
        weakref.finalize(self, reader.close)
        return reader

    def _list_topics(self) -> None:
        topics: dict[str, Topic] = {}
        for connection in self._reader.connections:
            name, kind = str(connection.topic), str(connection.msgtype)
            reason = self._why_not(connection)
            if reason:
                self.others[name] = reason
                continue
            self._connections.append(connection)
            count = connection.msgcount + (topics[name].count if name in topics else 0)
            definition = "" if self._is_bag else str(connection.msgdef.data)
            topics[name] = Topic(name, kind, count, definition, self._qos(connection))
        self.topics = list(topics.values())

    def _why_not(self, connection: Connection) -> str:
        """Return why a connection's messages cannot be read; empty if they can."""
        if self._is_bag:
            return why_not(connection.msgtype, connection.digest)
        encoding = str(getattr(connection.ext, "serialization_format", ""))
        return "" if encoding == "cdr" else encoding or "an unspecified encoding"

    def _qos(self, connection: Connection) -> str:
        """Return the publishers' QoS as rosbag2 writes it (YAML), with the fields that players need."""
        offered = getattr(connection.ext, "offered_qos_profiles", ())
        return "\n".join(f"- durability: {profile.durability.name.lower()}" for profile in offered)

    def messages(self, topics: Iterable[str]) -> Iterator[RawMessage]:
        """Yield the topics' messages by log time."""
        wanted = set(topics)
        connections = [c for c in self._connections if c.topic in wanted]
        if not connections:  # rosbags would yield all
            return
        read = bad = 0
        try:
            for connection, ns, data in self._reader.messages(connections):
                converted = self._cdr(data, connection)
                if converted is None:
                    bad += 1
                    self._bad = max(self._bad, bad)
                    continue
                read += 1
                yield RawMessage(connection.topic, ns, converted)
        except MemoryError:
            raise
        except Exception as error:  # rosbags raises a dozen exception types
            self._fault = f"{_said(error)}, after {counted(read, 'message')}; the rest is not read"

    def _cdr(self, data: bytes, connection: Connection) -> bytes | None:
        """Return a message in ROS 2 encoding; None if it does not match its type."""
        try:
            return to_cdr(data, connection.msgtype) if self._is_bag else data
        except DamageError:
            return None

    @property
    def damage(self) -> list[str]:
        """Return the damage found so far: one line, or none."""
        parts = [self._fault] if self._fault else []
        if self._bad:
            parts.append(f"{counted(self._bad, 'message')} cannot be read")
        return [f"{self.path} is damaged: {'; '.join(parts)}"] if parts else []


def _said(error: Exception) -> str:
    """Return the text of an error, on one line of bounded length."""
    return " ".join(str(error).split())[:200] or type(error).__name__
