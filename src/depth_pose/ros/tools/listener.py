"""A node of a command that looks at other nodes: it lives until the command is done or stopped."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from depth_pose.ros.process.runner import on_stop
from depth_pose.ros.process.security import init_context

_TICK_S = 0.05
"""Maximum wait for a message between checks for a stop signal, seconds."""

_DISCOVER_S = 3.0
"""Time limit for finding publishers, and then for a first message, seconds."""


def wait_until(condition: Callable[[], bool], turns: Callable[[float], Iterator[None]]) -> bool:
    """Wait until a condition holds, at most as long as discovery takes; return whether it does."""
    began = time.monotonic()
    for _ in turns(_TICK_S):
        if condition():
            return True
        if time.monotonic() - began > _DISCOVER_S:
            break
    return False


@contextmanager
def listener(name: str) -> Iterator[Any]:
    """Create a node, and a function that spins it for some seconds, until a stop signal."""
    import rclpy
    from rclpy.context import Context
    from rclpy.executors import SingleThreadedExecutor

    context, stopped = Context(), threading.Event()
    init_context(context, args=[])
    executor = SingleThreadedExecutor(context=context)
    node = rclpy.create_node(f"depth_pose_{name}", context=context, start_parameter_services=False)
    executor.add_node(node)

    def turns(seconds: float) -> Iterator[None]:
        while not stopped.is_set():
            until = time.monotonic() + seconds
            while time.monotonic() < until and not stopped.is_set():
                executor.spin_once(timeout_sec=_TICK_S)
            if not stopped.is_set():
                yield

    try:
        with on_stop(stopped.set):
            yield node, turns
    finally:
        executor.shutdown()
        rclpy.try_shutdown(context=context)
