"""One .db3 file of rosbag2, or one ROS 1 bag, read by rosbags.

rosbags needs a whole index or table: a bag that was not closed and a database with a damaged page are refused
with what repairs them. What it takes on trust is checked first (`_db3_checks`) or bounded (`_bounded_bag`).
Neither format has checksums: a changed byte inside a message is not noticed.
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

_DB3_REPAIR = "'sqlite3 FILE .recover | sqlite3 NEW.db3' saves what can be"
_BAG_REPAIR = "ROS 1's 'rosbag reindex FILE' makes the index anew"


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
        Topics whose messages are, or become, ROS 2's.
    others : dict of str to str
        The other topics, and why they cannot be read.

    Raises
    ------
    InputError
        Where it is damaged, refused by a check, or holds something else.
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
        from depth_pose.io import _bounded_bag, _db3_checks

        try:
            if self._is_bag:
                reader: Any = _bounded_bag.BoundedReader(self.path)
            else:
                reader, self._folder = _db3_checks.checked_reader(self.path)
            reader.open()
        except (DepthPoseError, MemoryError):
            raise
        except DamageError as error:
            raise InputError(f"{self.path} is refused: {error}") from error
        except Exception as error:  # rosbags raises a dozen kinds
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
        """Say why a connection's messages cannot be read; empty where they can."""
        if self._is_bag:
            return why_not(connection.msgtype, connection.digest)
        encoding = str(getattr(connection.ext, "serialization_format", ""))
        return "" if encoding == "cdr" else encoding or "an encoding that is not said"

    def _qos(self, connection: Connection) -> str:
        """Return what publishers offered, as rosbag2 writes it (YAML), as far as players need it."""
        offered = getattr(connection.ext, "offered_qos_profiles", ())
        return "\n".join(f"- durability: {profile.durability.name.lower()}" for profile in offered)

    def messages(self, topics: Iterable[str]) -> Iterator[RawMessage]:
        """Give the topics' messages by log time."""
        wanted = set(topics)
        connections = [c for c in self._connections if c.topic in wanted]
        if not connections:  # rosbags would give all
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
        except Exception as error:  # rosbags raises a dozen kinds
            self._fault = f"{_said(error)}, after {counted(read, 'message')}; the rest is not read"

    def _cdr(self, data: bytes, connection: Connection) -> bytes | None:
        """Return a message as ROS 2 encodes it; None where it is not of its type."""
        try:
            return to_cdr(data, connection.msgtype) if self._is_bag else data
        except DamageError:
            return None

    @property
    def damage(self) -> list[str]:
        """What could not be read, as far as reading has come: one line, or none."""
        parts = [self._fault] if self._fault else []
        if self._bad:
            parts.append(f"{counted(self._bad, 'message')} cannot be read")
        return [f"{self.path} is damaged: {'; '.join(parts)}"] if parts else []


def _said(error: Exception) -> str:
    """Return what an error says, on one line of bounded length."""
    return " ".join(str(error).split())[:200] or type(error).__name__
