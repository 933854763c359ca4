"""Publish a recording: the recorded bytes unchanged, at the recorded times, with ``/clock``."""

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
from depth_pose.core.printable import printable
from depth_pose.io.image_options import ImageOptions
from depth_pose.io.recording import RawMessage, Recording
from depth_pose.ros.process.runner import on_stop
from depth_pose.ros.process.security import init_context
from depth_pose.ros.process.shared_memory import keep_private
from depth_pose.ros.tools.recorded_qos import is_latched

CLOCK_HZ = 40.0
"""``/clock`` messages a second of wall time, besides one before every recorded message."""

_DEPTH = 100
"""Queue length for a slow reliable subscriber."""

_DISCOVER_S, _MOST_DISCOVER_S = 1.0, 5.0
"""Seconds for running nodes to find the publishers, least and most, without ``--wait-for``. On one machine
they took 0.1 to 0.6 s."""

_SETTLE_S, _MOST_SETTLE_S = 0.2, 2.0
"""Seconds, least and most, between the last subscriber's discovery and the first message.

A publisher finds a subscriber before the subscriber finds the publisher, and messages sent in between are
lost. The wait is as long as the discovery took, since both take longer on a busy machine.
"""

_LONGEST_LOOK_S = 0.1
"""Maximum seconds that one check for subscribers adds to these times, in case the machine was paused."""

_ACKNOWLEDGED_S = 5.0
"""Time limit for reliable subscribers to acknowledge the last messages, seconds."""

_MOST_GAP_S = 3600.0
"""Maximum gap between messages, seconds; a longer one (a wrong clock) is skipped."""

_LAST_CLOCK_NS = (1 << 31) * 1_000_000_000 - 1
"""Maximum time of a ``/clock`` message, nanoseconds."""

_AHEAD = 32
"""Messages read ahead of their time: about a second of images."""


@dataclass
class Played:
    """Summary of a playback.

    Attributes
    ----------
    messages : Counter
        Messages by topic, all rounds together.
    rounds : int
        Number of times the recording was started.
    wall_s : float
        From the first message to the last.
    worst_delay_s : float
        Maximum delay of a message.
    damage : tuple of str
        Parts of the recording that could not be read and played; one line per file.
    skipped : dict of str to str
        Topics that could not be played, with the reason.
    gaps : list of str
        Skipped gaps between messages, a line each.
    """

    messages: Counter[str] = field(default_factory=Counter)
    rounds: int = 0
    wall_s: float = 0.0
    worst_delay_s: float = 0.0
    damage: tuple[str, ...] = ()
    skipped: dict[str, str] = field(default_factory=dict)
    gaps: list[str] = field(default_factory=list)


class Player:
    """Publishes a recording; sets nothing but ``/clock``.

    Parameters
    ----------
    path : path
        A recording, of any format that `depth_pose.io.recording.Recording` reads.
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
    wait_for : int
        Number of subscribers, over all topics, required before the start.
    wait_s : float
        Time limit for them.
    delay_s : float
        Minimum time from the creation of the publishers to the first message.
    images : ImageOptions, optional
        Options for a folder of images.
    on_message : callable, optional
        Called with every message just published, and its time, ``time.time_ns()``.
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
        wait_for: int = 0,
        wait_s: float = 10.0,
        delay_s: float = 0.0,
        images: ImageOptions | None = None,
        on_message: Callable[[RawMessage, int], None] | None = None,
    ) -> None:
        if not rate > 0.0:
            raise InputError(f"the rate is {rate}; it must be above 0")
        self._path, self._rate, self._loop, self._clock = Path(path), rate, loop, clock
        self._topics, self._remap, self._images = topics, remap or {}, images
        self._wait_for, self._wait_count = tuple(wait_for_subscribers), wait_for
        self._wait_s, self._delay_s = wait_s, delay_s
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
            If nothing can be played, or the required subscribers do not appear.
        """
        import rclpy
        from rclpy.context import Context

        self._recording = Recording(self._path, self._images)
        context = Context()
        init_context(context, args=[])
        try:
            self._node = rclpy.create_node(
                "player", namespace="depth_pose", context=context, start_parameter_services=False
            )  # it is not spun, and would not answer
            keep_private()
            self._make_publishers()
            self._await_subscribers()
            self._play_rounds()
            self._await_acknowledgement()
        finally:
            rclpy.try_shutdown(context=context)
        return self._result

    def _make_publishers(self) -> None:
        from rclpy.exceptions import InvalidTopicNameException
        from rclpy.qos import DurabilityPolicy, QoSProfile
        from rosgraph_msgs.msg import Clock

        from depth_pose.ros.tools.message_text import message_class

        if self._clock:
            self._clock_publisher = self._node.create_publisher(Clock, "/clock", 10)
        unknown = set(self._remap) - set(self._recording.topics)
        if unknown:
            raise InputError(f"{self._path} has no topic {', '.join(sorted(unknown))} that could be renamed")
        self._result.skipped.update(self._recording.others if self._topics is None else {})
        for topic, type_name in self._topic_types().items():
            if self._clock and topic == "/clock":
                self._result.skipped[topic] = "the clock comes from the log times"
                continue
            try:
                kind = message_class(type_name)
            except InputError as e:
                self._result.skipped[topic] = str(e)
                continue
            name = self._remap.get(topic, topic)
            # reliable suits every subscriber, also best-effort ones
            qos = QoSProfile(depth=_DEPTH)
            if is_latched(topic, self._recording.topics[topic].qos):
                qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
            try:
                self._publishers[topic] = self._node.create_publisher(kind, name, qos)
            except (ValueError, TypeError, InvalidTopicNameException) as e:
                why = f"{name} cannot be a topic: {' '.join(str(e).split())}"
                if topic in self._remap:
                    raise InputError(why) from e
                self._result.skipped[topic] = why
        if not self._publishers:
            why = "; ".join(f"{t}: {w}" for t, w in self._result.skipped.items())
            raise InputError(f"{self._path} has no topic that could be played; {why or 'none was found'}")

    def _topic_types(self) -> dict[str, str]:
        """Topics to play and their message types."""
        found = {topic.name: topic.kind for topic in self._recording.topics.values()}
        missing = [t for t in self._topics or () if t not in found]
        for topic in missing:
            if topic in self._recording.others:
                raise InputError(f"{self._path}: {topic} cannot be played: {self._recording.others[topic]}")
        if missing:
            there = ", ".join(sorted(found)) or "none in ROS 2's encoding"
            raise InputError(f"{self._path} has no topic {', '.join(missing)}; it has {there}")
        return {t: k for t, k in found.items() if self._topics is None or t in self._topics}

    def _await_subscribers(self) -> None:
        missing = set(self._wait_for) - {p.topic_name for p in self._publishers.values()}
        if missing:
            raise InputError(f"{self._path} does not play {', '.join(sorted(missing))}")
        started = looked = time.monotonic()
        took_s = changed_s = 0.0
        counts: list[int] = []
        while not self._stop.is_set():
            last, looked = looked, time.monotonic()
            took_s += min(looked - last, _LONGEST_LOOK_S)
            before, counts = counts, [p.get_subscription_count() for p in self._publishers.values()]
            changed_s = took_s if counts != before else changed_s
            lacking = self._lacking()
            if not lacking and looked - started >= self._delay_s and self._is_settled(took_s, changed_s):
                return
            if lacking and took_s > self._wait_s:
                raise InputError(f"nobody subscribed to {lacking} within {self._wait_s:g} s")
            time.sleep(0.02)

    def _lacking(self) -> str:
        """Return the subscribers that are still missing."""
        published = [p for p in self._publishers.values() if not p.get_subscription_count()]
        alone = [p.topic_name for p in published if p.topic_name in self._wait_for]
        if alone:
            return ", ".join(alone)
        count = sum(p.get_subscription_count() for p in self._publishers.values())
        return f"its topics but {count} of {self._wait_count}" if count < self._wait_count else ""

    def _is_settled(self, took_s: float, changed_s: float) -> bool:
        """Whether subscribers will receive the first message: none has appeared for a while.

        That is as long as finding the required subscribers took, else as long as discovery takes.
        """
        if self._wait_for or self._wait_count:
            return took_s - changed_s >= min(max(changed_s, _SETTLE_S), _MOST_SETTLE_S)
        quiet_s = took_s - changed_s
        return took_s >= _MOST_DISCOVER_S or (took_s >= _DISCOVER_S and quiet_s >= _SETTLE_S)

    def _await_acknowledgement(self) -> None:
        """Wait until reliable subscribers have all messages: those in transit are lost with the publisher."""
        from rclpy.duration import Duration

        deadline = time.monotonic() + (0.0 if self._stop.is_set() else _ACKNOWLEDGED_S)
        clock = [self._clock_publisher] if self._clock else []
        for publisher in (*self._publishers.values(), *clock):
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
        last_ns = 0
        start_s = 0.0
        with _ReadAhead(lambda: self._recording.messages(*self._publishers)) as messages:
            for message in messages:
                if first_ns is None:
                    first_ns, start_s = message.log_time_ns, time.monotonic()
                elif message.log_time_ns - last_ns > _MOST_GAP_S * 1e9:
                    self._skip_gap(message.topic, message.log_time_ns - last_ns)
                    first_ns += message.log_time_ns - last_ns
                last_ns = message.log_time_ns
                due_s = start_s + (message.log_time_ns - first_ns) / 1e9 / self._rate
                self._sleep_until(due_s, message.log_time_ns)
                if self._stop.is_set():
                    return
                self._publish(message, due_s)
        self._result.damage = tuple(self._recording.damage)

    def _skip_gap(self, topic: str, gap_ns: int) -> None:
        hours = gap_ns / 3.6e12
        line = f"{self._path}: a message on {printable(topic)} is {hours:.0f} hours later than the one before"
        self._result.gaps.append(f"{line}; not waited for")

    def _publish(self, message: RawMessage, due_s: float) -> None:
        self._tick(message.log_time_ns)
        now_ns = time.time_ns()  # an answer may come before the thread continues
        self._publishers[message.topic].publish(message.data)
        self._result.messages[message.topic] += 1
        self._result.worst_delay_s = max(self._result.worst_delay_s, time.monotonic() - due_s)
        if self._on_message is not None:
            self._on_message(message, now_ns)

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

        from depth_pose.ros.messages.basics import ns_to_stamp

        self._last_tick_s = now
        self._clock_publisher.publish(Clock(clock=ns_to_stamp(min(now_ns, _LAST_CLOCK_NS))))


class _ReadAhead:
    """Reader in a separate thread, so that decompressing a chunk delays no message."""

    def __init__(self, source: Callable[[], Iterator[RawMessage]]) -> None:
        self._source = source
        self._queue: queue.Queue[RawMessage | BaseException | None] = queue.Queue(maxsize=_AHEAD)
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._fill, daemon=True)

    def __enter__(self) -> _ReadAhead:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()

    def __iter__(self) -> Iterator[RawMessage]:
        while (item := self._queue.get()) is not None:
            if isinstance(item, BaseException):
                raise item
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

    def _put(self, item: RawMessage | BaseException | None) -> None:
        while not self._done.is_set():
            with contextlib.suppress(queue.Full):
                self._queue.put(item, timeout=0.1)
                return


def play(path: str | Path, **options: Any) -> Played:
    """Publish a recording until its end, or until SIGINT or SIGTERM.

    Options are those of `Player`.
    """
    player = Player(path, **options)
    with on_stop(player.stop):
        return player.run()
