"""Run a node until it receives a stop signal; exit with code 0."""

from __future__ import annotations

import contextlib
import ctypes
import faulthandler
import gc
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NoReturn

from depth_pose.core.errors import BankError, ConfigError
from depth_pose.core.printable import printable_lines
from depth_pose.ros import PRIVATE_UMASK
from depth_pose.ros.process import DONE
from depth_pose.ros.process.pulse import PULSE, start_pulse
from depth_pose.ros.process.security import init_context

EXIT_CONFIG = 2
"""Exit code where the configuration or the bank cannot be used: a restart would not help."""

END_WITH_PARENT = "DEPTH_POSE_END_WITH_PARENT"
"""Environment variable; if set, a node ends with its parent process, as those of launch do."""

STOPS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that ask a process to stop; the last when its terminal is closed."""

_PR_SET_PDEATHSIG = 1
"""Of Linux' prctl: the signal that a process gets when its parent dies."""

_MOST_HEAPS = -8
"""Of glibc's mallopt: M_ARENA_MAX."""

_END_S = 10.0
"""Seconds for an orderly end, after which the process prints a traceback and ends."""


class _Stop:
    """Handler of `STOPS`: interrupts the running code, and remembers the signal.

    Python drops exceptions that are raised in destructors and some callbacks.
    """

    def __init__(self) -> None:
        self.is_asked = False

    def __call__(self, number: int, frame: object) -> None:
        self.is_asked = True
        raise KeyboardInterrupt


def run_node(make: Callable[[], Any], args: Sequence[str] | None = None) -> int:
    """Create a node and run it until a stop signal.

    Parameters
    ----------
    make : callable
        Returns the `depth_pose.ros.nodes.node_base.StageNode`; called once rclpy is initialised.
    args : sequence of str, optional
        Command line with ``--ros-args``; the process' own if None, and then the process ends here.

    Returns
    -------
    int
        Exit code: 0 after one of `STOPS`, `EXIT_CONFIG` where the settings cannot be used.
    """
    faulthandler.enable()  # a crash prints a traceback
    stop = _Stop()
    for number in _heard():
        signal.signal(number, stop)
    os.umask(PRIVATE_UMASK)
    _share_one_heap()
    if os.environ.get(END_WITH_PARENT):
        end_with_parent()
    if args is None:
        set_title(Path(sys.argv[0]).stem)
    code = _run(make, args, stop)
    if args is None:
        leave(code)
    return code


def leave(code: int) -> NoReturn:
    """End the process without destroying all objects, which takes seconds; nothing is lost."""
    gc.collect()  # the remaining parts of the node release its shared memory
    with contextlib.suppress(OSError):
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(code)


def _run(make: Callable[[], Any], args: Sequence[str] | None, stop: _Stop) -> int:
    import rclpy  # after the handlers: a stop during these imports must be clean, too
    from rclpy.executors import ExternalShutdownException
    from rclpy.signals import SignalHandlerOptions, install_signal_handlers

    from depth_pose.ros.process.logs import ensure_log_folder

    node = None
    try:
        ensure_log_folder()
        known = list(args) if args is not None else None
        init_context(args=known, signal_handler_options=SignalHandlerOptions.NO)
        gc.disable()  # garbage collection takes a tenth of the start; these objects stay
        node = make()
        _release_memory()
        gc.freeze()
        gc.enable()
        install_signal_handlers(SignalHandlerOptions.ALL)
        if os.environ.get(PULSE) or os.environ.get(END_WITH_PARENT):  # the supervisor restarts it
            start_pulse(bool(os.environ.get(PULSE)))
        _spin(node, stop)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (ConfigError, BankError) as e:
        sys.stderr.write(f"depth_pose: {printable_lines(e)}\n")
        return EXIT_CONFIG
    except Exception:
        if node is None or rclpy.ok():  # else it was asked to stop, and rclpy was shut down during a call
            raise
    finally:
        for number in STOPS:
            signal.signal(number, signal.SIG_IGN)
        if args is None:
            faulthandler.dump_traceback_later(_END_S, exit=True)
        if node is not None:
            if sys.exc_info()[0] is None:  # a stop was requested
                with contextlib.suppress(OSError):  # nobody reads it
                    print(f"{node.get_name()} {DONE}", flush=True)
            with contextlib.suppress(Exception):
                node.destroy_node()
        with contextlib.suppress(RuntimeError):  # the signal handler's thread shuts down at the same time
            rclpy.try_shutdown()
    return 0


def _share_one_heap() -> None:
    """Let all threads allocate from one heap: 40 MB less in four nodes than with one each, as glibc has."""
    set_option = getattr(ctypes.CDLL(None), "mallopt", None)  # of glibc
    if set_option is not None:
        set_option(_MOST_HEAPS, 1)


def _release_memory() -> None:
    """Return to the system what loading needed and no longer does: tens of megabytes a process."""
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # of glibc
    if trim is not None:
        trim(0)


def _spin(node: Any, stop: _Stop) -> None:
    """Run callbacks until shutdown or a signal, and process complete frames."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        while rclpy.ok() and not stop.is_asked:
            _spin_once(executor, node)
    finally:
        executor.shutdown(timeout_sec=0.2)


def _spin_once(executor: Any, node: Any) -> None:
    from rclpy.executors import ExternalShutdownException

    try:
        executor.spin_once()
        while node.has_pending:
            node.process_pending()
    except (ExternalShutdownException, BankError, ConfigError):
        raise
    except Exception as e:  # for instance data that is not a message of its type
        node.survive(e, "taking a message")


def end_with_parent() -> None:
    """Make the kernel send SIGTERM to this process when its parent dies."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def set_title(title: str) -> None:
    """Set the name of this process for ``ps -e``, ``top`` and ``pgrep``: at most 15 letters."""
    Path("/proc/self/comm").write_text(title[:15])


@contextlib.contextmanager
def on_stop(callback: Callable[[], None]) -> Iterator[None]:
    """Call a function on `STOPS` within the block, in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {n: signal.signal(n, lambda *_: callback()) for n in _heard()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _heard() -> list[signal.Signals]:
    """Return `STOPS`, without SIGHUP where it is ignored: ``nohup`` asks for that."""
    return [n for n in STOPS if n != signal.SIGHUP or signal.getsignal(n) != signal.SIG_IGN]
