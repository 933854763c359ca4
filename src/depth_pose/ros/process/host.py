"""The process that loads everything once, and forks nodes as the supervisor asks for them.

Imports, compiled kernels and the bank are most of a node's start. A node that is forked from here starts
at once, and shares this memory until it writes to it.
A fork takes only one thread along, so rclpy is imported here, and never initialised. (The import
starts two threads of LTTng, the tracer: forked nodes cannot be traced.) All that is forked, another host
among it, is the supervisor's: each has a connection to it for what it prints and its signs of life, ends
when that ends, and outlives this host.
"""

from __future__ import annotations

import contextlib
import faulthandler
import gc
import importlib
import json
import os
import select
import signal
import socket
import sys
import threading
import time
import traceback
from typing import Any

from depth_pose.ros import PRIVATE_UMASK
from depth_pose.ros.process import BEAT, BEAT_S, NODES, PID, READY, SECOND_HOST, SPARES
from depth_pose.ros.process.logs import ensure_log_folder
from depth_pose.ros.process.runner import leave
from depth_pose.ros.process.shared_memory import keep_private
from depth_pose.ros.process.standstill import StandstillWatch

_DROPPED_S = 4.5
"""Seconds; others may have dropped a process that did not run for so long.

Less than leaseDuration in `fastdds.xml`, 5 s, by an announcement or two.
"""

_SETTLED, _SETTLED_SPARE = 8, 4
"""Beats in time that show that a process runs again, 2 s; spares make way sooner. Set by hand."""

_UNUSED = ("charset_normalizer", "coverage", "rosidl_pycommon")
"""What SciPy, numba and ROS' messages import where they find it, with others, and else do without."""

_LOOK_BEATS, _STILL = 4, 7
"""Beats from one look at Fast DDS to the next, 1 s; and looks without a sign of one of its timers' threads,
of which each announces its process every 0.3 s by our profiles, else every 3 s."""


def serve() -> int:
    """Fork what is asked for, until the supervisor is gone: a node, a second host or a spare."""
    print(f"the host {READY}", flush=True)
    supervisor = socket.socket(fileno=0)
    while True:
        _beat()
        if select.select([supervisor], [], [], BEAT_S)[0]:
            request, connections, _, _ = socket.recv_fds(supervisor, 1 << 20, 1)
            if not request:
                return 0
            _fork(connections[0], *json.loads(request))
            os.close(connections[0])


def _fork(connection: int, name: str, arguments: list[str]) -> None:
    """Fork twice: a process whose parent has ended is the supervisor's."""
    if (between := os.fork()) != 0:
        os.waitpid(between, 0)
        return
    if os.fork() != 0:
        os._exit(0)
    for standard in range(3):
        os.dup2(connection, standard)
    os.close(connection)
    print(f"{PID}{os.getpid()}", flush=True)
    leave(serve() if name == SECOND_HOST else _be_node(name, arguments))


def _beat() -> None:
    with contextlib.suppress(OSError):  # the supervisor is gone
        os.write(1, BEAT)


def _watch_supervisor(settled: int) -> None:
    """Give signs of life, also while a frame takes long; end this process with the supervisor.

    It also ends, for another to take its place, where it did not run for so long that others may have
    dropped it from the ROS graph, or it them: Fast DDS does not always find all of that again. First it lets
    `settled` beats go by in time: before that, the next one would fare no better. And it ends at once where
    Fast DDS stands still in it.
    """
    still = StandstillWatch(_STILL)
    poll = select.poll()
    poll.register(0, select.POLLRDHUP)
    dropped, on_time, since_s, beats = False, 0, time.monotonic(), 0
    while not poll.poll(1000 * BEAT_S) and not (dropped and on_time == settled):
        waited_s = time.monotonic() - since_s
        dropped |= waited_s > _DROPPED_S
        on_time = on_time + 1 if waited_s < 2.0 * BEAT_S else 0
        beats += 1
        if beats % _LOOK_BEATS == 0 and still.look():
            print(f"receives nothing: Fast DDS has stood still for {_STILL} s; it is killed", flush=True)
            os.kill(os.getpid(), signal.SIGKILL)
        _beat()
        since_s = time.monotonic()
    if dropped:
        print(f"did not run for {_DROPPED_S:.1f} s or more; it starts anew, to join ROS again", flush=True)
    os.kill(os.getpid(), signal.SIGTERM)


def _be_node(name: str, arguments: list[str]) -> int:
    """Be a node, or a spare that is told later which; gives its exit code."""
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))  # until it is a node
    settled = _SETTLED_SPARE if name in SPARES else _SETTLED
    threading.Thread(target=_watch_supervisor, args=(settled,), name="pulse", daemon=True).start()
    joined = None
    try:
        if name in SPARES:
            rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
            joined = rclpy.create_node(
                f"spare_{os.getpid()}",
                namespace="depth_pose",
                enable_rosout=False,
                start_parameter_services=False,
            )
            keep_private()
            print(f"{joined.get_name()} {READY} to become a node", flush=True)
            name, arguments = json.loads(sys.stdin.readline() or sys.exit(0))
        return _module(name).main(arguments)
    except SystemExit:  # told to stop before it was a node
        if joined is not None:
            joined.destroy_node()  # else shared memory would be left behind
        rclpy.try_shutdown()
        return 0
    except Exception:
        traceback.print_exc()
        return 1


def _module(name: str) -> Any:
    return importlib.import_module(f"depth_pose.ros.nodes.{name}_node")


def load(bank: str) -> None:
    """Load all that nodes need; a bank's path, empty for the set-up's."""
    gc.disable()  # collections would take a sixth of the time
    for unused in _UNUSED:
        sys.modules.setdefault(unused, None)  # type: ignore[arg-type]
    from depth_pose.ros.process.warm_stages import make_ahead

    make_ahead(bank)
    for name in NODES:
        _module(name)
    _load_message_types()
    gc.freeze()  # what is here stays; a collection that wrote to it would end the sharing
    gc.enable()


def _load_message_types() -> None:
    """Load the libraries of messages and services, else a third of a node's start."""
    from rclpy.type_support import check_for_type_support

    for name, module in list(sys.modules.items()):
        if name.endswith((".msg", ".srv")):
            for kind in vars(module).values():
                if hasattr(type(kind), "__import_type_support__"):
                    check_for_type_support(kind)


if __name__ == "__main__":
    faulthandler.enable()  # a crash says where
    os.umask(PRIVATE_UMASK)
    ensure_log_folder()
    load(sys.argv[1])
    leave(serve())
