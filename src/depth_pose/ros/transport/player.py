"""MCAP -> topics: the recorded bytes as they are, at the recorded times, with ``/clock``."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from depth_pose.core.errors import InputError
from depth_pose.ros.process.runner import on_stop

CLOCK_HZ = 40.0
"""``/clock`` messages a second of wall time, beside one before every recorded message."""

_DEPTH = 100
_SETTLE_S, _MOST_SETTLE_S, _ACKNOWLEDGED_S = 0.2, 2.0, 5.0
_AHEAD = 32
"""Messages read ahead of their time."""


@dataclass(frozen=True)
class Recorded:
    """One message of a recording.

    Attributes
    ----------
    topic, type_name : str
    log_time_ns : int
        When it was recorded.
    data : bytes
        The message, serialised (CDR).
    """

    topic: str
    type_name: str
    log_time_ns: int
    data: bytes


@dataclass
class Played:
    """What was published.

    Attributes
    ----------
    messages : Counter
        Messages by topic, all rounds together.
    rounds : int
        Times the recording was begun.
    wall_s : float
        From the first message to the last.
    worst_delay_s : float
        Longest time by which a message came later than it should.
    truncated : bool
        Whether the file ends early; then it was played up to its last whole chunk.
    skipped : dict of str to str
        Topics that could not be played, and why.
    """

    messages: Counter[str] = field(default_factory=Counter)
    rounds: int = 0
    wall_s: float = 0.0
    worst_delay_s: float = 0.0
    truncated: bool = False
    skipped: dict[str, str] = field(default_factory=dict)


class TruncatedError(InputError):
    """The recording ends early; everything before was read."""


def read_recording(path: str | Path, topics: Sequence[str] | None = None) -> Iterator[Recorded]:
    """Give the messages of a recording in the order of their log times.

    A file without its summary (cut short, or still being written) is read in the order of
    the file.

    Raises
    ------
    InputError
        If it is no MCAP file, or holds nothing in ROS 2's encoding.
    TruncatedError
        After the last whole chunk of a file cut short.
    """
    from mcap.exceptions import EndOfFile, InvalidMagic, McapError
    from mcap.reader import NonSeekingReader, SeekingReader

    path = Path(path)
    try:
        stream = path.open("rb")
    except OSError as e:
        raise InputError(f"cannot open {path}: {e.strerror}") from e
    wanted = list(topics) if topics is not None else None
    with stream:
        try:
            whole = SeekingReader(stream).get_summary() is not None
        except (McapError, EndOfFile, ValueError):
            whole = False
        stream.seek(0)
        reader = SeekingReader(stream) if whole else NonSeekingReader(stream)
        try:
            for schema, channel, message in reader.iter_messages(topics=wanted, log_time_order=whole):
                if channel.message_encoding != "cdr" or schema is None:
                    continue
                yield Recorded(channel.topic, schema.name, message.log_time, message.data)
        except InvalidMagic as e:
            if whole:
                raise TruncatedError(f"{path} is damaged at its end") from e
            raise InputError(f"{path} is not an MCAP file") from e
        except (McapError, EndOfFile) as e:
            raise TruncatedError(f"{path} ends early; it was read up to its last whole chunk") from e


class Player:
    """Publishes a recording; sets nothing but ``/clock``.

    Parameters
    ----------
    path : path
        MCAP file with messages in CDR.
    rate : float
        Speed; 2 is twice as fast.
    loop : bool
        Start again at the end; the stamps then jump back, which the nodes count.
    clock : bool
        Publish ``/clock`` from the log times.
    topics : sequence of str, optional
        Topics to play; all by default.
    remap : mapping, optional
        New names of topics.
    wait_for_subscribers : sequence of str
        Published topics (new names) that must have a subscriber before the start.
    wait_s : float
        How long to wait for them.
    on_message : callable, optional
        Told every message just published and the wall time, ``time.time_ns()``.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        rate: float = 1.0,
        loop: bool = False,
        clock: bool = True,
        topics: Sequence[str] | None = None,
        remap: dict[str, str] | None = None,
        wait_for_subscribers: Sequence[str] = (),
        wait_s: float = 10.0,
        on_message: Callable[[Recorded, int], None] | None = None,
    ) -> None:
        if not rate > 0.0:
            raise InputError(f"the rate is {rate}; it must be above 0")
        self._path, self._rate, self._loop, self._clock = Path(path), rate, loop, clock
        self._topics, self._remap = topics, remap or {}
        self._wait_for, self._wait_s = tuple(wait_for_subscribers), wait_s
        self._on_message = on_message
        self._stop = threading.Event()
        self._result = Played()
        self._publishers: dict[str, Any] = {}
        self._last_tick_s = 0.0

    def stop(self) -> None:
        """End `run` from another thread or a signal handler."""
        self._stop.set()

    def run(self) -> Played:
        """Play to the end, or until `stop`.

        Raises
        ------
        InputError
            If nothing can be played, or the subscribers waited for do not come.
        """
        import rclpy
        from rclpy.context import Context

        context = Context()
        rclpy.init(context=context, args=[])
        try:
            self._node = rclpy.create_node("player", namespace="depth_pose", context=context)
            self._make_publishers()
            self._await_subscribers()
            self._play_rounds()
            self._await_acknowledgement()
        finally:
            rclpy.try_shutdown(context=context)
        return self._result

    def _make_publishers(self) -> None:
        from rclpy.qos import QoSProfile
        from rosgraph_msgs.msg import Clock

        from depth_pose.ros.transport.message_text import message_class

        if self._clock:
            self._clock_publisher = self._node.create_publisher(Clock, "/clock", 10)
        for topic, type_name in topic_types(self._path, self._topics).items():
            if self._clock and topic == "/clock":
                self._result.skipped[topic] = "the clock comes from the log times"
                continue
            try:
                kind = message_class(type_name)
            except InputError as e:
                self._result.skipped[topic] = str(e)
                continue
            name = self._remap.get(topic, topic)
            # reliable suits every subscriber; those that ask for best effort get that
            self._publishers[topic] = self._node.create_publisher(kind, name, QoSProfile(depth=_DEPTH))
        if not self._publishers:
            why = "; ".join(f"{t}: {w}" for t, w in self._result.skipped.items())
            raise InputError(f"{self._path} has no topic that could be played; {why or 'none was found'}")

    def _await_subscribers(self) -> None:
        missing = set(self._wait_for) - {p.topic_name for p in self._publishers.values()}
        if missing:
            raise InputError(f"{self._path} does not play {', '.join(sorted(missing))}")
        started = time.monotonic()
        while not self._stop.is_set():
            alone = [
                p.topic_name
                for p in self._publishers.values()
                if p.topic_name in self._wait_for and not p.get_subscription_count()
            ]
            took = time.monotonic() - started
            if not alone:
                # what the writer takes for joined, the reader may not yet, and the less so the busier it is
                self._stop.wait(min(max(took, _SETTLE_S), _MOST_SETTLE_S) if self._wait_for else 0.0)
                return
            if took > self._wait_s:
                raise InputError(f"nobody subscribed to {', '.join(alone)} within {self._wait_s:g} s")
            time.sleep(0.02)

    def _await_acknowledgement(self) -> None:
        """Wait until reliable subscribers have all: what is on its way is lost with its publisher."""
        from rclpy.duration import Duration

        deadline = time.monotonic() + (0.0 if self._stop.is_set() else _ACKNOWLEDGED_S)
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=max(0.0, deadline - time.monotonic())))

    def _play_rounds(self) -> None:
        started = time.monotonic()
        while not self._stop.is_set():
            self._result.rounds += 1
            before = self._result.messages.total()
            self._play_once()
            self._result.wall_s = time.monotonic() - started
            if not self._loop or before == self._result.messages.total():
                return

    def _play_once(self) -> None:
        first_ns: int | None = None
        start_s = 0.0
        with _ReadAhead(lambda: read_recording(self._path, list(self._publishers))) as messages:
            for message in messages:
                if first_ns is None:
                    first_ns, start_s = message.log_time_ns, time.monotonic()
                due_s = start_s + (message.log_time_ns - first_ns) / 1e9 / self._rate
                self._sleep_until(due_s, message.log_time_ns)
                if self._stop.is_set():
                    return
                self._publish(message, due_s)
            self._result.truncated = messages.truncated

    def _publish(self, message: Recorded, due_s: float) -> None:
        self._tick(message.log_time_ns)
        self._publishers[message.topic].publish(message.data)
        self._result.messages[message.topic] += 1
        self._result.worst_delay_s = max(self._result.worst_delay_s, time.monotonic() - due_s)
        if self._on_message is not None:
            self._on_message(message, time.time_ns())

    def _sleep_until(self, due_s: float, log_time_ns: int) -> None:
        while (left := due_s - time.monotonic()) > 0.0:
            if self._stop.wait(min(left, 1.0 / CLOCK_HZ)):
                return
            left = due_s - time.monotonic()
            if left > 0.5 / CLOCK_HZ:
                self._tick(log_time_ns - int(left * self._rate * 1e9))

    def _tick(self, now_ns: int) -> None:
        now = time.monotonic()
        if not self._clock or now - self._last_tick_s < 0.2 / CLOCK_HZ:
            return
        from rosgraph_msgs.msg import Clock

        from depth_pose.ros.transport.conversions import ns_to_stamp

        self._last_tick_s = now
        self._clock_publisher.publish(Clock(clock=ns_to_stamp(now_ns)))


class _ReadAhead:
    """Reads in a thread, so that unpacking a chunk delays no message."""

    def __init__(self, source: Callable[[], Iterator[Recorded]]) -> None:
        self._source = source
        self._queue: queue.Queue[Recorded | BaseException | None] = queue.Queue(maxsize=_AHEAD)
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._fill, daemon=True)
        self.truncated = False

    def __enter__(self) -> _ReadAhead:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()

    def __iter__(self) -> Iterator[Recorded]:
        while (item := self._queue.get()) is not None:
            if isinstance(item, TruncatedError):
                self.truncated = True
            elif isinstance(item, BaseException):
                raise item
            else:
                yield item

    def _fill(self) -> None:
        try:
            for message in self._source():
                self._put(message)
                if self._done.is_set():
                    return
        except BaseException as e:
            self._put(e)
        self._put(None)

    def _put(self, item: Recorded | BaseException | None) -> None:
        while not self._done.is_set():
            with contextlib.suppress(queue.Full):
                self._queue.put(item, timeout=0.1)
                return


def topic_types(path: str | Path, topics: Sequence[str] | None = None) -> dict[str, str]:
    """Topics of a recording and their message types.

    Raises
    ------
    InputError
        If a topic asked for is not there; the message lists those that are.
    """
    found: dict[str, str] = {}
    summary = _summary(path)
    if summary is not None:
        for channel in summary.channels.values():
            schema = summary.schemas.get(channel.schema_id)
            if channel.message_encoding == "cdr" and schema is not None:
                found[channel.topic] = schema.name
    else:
        try:
            for message in read_recording(path):
                found.setdefault(message.topic, message.type_name)
        except TruncatedError:
            pass
    missing = [t for t in topics or () if t not in found]
    if missing:
        there = ", ".join(sorted(found)) or "none in ROS 2's encoding"
        raise InputError(f"{path} has no topic {', '.join(missing)}; it has {there}")
    return {t: k for t, k in found.items() if topics is None or t in topics}


def _summary(path: str | Path) -> Any:
    from mcap.exceptions import EndOfFile, McapError
    from mcap.reader import SeekingReader

    try:
        with Path(path).open("rb") as stream:
            return SeekingReader(stream).get_summary()
    except OSError as e:
        raise InputError(f"cannot open {path}: {e.strerror}") from e
    except (McapError, EndOfFile, ValueError):
        return None


def play(path: str | Path, **options: Any) -> Played:
    """Publish a recording until its end, or until SIGINT or SIGTERM.

    Options are those of `Player`.
    """
    player = Player(path, **options)
    with on_stop(player.stop):
        return player.run()
