"""Spin a node in a thread that ends before the interpreter does."""

from __future__ import annotations

import atexit
import contextlib
import threading
from typing import Any


def spin_in_background(node: Any) -> None:
    """Spin a node of the default context in a thread; shut rclpy down and join the thread at exit.

    A thread that is still inside rclpy when Python ends aborts the process: ``terminate called without an
    active exception``, exit code 134.
    """
    import rclpy
    from rclpy.executors import ExternalShutdownException

    def spin() -> None:
        with contextlib.suppress(ExternalShutdownException):
            rclpy.spin(node)

    def end() -> None:
        rclpy.try_shutdown()
        thread.join()

    thread = threading.Thread(target=spin, name="spin", daemon=True)
    thread.start()
    atexit.register(end)
