"""What the nodes share: life cycle, parameters, diagnostics, and staying alive.

A node of this package is a thin, managed skin over one stage of the core. Configuring
makes the stage from the parameters and warms it up *before* anything is subscribed, so that the
first frame is not the one that waits for a compiler; once active it hands over frames
(`depth_pose.ros.transport.intake`) and counts whatever gets no answer. Nothing that arrives on a topic ends
a node. Unless the parameter ``autostart`` is false, a node configures and activates itself.
"""

from __future__ import annotations

import time
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, ClassVar, Protocol

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from threadpoolctl import threadpool_limits

from depth_pose.core.config import PipelineConfig
from depth_pose.core.errors import BankError, ConfigError, DepthPoseError, InputError
from depth_pose.core.options import Sections
from depth_pose.core.printable import printable
from depth_pose.ros.messages.basics import stamp_to_ns
from depth_pose.ros.nodes.counts import Figures
from depth_pose.ros.nodes.input_watch import CrowdWatch, SilenceWatch
from depth_pose.ros.nodes.parameters import COMMON, declare, holds_setting, read_config
from depth_pose.ros.process import READY
from depth_pose.ros.process.shared_memory import keep_private
from depth_pose.ros.setting import Setting
from depth_pose.ros.transport.intake import (
    LOG_EVERY_S,
    NO_EVENTS,
    Drop,
    FrameSource,
    Held,
    Input,
    Intake,
    frame_qos,
)
from depth_pose.ros.transport.latched import LatchedTopic
from depth_pose.ros.transport.losses import BusyTimes

__all__ = ["Drop", "Held", "Input", "Stage", "StageNode"]

SETTLE_S = 0.2
"""Seconds for which the connections must stand before a node calls itself ready.

A publisher finds a subscriber before the subscriber finds the publisher. Set by hand.
"""

_READY_TICK_S = 0.05
"""Seconds between two looks at the connections. Set by hand."""


class Stage(Protocol):
    """One stage of the core, as nodes know it."""

    def warm_up(self) -> None:
        """Compile what will be needed."""

    def reset(self) -> None:
        """Forget everything that was kept between frames."""


class StageNode(LifecycleNode, ABC):
    """A node around one stage; sub-classes say which, and convert.

    Queues hold one frame and the newest wins. With the parameter ``reliable`` every frame is taken
    in turn, up to ``queue`` of them.

    Attributes
    ----------
    stage
        What `make_stage` made; None until the node is configured.
    is_active : bool
        Whether frames are answered.
    figures : Figures
        Counts and times that go to ``/diagnostics``.
    """

    CONFIG: ClassVar[type[Sections]] = PipelineConfig
    SECTIONS: ClassVar[tuple[str, ...]] = ()
    SETTINGS: ClassVar[tuple[Setting, ...]] = ()

    def __init__(self, name: str) -> None:
        threadpool_limits(1)  # the processes share the cores; and sums as `PosePipeline` makes them
        super().__init__(name, namespace="depth_pose")
        keep_private()
        self.figures = Figures()
        self.busy = BusyTimes()
        self.stage: Any = None
        self.is_active = False
        self._intake: FrameSource | None = None
        self._refused: Exception | None = None
        self._logged: dict[str, tuple[float, int]] = {}
        self._outputs: list[Publisher] = []
        self._sources: list[Subscription] = []
        self._opened: list[Publisher | Subscription] = []
        self._latched: list[LatchedTopic] = []
        self._watches: tuple[CrowdWatch, SilenceWatch] | None = None
        declare(self, (*COMMON, *self.SETTINGS), self.SECTIONS, self.CONFIG)
        self.lossless: bool = self.value("reliable")
        self.queue: int = self.value("queue")
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._take_parameters)
        self.create_timer(1.0, self._tell, clock=self._steady)
        self.create_timer(0.5, self._watch, clock=self._steady)
        self._joined_ticks = 0
        self._ready_timer = self.create_timer(_READY_TICK_S, self._tell_ready, clock=self._steady)
        if self.value("autostart"):
            self.start()

    # What a sub-class says

    @abstractmethod
    def make_stage(self, config: Any) -> Stage:
        """Make the stage."""

    @abstractmethod
    def open_outputs(self) -> None:
        """Create the publishers with `publisher`."""

    @abstractmethod
    def inputs(self) -> Sequence[Input]:
        """Topics whose messages of one stamp make a frame."""

    def make_intake(self) -> FrameSource:
        """Subscribe to the inputs."""
        return Intake(self, self.inputs())

    @abstractmethod
    def answer(self, *messages: Any) -> None:
        """Convert, call the stage, convert, publish.

        Raises
        ------
        InputError, BankError, Drop
            Where there is no answer to this frame.
        Held
            Where it is kept; the sub-class calls `process` with it later.
        """

    def stamp_ns(self, *messages: Any) -> int:
        """Return the stamp of a frame."""
        return stamp_to_ns(messages[0].header.stamp)

    def check_config(self, config: Any, changes: Mapping[str, Any]) -> None:
        """Refuse settings that are set while the node runs, by name, for more than their range.

        Raises
        ------
        ConfigError
            Where the stage could not be made of them.
        """

    def forget(self) -> None:
        """Drop messages that a sub-class keeps; called when the node is paused or cleaned up."""

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
            For small messages that others read.
        counted : bool
            Whether its subscribers count for the parameter ``consumers``.
        """
        qos = frame_qos(self.queue, reliable or self.lossless)
        quiet = PublisherEventCallbacks(use_default_callbacks=False)
        made = self.create_publisher(kind, topic, qos, event_callbacks=quiet)
        self._opened.append(made)
        if counted:
            self._outputs.append(made)
        return made

    def open_publisher(self, kind: type, topic: str, qos: QoSProfile | int) -> Publisher:
        """Make a publisher that is no output of frames; it closes with the others."""
        quiet = PublisherEventCallbacks(use_default_callbacks=False)
        made = self.create_publisher(kind, topic, qos, event_callbacks=quiet)
        self._opened.append(made)
        return made

    def close_publisher(self, publisher: Publisher) -> None:
        """Close one that `open_publisher` made."""
        self._opened.remove(publisher)
        self.destroy_publisher(publisher)

    def listen(
        self, kind: type, topic: str, callback: Callable[[Any], None], *, raw: bool = False
    ) -> Subscription:
        """Subscribe to a topic of the suite's own that is no part of a frame; ``raw`` gives its bytes."""
        qos = frame_qos(self.queue, self.lossless)
        made = self.create_subscription(
            kind, topic, partial(self.guard, topic, callback), qos, event_callbacks=NO_EVENTS, raw=raw
        )
        self._opened.append(made)
        self._sources.append(made)
        return made

    def latch(self, kind: type, topic: str, callback: Callable[[Any], None], depth: int = 1) -> None:
        """Subscribe to what may be sent with every frame, or once and for all, by up to ``depth`` senders."""
        take = partial(self.guard, topic, callback)
        self._latched.append(LatchedTopic(self, kind, topic, take, depth))

    def guard(self, topic: str, call: Callable[..., None], *arguments: Any) -> None:
        """Call the handler of a message; count bad messages instead of raising."""
        try:
            call(*arguments)
        except ConfigError:  # the settings are wrong, not the message
            raise
        except InputError as e:
            self.drop("bad input", f"{topic}: {e}")
        except Exception as e:
            self.survive(e, topic)

    def survive(self, error: Exception, where: str) -> None:
        """Log and count an error that nobody expected, unless it comes of being told to stop."""
        if self.context.ok():
            self.get_logger().error(traceback.format_exc(), throttle_duration_sec=LOG_EVERY_S)
            self.drop("error", f"{where}: {type(error).__name__}: {error}")

    def drop(self, reason: str, detail: str, count: int = 1) -> None:
        """Count frames without an answer, and log it now and then."""
        self.figures.drop(reason, count)
        last, before = self._logged.get(reason, (-1e9, 0))
        now, total = time.monotonic(), self.figures.drops[reason]
        if now - last < LOG_EVERY_S:
            return
        self._logged[reason] = (now, total)
        more = f" ({total - before} of these since the last such line)" if total - before > 1 else ""
        self.get_logger().warning(f"dropped, {reason}: {printable(detail)}{more}")

    def count(self, what: str) -> None:
        """Count what diagnostics tell, but is no drop."""
        self.figures.counts[what] += 1

    # Life cycle

    def start(self) -> None:
        """Configure and activate.

        Raises
        ------
        ConfigError, BankError
            If the settings or the bank cannot be used.
        """
        for trigger in (self.trigger_configure, self.trigger_activate):
            if trigger() != TransitionCallbackReturn.SUCCESS:
                raise self._refused or DepthPoseError(f"{self.get_name()} could not be started")

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load the bank, make the stage, compile or load its kernels, open the topics."""
        try:
            self.prepare()
        except Exception as e:
            self._refused = e
            if not isinstance(e, DepthPoseError):
                self.get_logger().error(traceback.format_exc())
            elif not self.value("autostart"):  # else it ends the process, which says it
                self.get_logger().error(str(e))
            self._close()
            return TransitionCallbackReturn.FAILURE
        return super().on_configure(state)

    def prepare(self) -> None:
        """Make all that is needed; a sub-class may put it off until it knows what it needs."""
        self.config = read_config(self, self.SECTIONS, config=self.CONFIG)
        self.stage = self.make_stage(self.config)
        self.stage.warm_up()
        self.open_outputs()
        self._intake = self.make_intake()
        inputs = self._intake.inputs
        self._watches = CrowdWatch(self, inputs), SilenceWatch(self, inputs, reliable=self.lossless)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to answer frames."""
        self.is_active, self._joined_ticks = True, 0
        self._ready_timer.reset()
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Pause: topics stay open, frames that come are ignored."""
        self.is_active = False
        self.forget()
        if self.stage is not None:
            self._reset_stage()
        if self._intake is not None:
            self._intake.forget()
        self.get_logger().info(f"{self.get_name()} is paused")
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release the stage and the topics."""
        self._close()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release everything."""
        self._close()
        return super().on_shutdown(state)

    def _close(self) -> None:
        self.is_active = False
        self.forget()
        if self._intake is not None:
            self._intake.close()
        for entity in self._opened:
            if isinstance(entity, Publisher):
                self.destroy_publisher(entity)
            else:
                self.destroy_subscription(entity)
        for topic in self._latched:
            topic.close()
        self._opened, self._outputs, self._sources, self._latched = [], [], [], []
        self._intake = self._watches = self.stage = None

    # Frames

    @property
    def has_pending(self) -> bool:
        """Whether a whole frame waits for `process_pending`."""
        return self._intake is not None and self._intake.has_pending

    def process_pending(self) -> None:
        """Answer the newest whole frame, once nothing more waits."""
        if self._intake is None or self._intake.take_waiting():
            return
        whole = self._intake.take_pending()
        if whole is not None:
            self.process(whole)

    def heard(self, topic: str) -> None:
        """Record the arrival of a message."""
        if self._watches is not None:
            self._watches[1].heard(topic)

    def process(self, messages: tuple[Any, ...]) -> None:
        """Answer a whole frame, or count why not; whatever happens, the node lives."""
        started, began_ns = time.perf_counter(), time.time_ns()
        try:
            self.answer(*messages)
        except Held:
            return
        except Drop as e:
            self.drop(e.reason, str(e))
        except InputError as e:
            topic = self._intake.inputs[0].topic if self._intake is not None else ""
            self.drop("bad input", f"{topic}: {e}")
        except BankError as e:
            self.drop("other bank", str(e))
        except Exception as e:  # a node outlives every frame
            self.survive(e, "answering a frame")
            self._reset_stage()
        else:
            now_ns = self.get_clock().now().nanoseconds
            latency_s = (now_ns - self.stamp_ns(*messages)) / 1e9
            self.figures.answer(time.perf_counter() - started, latency_s)
        finally:
            self.busy.add(began_ns, time.time_ns())

    def _reset_stage(self) -> None:
        try:
            self.stage.reset()
        except Exception:
            self.get_logger().error("reset failed as well:\n" + traceback.format_exc())

    # Parameters

    def _check_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        changes = {p.name: p.value for p in parameters}
        try:
            self.check_config(read_config(self, self.SECTIONS, changes, self.CONFIG), changes)
        except ConfigError as e:
            return SetParametersResult(successful=False, reason=str(e))
        return SetParametersResult(successful=True)

    def _take_parameters(self, parameters: list[Parameter]) -> None:
        if self.stage is None or not holds_setting((p.name for p in parameters), self.SECTIONS, self.CONFIG):
            return
        try:
            config = read_config(self, self.SECTIONS, config=self.CONFIG)
            stage = self.make_stage(config)
        except Exception:
            self.get_logger().error("the stage stays as it was:\n" + traceback.format_exc())
            return
        self.config, self.stage = config, stage
        changed = ", ".join(f"{p.name} = {p.value}" for p in parameters)
        self.get_logger().info(f"set {changed}; what was kept of earlier frames is dropped")

    # Telling

    def _tell_ready(self) -> None:
        if self._intake is None or not self.is_active:
            return
        wanted = self.value("consumers")
        joined = all(p.get_subscription_count() >= wanted for p in self._outputs)
        if self.value("producers"):
            joined = joined and self._intake.joined and all(s.get_publisher_count() for s in self._sources)
        self._joined_ticks = self._joined_ticks + 1 if joined else 0
        if self._joined_ticks > SETTLE_S / _READY_TICK_S:
            self._ready_timer.cancel()
            topics = ", ".join(i.topic for i in self._intake.inputs)
            self.get_logger().info(f"{self.get_name()} {READY}: listens to {topics}")

    def _watch(self) -> None:
        for topic in self._latched:
            topic.check()
        if self._intake is not None:
            self._intake.check()
        if self._watches is not None and self.is_active:
            self._watches[1].check()

    def _tell(self) -> None:
        status = DiagnosticStatus(name=self.get_fully_qualified_name(), hardware_id="depth_pose")
        status.level, status.message = self._judge()
        self.figures.counts["listeners"] = min((p.get_subscription_count() for p in self._outputs), default=0)
        status.values = [KeyValue(key=k, value=v) for k, v in self.figures.as_text().items()]
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    def _judge(self) -> tuple[bytes, str]:
        """Return level and text of this second's diagnostics."""
        new = self.figures.new_drops()
        if self._watches is None or not self.is_active:
            return DiagnosticStatus.OK, "is paused" if self._watches else "is not configured"
        crowd, silence = self._watches
        crowd.check()
        if new:
            level = DiagnosticStatus.ERROR if new["error"] else DiagnosticStatus.WARN
            return level, "dropped " + ", ".join(f"{n} {reason}" for reason, n in sorted(new.items()))
        if silence.silent:
            return DiagnosticStatus.WARN, "nothing from " + ", ".join(silence.silent)
        return DiagnosticStatus.OK, "answers" if self.figures.rate_hz() else "waits"
