"""What the four nodes share: parameters, queues, pairing, diagnostics, and staying alive.

A node of this package is a thin skin over one stage of the core. `StageNode` makes the stage
from the parameters and warms it up *before* it subscribes, so that the first frame is not the
one that waits for a compiler; it then hands over messages, newest first, and counts whatever
gets no answer. Nothing that arrives on a topic ends a node.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Protocol

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from depth_pose.config import PipelineConfig
from depth_pose.errors import BankError, ConfigError, DepthPoseError, InputError
from depth_pose.ros.conversions import stamp_to_ns
from depth_pose.ros.figures import Figures
from depth_pose.ros.pairing import Pairer
from depth_pose.ros.parameters import COMMON, Setting, declare, read_config
from depth_pose.ros.silence import CrowdWatch, SilenceWatch

READY = "is ready"
"""A node logs this once it has warmed up and its connections stand; the supervisor waits for it."""

PAIR_DEPTH = 64
"""Stamps held by a node that pairs topics, until the later part of a frame comes.

It must span the time that the stages between take, two seconds at 30 frames a second: with fewer,
a node behind a slow stage would have let go of every frame's points when its match comes.
"""

SETTLE_S = 0.2
"""What a writer takes for joined, the reader may not yet: it is given this long to follow."""

_READY_TICK_S = 0.05

LOG_EVERY_S = 5.0
"""A drop of the same reason is logged at most this often, with the number since."""


class Stage(Protocol):
    """One stage of the core, as nodes know it."""

    def warm_up(self) -> None:
        """Compile what will be needed."""

    def reset(self) -> None:
        """Forget everything that was kept between frames."""


@dataclass(frozen=True)
class Input:
    """One topic of a node.

    Attributes
    ----------
    kind : type
        Message class, with a header.
    topic : str
    sensor : bool
        Whether it comes from outside the suite: then its silence is worth a warning.
    """

    kind: type
    topic: str
    sensor: bool = False


class Drop(DepthPoseError):
    """Raised by `StageNode.answer` where a frame gets no answer, with the reason to count it by."""

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(detail)
        self.reason = reason


class Held(Exception):
    """Raised by `StageNode.answer` where a frame is kept and answered later."""


class StageNode(Node):
    """A node around one stage; sub-classes say which, and convert.

    Queues hold one frame and the newest wins. A node with several inputs pairs them by exact
    stamp: up to `PAIR_DEPTH` incomplete frames are held, because the parts of one frame come at
    different times, and all that waits is taken in before the newest whole frame is begun.
    With the parameter ``reliable`` every frame is taken in turn, up to ``queue`` of them.

    Attributes
    ----------
    stage
        What `make_stage` made.
    figures : Figures
        Counts and times that go to ``/diagnostics``.
    """

    SECTIONS: ClassVar[tuple[str, ...]] = ()
    SETTINGS: ClassVar[tuple[Setting, ...]] = ()

    def __init__(self, name: str) -> None:
        super().__init__(name, namespace="depth_pose")
        self.figures = Figures()
        self.arrivals = 0
        self._pending: tuple[Any, ...] | None = None
        self._last_stamp_ns: int | None = None
        self._sequences: dict[int, int] = {}
        self._logged: dict[str, tuple[float, int]] = {}
        self._outputs: list[Publisher] = []
        declare(self, (*COMMON, *self.SETTINGS), self.SECTIONS)
        self.lossless: bool = self.value("reliable")
        self.queue: int = self.value("queue")
        self.config = read_config(self, self.SECTIONS)
        self.stage: Any = self.make_stage(self.config)
        self.stage.warm_up()
        self.open_outputs()
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._open_inputs(self.inputs())
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._take_parameters)
        self.create_timer(1.0, self._tell, clock=self._steady)
        self.create_timer(0.5, self._silence.check, clock=self._steady)
        self._joined_ticks = 0
        self._ready_timer = self.create_timer(_READY_TICK_S, self._tell_ready, clock=self._steady)

    # What a sub-class says

    def make_stage(self, config: PipelineConfig) -> Stage:
        """Make the stage."""
        raise NotImplementedError

    def open_outputs(self) -> None:
        """Create the publishers with `publisher`."""
        raise NotImplementedError

    def inputs(self) -> Sequence[Input]:
        """Topics whose messages of one stamp make a frame."""
        raise NotImplementedError

    def answer(self, *messages: Any) -> None:
        """Convert, call the stage, convert, publish.

        Raises
        ------
        InputError, BankError, Drop
            Where there is no answer to this frame.
        Held
            Where it is kept; the sub-class calls `process` with it later.
        """
        raise NotImplementedError

    # What a sub-class may call

    def value(self, name: str) -> Any:
        """Value of a parameter."""
        return self.get_parameter(name).value

    def publisher(self, kind: type, topic: str, *, reliable: bool = False, counted: bool = True) -> Publisher:
        """Make a publisher of frames: sensor QoS, or `reliable`, which suits every subscriber.

        Parameters
        ----------
        kind, topic
            Message class, and a name below the node's namespace.
        reliable : bool
            For small messages that other programs read.
        counted : bool
            Whether its subscribers count for the parameter ``consumers``.
        """
        made = self.create_publisher(kind, topic, self._qos(self.queue, reliable or self.lossless))
        if counted:
            self._outputs.append(made)
        return made

    def latch(self, kind: type, topic: str, callback: Callable[[Any], None]) -> list[Subscription]:
        """Subscribe to what may be sent with every frame, or once and for all."""
        once = QoSProfile(
            depth=1,
            history=HistoryPolicy.KEEP_LAST,
            reliability=ReliabilityPolicy.RELIABLE,
            durability=DurabilityPolicy.TRANSIENT_LOCAL,
        )
        quiet = SubscriptionEventCallbacks(use_default_callbacks=False)
        return [
            self.create_subscription(kind, topic, callback, self._qos(1, self.lossless)),
            self.create_subscription(kind, topic, callback, once, event_callbacks=quiet),
        ]

    def drop(self, reason: str, detail: str, count: int = 1) -> None:
        """Count frames without an answer, and log it now and then."""
        self.figures.drop(reason, count)
        last, before = self._logged.get(reason, (-1e9, 0))
        now, total = time.monotonic(), self.figures.drops[reason]
        if now - last < LOG_EVERY_S:
            return
        self._logged[reason] = (now, total)
        more = f" ({total - before} of these since the last such line)" if total - before > 1 else ""
        self.get_logger().warning(f"dropped, {reason}: {detail}{more}")

    # Messages

    def _qos(self, depth: int, reliable: bool) -> QoSProfile:
        policy = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
        return QoSProfile(depth=depth, history=HistoryPolicy.KEEP_LAST, reliability=policy)

    def _open_inputs(self, inputs: Sequence[Input]) -> None:
        paired = len(inputs) > 1
        depth = max(self.queue, PAIR_DEPTH) if paired else self.queue
        self._inputs = tuple(replace(i, topic=self.resolve_topic_name(i.topic)) for i in inputs)
        self._pairer = (
            Pairer(len(inputs), depth, self._unpaired, ordered=not self.lossless) if paired else None
        )
        for index, i in enumerate(self._inputs):
            qos = self._qos(depth, self.lossless)
            self.create_subscription(i.kind, i.topic, self._callback(index), qos)
        self._crowd = CrowdWatch(self, self._inputs)
        self._silence = SilenceWatch(self, [i for i in self._inputs if i.sensor])

    def _callback(self, index: int) -> Callable[..., None]:
        def take(message: Any, info: Any) -> None:  # rclpy counts the arguments
            self._take(index, message, info)

        return take

    def _take(self, index: int, message: Any, info: dict[str, Any]) -> None:
        self.arrivals += 1
        self._silence.heard(self._inputs[index].topic)
        self._count_missed(index, info.get("publication_sequence_number"))
        stamp_ns = stamp_to_ns(message.header.stamp)
        if index == 0 and not self._is_new(stamp_ns):
            return
        whole = (message,) if self._pairer is None else self._pairer.add(index, stamp_ns, message)
        if whole is None:
            return
        if self._pairer is None or self.lossless:
            self.process(whole)
            return
        if self._pending is not None:
            self.drop("overtaken", "a newer frame came before this one was begun")
        self._pending = whole

    def _count_missed(self, index: int, sequence: int | None) -> None:
        """Count what the publisher sent and this node never saw, by the publisher's own numbers."""
        if not sequence:
            return
        last = self._sequences.get(index)
        self._sequences[index] = sequence
        topic = self._inputs[index].topic
        # each publisher counts for itself: the numbers of several say nothing
        if last is not None and sequence > last + 1 and self.count_publishers(topic) == 1:
            self.drop("missed", f"{topic} brought newer ones while this node was busy", sequence - last - 1)

    def _is_new(self, stamp_ns: int) -> bool:
        last, self._last_stamp_ns = self._last_stamp_ns, stamp_ns
        if last is None or stamp_ns > last:
            return True
        topic = self._inputs[0].topic
        if stamp_ns == last:
            self.drop("same stamp", f"{topic} repeats stamp {stamp_ns} ns; does the driver set header.stamp?")
            return False
        self.figures.counts["stamps going back"] += 1
        back_s = (last - stamp_ns) / 1e9
        self.get_logger().warning(
            f"the stamps of {topic} went back by {back_s:.3f} s; what was kept of earlier frames is dropped",
            throttle_duration_sec=LOG_EVERY_S,
        )
        return True

    def _unpaired(self, count: int) -> None:
        topics = " and ".join(i.topic for i in self._inputs)
        self.drop("unpaired", f"{topics} did not both bring this stamp", count)

    @property
    def has_pending(self) -> bool:
        """Whether a whole frame waits for `process_pending`."""
        return self._pending is not None

    def process_pending(self) -> None:
        """Answer the newest whole frame."""
        whole, self._pending = self._pending, None
        if whole is not None:
            self.process(whole)

    def process(self, messages: tuple[Any, ...]) -> None:
        """Answer a whole frame, or count why not; whatever happens, the node lives."""
        started = time.perf_counter()
        try:
            self.answer(*messages)
        except Held:
            return
        except Drop as e:
            self.drop(e.reason, str(e))
        except InputError as e:
            self.drop("bad input", f"{self._inputs[0].topic}: {e}")
        except BankError as e:
            self.drop("other bank", str(e))
        except Exception as e:  # a node outlives every frame
            self.get_logger().error(traceback.format_exc(), throttle_duration_sec=LOG_EVERY_S)
            self.drop("error", f"{type(e).__name__}: {e}")
            self._reset_stage()
        else:
            now_ns = self.get_clock().now().nanoseconds
            latency_s = (now_ns - stamp_to_ns(messages[0].header.stamp)) / 1e9
            self.figures.answer(time.perf_counter() - started, latency_s)

    def _reset_stage(self) -> None:
        try:
            self.stage.reset()
        except Exception:
            self.get_logger().error("reset failed as well:\n" + traceback.format_exc())

    # Parameters

    def _check_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            read_config(self, self.SECTIONS, {p.name: p.value for p in parameters})
        except ConfigError as e:
            return SetParametersResult(successful=False, reason=str(e))
        return SetParametersResult(successful=True)

    def _take_parameters(self, parameters: list[Parameter]) -> None:
        if not any(p.name.split(".")[0] in self.SECTIONS for p in parameters):
            return
        try:
            config = read_config(self, self.SECTIONS)
            stage = self.make_stage(config)
        except Exception:
            self.get_logger().error("the stage stays as it was:\n" + traceback.format_exc())
            return
        self.config, self.stage = config, stage
        changed = ", ".join(f"{p.name} = {p.value}" for p in parameters)
        self.get_logger().info(f"set {changed}; what was kept of earlier frames is dropped")

    # Telling

    def _tell_ready(self) -> None:
        wanted = self.value("consumers")
        joined = all(p.get_subscription_count() >= wanted for p in self._outputs)
        self._joined_ticks = self._joined_ticks + 1 if joined else 0
        if self._joined_ticks > SETTLE_S / _READY_TICK_S:
            self.destroy_timer(self._ready_timer)
            topics = ", ".join(i.topic for i in self._inputs)
            self.get_logger().info(f"{self.get_name()} {READY}: listens to {topics}")

    def _tell(self) -> None:
        self._crowd.check()
        new = self.figures.new_drops()
        status = DiagnosticStatus(name=f"{self.get_fully_qualified_name()}", hardware_id="depth_pose")
        status.level, status.message = DiagnosticStatus.OK, "answers" if self.figures.rate_hz() else "waits"
        if self._silence.silent:
            status.level, status.message = (
                DiagnosticStatus.WARN,
                "nothing from " + ", ".join(self._silence.silent),
            )
        if new:
            status.level = DiagnosticStatus.ERROR if new["error"] else DiagnosticStatus.WARN
            status.message = "dropped " + ", ".join(f"{n} {reason}" for reason, n in sorted(new.items()))
        status.values = [KeyValue(key=k, value=v) for k, v in self.figures.as_text().items()]
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)
