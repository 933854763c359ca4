"""Base of the nodes: life cycle, frames, parameters and diagnostics.

A node of this package is a thin, managed wrapper of one stage of the core. Configuring
builds the stage from the parameters and warms it up *before* any subscription, so that the
first frame does not wait for a compiler; once active it processes frames
(`depth_pose.ros.transport.intake`) and counts those without an answer. Unless the parameter ``autostart``
is false, a node configures and activates itself.
"""

from __future__ import annotations

import time
import traceback
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Protocol

from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import SetParametersResult
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from threadpoolctl import threadpool_limits

from depth_pose.core.config import PipelineConfig
from depth_pose.core.errors import BankError, ConfigError, DepthPoseError, InputError
from depth_pose.core.options import Sections
from depth_pose.core.printable import printable, printable_lines
from depth_pose.ros.messages.basics import stamp_to_ns
from depth_pose.ros.nodes.input_watch import MissingInputWatch, PublisherWatch
from depth_pose.ros.nodes.parameters import explain_unknown, holds_setting, read_config
from depth_pose.ros.nodes.topic_node import TopicNode
from depth_pose.ros.process import READY
from depth_pose.ros.setting import Setting
from depth_pose.ros.transport.intake import (
    Deferred,
    Drop,
    FrameSource,
    Input,
    Intake,
)
from depth_pose.ros.transport.losses import BusyTimes

__all__ = ["Deferred", "Drop", "Input", "Stage", "StageNode"]

SETTLE_S = 0.2
"""Seconds for which the connections must exist before a node reports that it is ready.
A publisher finds a subscriber before the subscriber finds the publisher.
"""

_READY_TICK_S = 0.05
"""Seconds between two checks of the connections."""

_NOT_POSSIBLE = "Failed to trigger lifecycle state machine transition"
"""What rclpy says of a transition that the present state does not have."""


class Stage(Protocol):
    """Interface of a stage of the core, as nodes use it."""

    def warm_up(self) -> None:
        """Compile every kernel."""

    def reset(self) -> None:
        """Forget all earlier frames."""


class StageNode(TopicNode, ABC):
    """A node around one stage; subclasses build the stage and convert messages.

    Queues hold one frame and the newest wins. With the parameter ``reliable`` every frame is processed
    in turn, and up to ``queue`` of them wait.

    Attributes
    ----------
    stage
        Result of `make_stage`; None until the node is configured.
    is_active : bool
        Whether frames are answered.
    intake : FrameSource or None
        The subscriptions; None until the node is configured.
    """

    CONFIG: ClassVar[type[Sections]] = PipelineConfig
    SECTIONS: ClassVar[tuple[str, ...]] = ()
    SETTINGS: ClassVar[tuple[Setting, ...]] = ()

    def __init__(self, name: str) -> None:
        threadpool_limits(1)  # the processes share the cores, and sums keep the order of `PosePipeline`
        super().__init__(name, self.SETTINGS, self.SECTIONS, self.CONFIG)
        self.busy = BusyTimes()
        self.stage: Any = None
        self.is_active = False
        self.intake: FrameSource | None = None
        self._refused: Exception | None = None
        self._watches: tuple[PublisherWatch, MissingInputWatch] | None = None
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._take_parameters)
        self.create_timer(1.0, self.publish_diagnostics, clock=self.steady_clock)
        self.create_timer(0.5, self._watch, clock=self.steady_clock)
        self._joined_ticks = 0
        self._guard_transitions()
        self._ready_timer = self.create_timer(_READY_TICK_S, self._tell_ready, clock=self.steady_clock)
        if self.value("autostart"):
            self.start()

    # Implemented by subclasses

    @abstractmethod
    def make_stage(self, config: Any) -> Stage:
        """Build the stage."""

    @abstractmethod
    def open_outputs(self) -> None:
        """Create the publishers with `publisher`."""

    @abstractmethod
    def inputs(self) -> Sequence[Input]:
        """Return the topics that bring frames; several need an intake of their own (`make_intake`)."""

    def make_intake(self) -> FrameSource:
        """Subscribe to the inputs."""
        (wanted,) = self.inputs()
        return Intake(self, wanted)

    @abstractmethod
    def answer(self, *messages: Any) -> None:
        """Convert, call the stage, convert, publish.

        Raises
        ------
        InputError, BankError, Drop
            If this frame has no answer.
        Deferred
            If the frame is deferred; the subclass calls `process` with it later.
        """

    def stamp_ns(self, *messages: Any) -> int:
        """Return the stamp of a frame."""
        return stamp_to_ns(messages[0].header.stamp)

    def check_config(self, config: Any, changes: Mapping[str, Any]) -> None:
        """Check settings that are changed while the node runs, beyond their ranges.

        Raises
        ------
        ConfigError
            Where the stage cannot be built from them.
        """

    def forget(self) -> None:
        """Drop messages that a subclass keeps; called when the node is paused or cleaned up."""

    # Life cycle

    @property
    def state_label(self) -> str:
        """The lifecycle state, in words."""
        if self.is_active:
            return "active"
        return "unconfigured or finalized" if self.intake is None else "inactive"

    def _guard_transitions(self) -> None:
        """Answer requests for transitions that are not possible now: rclpy raises, and the client waits."""
        (service,) = (s for s in self.services if s.srv_name.endswith("/change_state"))
        change = service.callback

        def change_if_possible(request: Any, response: Any) -> Any:
            try:
                return change(request, response)
            except RuntimeError as error:  # rclpy's, of a private module; other faults are not hidden
                if _NOT_POSSIBLE not in str(error):
                    raise
                what = request.transition.label or f"{request.transition.id}"
                why = printable(str(error).partition("\n")[0].partition(", at ")[0])
                self.get_logger().warning(
                    f"the transition {printable(what)} is not possible from {self.state_label}: {why}"
                )
                response.success = False
                return response

        service.callback = change_if_possible

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
        """Load the bank, build the stage, compile or load its kernels, open the topics."""
        try:
            self.prepare()
        except Exception as e:
            self._refused = e
            if not isinstance(e, DepthPoseError):
                self.get_logger().error(printable_lines(traceback.format_exc()))
            elif not self.value("autostart"):  # otherwise the process ends and reports it
                self.get_logger().error(printable_lines(e))
            self._close()
            return TransitionCallbackReturn.FAILURE
        return super().on_configure(state)

    def prepare(self) -> None:
        """Build the stage; a subclass may defer this until its inputs are known."""
        self.config = read_config(self, self.SECTIONS, config=self.CONFIG)
        self.stage = self.make_stage(self.config)
        self.stage.warm_up()
        self.open_outputs()
        self.intake = self.make_intake()
        inputs = self.intake.inputs
        self._watches = PublisherWatch(self, inputs), MissingInputWatch(self, inputs, reliable=self.lossless)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to answer frames."""
        self.is_active, self._joined_ticks = True, 0
        self._ready_timer.reset()
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Pause: topics stay open, arriving frames are ignored."""
        self.is_active = False
        self.forget()
        if self.stage is not None:
            self._reset_stage()
        if self.intake is not None:
            self.intake.forget()
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
        if self.intake is not None:
            self.intake.close()
        self.close_topics()
        self.intake = self._watches = self.stage = None

    # Frames

    @property
    def has_pending(self) -> bool:
        """Whether a complete frame waits for `process_pending`."""
        return self.intake is not None and self.intake.has_pending

    def process_pending(self) -> None:
        """Process the newest complete frame, once all waiting messages are received."""
        if self.intake is None or self.intake.take_waiting():
            return
        whole = self.intake.take_pending()
        if whole is not None:
            self.process(whole)

    def on_message(self, topic: str) -> None:
        """Record the arrival of a message."""
        if self._watches is not None:
            self._watches[1].on_message(topic)

    def process(self, messages: tuple[Any, ...]) -> None:
        """Process a complete frame, or count the reason why not; no error ends the node."""
        started, began_ns = time.perf_counter(), time.time_ns()
        try:
            self.answer(*messages)
        except Deferred:
            return
        except Drop as e:
            self.drop(e.reason, str(e))
        except InputError as e:
            topic = self.intake.inputs[0].topic if self.intake is not None else ""
            self.drop("bad input", f"{topic}: {e}")
        except BankError as e:
            self.drop("other bank", str(e))
        except Exception as e:  # no frame may end a node
            self.survive(e, "answering a frame")
            self._reset_stage()
        else:
            now_ns = self.get_clock().now().nanoseconds
            latency_s = (now_ns - self.stamp_ns(*messages)) / 1e9
            self.statistics.answer(time.perf_counter() - started, latency_s)
        finally:
            self.busy.add(began_ns, time.time_ns())

    def _reset_stage(self) -> None:
        try:
            self.stage.reset()
        except Exception:
            self.get_logger().error(printable_lines("reset failed as well:\n" + traceback.format_exc()))

    # Parameters

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set parameters; unknown ones are refused with a suggestion."""
        unknown = [p.name for p in parameter_list if not self.has_parameter(p.name)]
        if unknown:
            known = self.get_parameters_by_prefix("")
            reason = explain_unknown(f"the node {self.get_name()}", unknown, known)
            return SetParametersResult(successful=False, reason=reason)
        return super().set_parameters_atomically(parameter_list)

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
        began_ns = time.time_ns()
        try:
            config = read_config(self, self.SECTIONS, config=self.CONFIG)
            stage = self.make_stage(config)
        except Exception:
            self.get_logger().error(printable_lines("the stage stays as it was:\n" + traceback.format_exc()))
            return
        finally:
            self.busy.add(began_ns, time.time_ns())
        self.config, self.stage = config, stage
        changed = ", ".join(f"{p.name} = {p.value}" for p in parameters)
        self.get_logger().info(f"set {printable(changed)}; what was kept of earlier frames is dropped")

    # Diagnostics

    def _tell_ready(self) -> None:
        if self.intake is None or not self.is_active:
            return
        joined = self.is_joined and (self.intake.joined or not self.value("producers"))
        self._joined_ticks = self._joined_ticks + 1 if joined else 0
        if self._joined_ticks > SETTLE_S / _READY_TICK_S:
            self._ready_timer.cancel()
            topics = ", ".join(i.topic for i in self.intake.inputs)
            self.get_logger().info(f"{self.get_name()} {READY}: listens to {topics}")

    def _watch(self) -> None:
        self.check_latched()
        if self.intake is not None:
            self.intake.check()
        if self._watches is not None and self.is_active:
            self._watches[1].check()

    def judge(self) -> tuple[bytes, str]:
        """Return level and text of this second's diagnostics."""
        new = self.statistics.new_drops()
        if self._watches is None or not self.is_active:
            return DiagnosticStatus.OK, "is paused" if self._watches else "is not configured"
        publishers, missing_inputs = self._watches
        publishers.check()
        if new:
            level = DiagnosticStatus.ERROR if new["error"] else DiagnosticStatus.WARN
            return level, "dropped " + ", ".join(f"{n} {reason}" for reason, n in sorted(new.items()))
        if missing_inputs.missing:
            return DiagnosticStatus.WARN, "nothing from " + ", ".join(missing_inputs.missing)
        return DiagnosticStatus.OK, "answers" if self.statistics.rate_hz() else "waits"
