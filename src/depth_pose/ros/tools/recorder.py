"""Record topics to MCAP: serialised bytes, and the full text of every definition."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import depth_pose
from depth_pose.core.errors import InputError
from depth_pose.core.outputs import NewFile
from depth_pose.core.printable import printable
from depth_pose.ros.process.runner import on_stop
from depth_pose.ros.process.security import init_context
from depth_pose.ros.tools.recorded_qos import qos_text

_LOOK_EVERY_S = 0.05
"""Seconds between two checks for new topics."""

_SETTLE_S = 0.2
"""Seconds for discovery on both sides: a publisher may find the recorder last."""

_DRAIN_S = 2.0
"""Time limit, after the stop, for messages that have arrived by then, seconds."""

_QUIET_TURNS, _TURN_S = 3, 0.02
"""Number and maximum duration (s) of spins without a message after which all have been received: one spin may
handle another event, and delivered messages appear a moment later."""

_QUEUE = 1000
"""Queue length of a topic's messages."""

_INTERNAL = ("/parameter_events", "/rosout")


class Recorder:
    """Records topics in a separate thread, from `start` to `stop`.

    A topic is recorded as soon as it has a publisher, with the QoS that its publishers
    offer. Log times are those of arrival.

    Parameters
    ----------
    output : path
        MCAP file. Until it is finished it is ``NAME.partial.mcap``; then an existing one is replaced,
        unless nothing was recorded, which leaves no file. If the disk fills up the recording ends, and
        earlier messages are left under that name.
    topics : sequence of str, optional
        Topics to record; all but `rosout` and parameter events by default.
    on_message : callable, optional
        Called with topic, serialised bytes and arrival (``time.time_ns()``) of every message, in
        the recorder's thread.
    """

    def __init__(
        self,
        output: str | Path,
        topics: Sequence[str] | None = None,
        *,
        on_message: Callable[[str, bytes, int], None] | None = None,
    ) -> None:
        self._output = Path(output)
        self._topics = None if topics is None else tuple(topics)
        self._on_message = on_message
        self._changed = threading.Condition()
        self._counts: Counter[str] = Counter()
        self._refused: dict[str, str] = {}
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._subscriptions: dict[str, Any] = {}
        self._opened, self._stopping = threading.Event(), threading.Event()
        self._error: BaseException | None = None
        self._thread: threading.Thread | None = None

    @property
    def counts(self) -> Counter[str]:
        """Messages recorded so far, by topic."""
        with self._changed:
            return self._counts.copy()

    @property
    def refused(self) -> dict[str, str]:
        """Topics that cannot be recorded, with the reason."""
        return dict(self._refused)

    @property
    def is_running(self) -> bool:
        """Whether it still records; a full disk ends it before `stop`, which then raises the error."""
        return self._thread is not None and self._thread.is_alive()

    def start(self) -> None:
        """Open the file and begin.

        Raises
        ------
        InputError
            If the file cannot be written.
        ConfigError
            If ROS does not start with the security that is asked for.
        """
        from mcap.writer import CompressionType, Writer

        self._file = NewFile(self._output, visible=True)
        self._writer = Writer(self._file.stream, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2", library=f"depth_pose {depth_pose.__version__}")
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()
        self._opened.wait()
        if self._error is not None:
            self.stop()

    def stop(self) -> Counter[str]:
        """Finish the file; return the number of messages by topic. Without messages there is no file."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
            self._finish()
        if self._error is not None:
            raise self._error
        return self.counts

    def _finish(self) -> None:
        try:
            with self._file.telling():
                self._writer.finish()
        except InputError as error:
            self._error = self._error or error
        if not self._counts:
            self._file.discard()
        elif isinstance(self._error, InputError):
            left = self._file.leave()
            self._error = InputError(f"{self._error}; what was recorded before that is in {left}")
        else:
            self._file.keep()

    def wait_for(self, topic: str, count: int, timeout_s: float = 10.0) -> bool:
        """Wait until `count` messages of a topic are recorded; False if they do not arrive in time."""
        with self._changed:
            return self._changed.wait_for(lambda: self._counts[topic] >= count, timeout_s)

    def wait_subscribed(self, timeout_s: float = 10.0) -> bool:
        """Wait until the named topics are subscribed to and their publishers found; False if not in time."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            if all(
                t in self._subscriptions and self._subscriptions[t].get_publisher_count()
                for t in self._topics or ()
            ):
                time.sleep(_SETTLE_S)
                return True
            time.sleep(0.02)
        return False

    def __enter__(self) -> Recorder:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    # The recorder's thread

    def _run(self) -> None:
        import rclpy
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor

        context = Context()
        try:
            init_context(context, args=[])
            self._node = rclpy.create_node("recorder", namespace="depth_pose", context=context)
            self._opened.set()
            executor = SingleThreadedExecutor(context=context)
            executor.add_node(self._node)
            looked_s = 0.0
            while not self._stopping.is_set():
                if time.monotonic() - looked_s >= _LOOK_EVERY_S:
                    self._look()
                    looked_s = time.monotonic()
                executor.spin_once(timeout_sec=_LOOK_EVERY_S)
            self._drain(executor)
            executor.shutdown()
        except BaseException as e:
            self._error = e
        finally:
            self._opened.set()
            rclpy.try_shutdown(context=context)

    def _drain(self, executor: Any) -> None:
        """Write the messages that arrived before the stop."""
        quiet, deadline = 0, time.monotonic() + _DRAIN_S
        while quiet < _QUIET_TURNS and time.monotonic() < deadline:
            before = self._counts.total()
            executor.spin_once(timeout_sec=_TURN_S)
            quiet = 0 if self._counts.total() > before else quiet + 1

    def _look(self) -> None:
        """Subscribe to new topics."""
        if self._topics is not None and len(self._subscriptions) + len(self._refused) == len(self._topics):
            return
        for topic, types in self._node.get_topic_names_and_types():
            wanted = topic not in _INTERNAL if self._topics is None else topic in self._topics
            if wanted and topic not in self._subscriptions and topic not in self._refused:
                self._subscribe(topic, types)

    def _subscribe(self, topic: str, types: Sequence[str]) -> None:
        from depth_pose.ros.tools.message_text import message_class, message_text

        publishers = self._node.get_publishers_info_by_topic(topic)
        if not publishers:
            return
        try:
            if len(types) != 1:
                raise InputError(f"it has several types, {', '.join(types)}")
            kind, text = message_class(types[0]), message_text(types[0])
        except (InputError, OSError) as e:
            self._refused[topic] = str(e)
            self._node.get_logger().warning(f"{topic} is not recorded: {printable(e)}")
            return
        if types[0] not in self._schemas:
            self._schemas[types[0]] = self._writer.register_schema(types[0], "ros2msg", text.encode())
        offered = {"offered_qos_profiles": qos_text([p.qos_profile for p in publishers])}
        schema = self._schemas[types[0]]
        self._channels[topic] = self._writer.register_channel(topic, "cdr", schema, offered)

        def take(data: bytes) -> None:
            self._write(topic, data)

        self._subscriptions[topic] = self._node.create_subscription(
            kind, topic, take, _matching_qos(publishers), raw=True
        )

    def _write(self, topic: str, data: bytes) -> None:
        now_ns = time.time_ns()
        with self._changed:
            sequence = self._counts[topic]
            with self._file.telling():
                self._writer.add_message(self._channels[topic], now_ns, data, now_ns, sequence)
            self._counts[topic] += 1
            self._changed.notify_all()
        if self._on_message is not None:
            self._on_message(topic, data, now_ns)


def _matching_qos(publishers: Sequence[Any]) -> Any:
    """Return a QoS that is reliable and durable only if all publishers are, so that all can be received."""
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    offers = [p.qos_profile for p in publishers]
    made = QoSProfile(depth=_QUEUE, reliability=ReliabilityPolicy.RELIABLE)
    if any(o.reliability != ReliabilityPolicy.RELIABLE for o in offers):
        made.reliability = ReliabilityPolicy.BEST_EFFORT
    if all(o.durability == DurabilityPolicy.TRANSIENT_LOCAL for o in offers):
        made.durability = DurabilityPolicy.TRANSIENT_LOCAL
    return made


def record(
    output: str | Path,
    topics: Sequence[str] | None = None,
    *,
    seconds: float | None = None,
    on_start: Callable[[], None] | None = None,
) -> Counter[str]:
    """Record until SIGINT or SIGTERM, or for some time.

    Parameters
    ----------
    output, topics
        As for `Recorder`.
    seconds : float, optional
        Stop after this long.
    on_start : callable, optional
        Called once when it records.

    Returns
    -------
    Counter
        Messages recorded by topic.
    """
    done = threading.Event()
    deadline = time.monotonic() + seconds if seconds is not None else float("inf")
    with on_stop(done.set), Recorder(output, topics) as recorder:
        if on_start is not None:
            on_start()
        while not done.wait(0.05) and time.monotonic() < deadline and recorder.is_running:
            pass
    return recorder.counts
