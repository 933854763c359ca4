"""Pause and resume running nodes through their lifecycle services, without ``ros2``."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import rclpy
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future

from depth_pose.core.errors import DepthPoseError
from depth_pose.ros.process import NODES
from depth_pose.ros.process.security import init_context
from depth_pose.ros.process.shared_memory import with_account_advice

_FIND_S, _LONGEST_LOOK_S = 5.0, 0.2
"""Seconds to find a node's services, and the maximum that one check counts: while the machine stood still
nothing was discovered."""

ANSWER_S = 10.0
"""Seconds to wait for an answer before requesting the state again; loading a bank takes less."""

_STEPS = {
    (State.PRIMARY_STATE_UNCONFIGURED, True): Transition.TRANSITION_CONFIGURE,
    (State.PRIMARY_STATE_INACTIVE, True): Transition.TRANSITION_ACTIVATE,
    (State.PRIMARY_STATE_ACTIVE, False): Transition.TRANSITION_DEACTIVATE,
}
"""Transition that brings a node in a state nearer to the goal, active or not."""


def set_active(
    active: bool,
    nodes: Sequence[str] | None = None,
    namespace: str = "depth_pose",
    *,
    timeout_s: float = 60.0,
) -> dict[str, str]:
    """Pause nodes, or resume them, configuring them first if necessary.

    Parameters
    ----------
    active : bool
        True resumes, false pauses.
    nodes : sequence of str
        Names of the nodes; the four of `depth_pose.ros.process.supervisor` by default.
    namespace : str
    timeout_s : float
        For each node; loading a bank and compiling takes a while.

    Returns
    -------
    dict of str to str
        The state of each node afterwards.

    Raises
    ------
    DepthPoseError
        If a node does not exist, does not answer, or refuses.
    """
    context = Context()
    init_context(context, args=[])
    node = rclpy.create_node("depth_pose_lifecycle", context=context)
    try:
        caller = _Caller(node, context, timeout_s)
        # the first node stops first and starts last, so that the others are ready for its frames
        order = list(nodes or NODES)
        order = order[::-1] if active else order
        return {name: caller.bring(f"/{namespace.strip('/')}/{name}", active) for name in order}
    finally:
        node.destroy_node()
        rclpy.try_shutdown(context=context)


class _Caller:
    """Calls the lifecycle services of one node after another."""

    def __init__(self, node: Node, context: Context, timeout_s: float) -> None:
        self._node = node
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(node)
        self._timeout_s = timeout_s

    def bring(self, name: str, active: bool) -> str:
        """Activate or deactivate a node; return the label of its state.

        A request without an answer is repeated, beginning with the state: an answer is lost if the node had
        not yet discovered the client.
        """
        deadline = time.monotonic() + self._timeout_s
        while time.monotonic() < deadline:
            answer = self._call(GetState, f"{name}/get_state", GetState.Request())
            if answer is None:
                continue
            state = answer.current_state
            step = _STEPS.get((state.id, active))
            if step is None:
                return str(state.label)
            request = ChangeState.Request(transition=Transition(id=step))
            changed = self._call(ChangeState, f"{name}/change_state", request)
            if changed is not None and not changed.success:
                raise DepthPoseError(f"{name} is {state.label} and refused to change; its output says why")
        raise DepthPoseError(f"{name} did not answer in {self._timeout_s:.0f} s")

    def _call(self, kind: type, name: str, request: Any) -> Any:
        """Return the service's response, or None on timeout."""
        client = self._node.create_client(kind, name)
        looked, waited_s = time.monotonic(), 0.0
        while not client.service_is_ready():
            last, looked = looked, time.monotonic()
            waited_s += min(looked - last, _LONGEST_LOOK_S)
            if waited_s > min(_FIND_S, self._timeout_s):
                what = f"there is no service {name}; is the node running in this domain?"
                raise DepthPoseError(with_account_advice(what))
            self._executor.spin_once(timeout_sec=0.05)
        future: Future = client.call_async(request)
        self._executor.spin_until_future_complete(future, min(ANSWER_S, self._timeout_s))
        self._node.destroy_client(client)
        return future.result()
