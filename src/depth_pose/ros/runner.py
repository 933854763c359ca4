"""Run a node, and end what runs, with exit code 0, when it is asked to stop."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any

PARENT_VARIABLE = "DEPTH_POSE_PARENT"
"""Process id of the supervisor; a node ends with it."""

EXIT_CONFIG = 2
"""Exit code where the configuration or the bank cannot be used: starting again will not help."""

_PR_SET_PDEATHSIG = 1


def run_node(make: Callable[[], Any], args: Sequence[str] | None = None) -> int:
    """Make a node and run it until it is asked to stop.

    Parameters
    ----------
    make : callable
        Gives the `depth_pose.ros.node_base.StageNode`; called once rclpy is initialised.
    args : sequence of str, optional
        Command line with ``--ros-args``; the process' own if None.

    Returns
    -------
    int
        Exit code: 0 after SIGINT or SIGTERM, `EXIT_CONFIG` where the settings cannot be used.
    """
    end_with_parent()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _stop)
    import rclpy  # after the handlers: a stop during these imports must be clean, too
    from rclpy.executors import ExternalShutdownException
    from rclpy.signals import SignalHandlerOptions, install_signal_handlers

    from depth_pose.errors import BankError, ConfigError

    node = None
    try:
        rclpy.init(
            args=list(args) if args is not None else None, signal_handler_options=SignalHandlerOptions.NO
        )
        node = make()
        install_signal_handlers(SignalHandlerOptions.ALL)
        _spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (ConfigError, BankError) as e:
        sys.stderr.write(f"depth_pose: {e}\n")
        return EXIT_CONFIG
    finally:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
        if node is not None:
            with contextlib.suppress(Exception):
                node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _spin(node: Any) -> None:
    """Call back until shutdown; a whole frame is begun only when nothing more waits."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        while rclpy.ok():
            before = node.arrivals
            executor.spin_once(timeout_sec=0.0 if node.has_pending else None)
            if node.has_pending and node.arrivals == before:
                node.process_pending()
    finally:
        executor.shutdown(timeout_sec=0.2)


@contextlib.contextmanager
def on_stop(callback: Callable[[], None]) -> Iterator[None]:
    """Call back on SIGINT and SIGTERM within the block, where it is the main thread's."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {n: signal.signal(n, lambda *_: callback()) for n in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _stop(number: int, frame: object) -> None:
    raise KeyboardInterrupt


def end_with_parent() -> None:
    """Have the kernel send SIGTERM when the supervisor dies, however it dies."""
    parent = os.environ.get(PARENT_VARIABLE)
    if not parent or not sys.platform.startswith("linux"):
        return
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != int(parent):  # it died before the line above
        sys.exit(0)
