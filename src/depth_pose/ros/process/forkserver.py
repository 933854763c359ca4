"""A process that has everything loaded, from which the nodes are forked.

Imports, compiled kernels and the bank are most of a node's start. Here they are loaded once. A node
that is forked from here starts at once, and shares this memory until it writes to it. A fork takes
only one thread along, so nothing may start a thread here: rclpy, whose middleware has threads, is
imported by the forked process.

Every process has one socket for standard input, output and errors; the supervisor holds its other end.
The server's brings the sockets of the processes to fork. A forked process prints its process id, waits
for one line of JSON (name and command line) and becomes that node. Its last line is its exit code. When
its socket closes, the supervisor is gone, or wants it to end.

Measured against this (2 cores, busy): plain processes take 15 s instead of 6 s to start, 1.7 to 2.5 s
instead of 0.4 s to replace a node, and 804 MB instead of 550 MB. The standard library's fork server is
as fast and as small. But every node runs the user's main script again, all suites of a program share
the first one's environment, a start cannot be interrupted while it loads, and when the server dies its
living processes are said to have ended.
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
import traceback

from depth_pose.ros.process.names import EXIT_CODE, LOADED, NODES, PROCESS_ID, WAITS
from depth_pose.ros.process.runner import STOPS, join_early


def main(bank: str) -> int:
    """Load, then fork whenever asked; gives the exit code, in a forked process that of the node.

    Parameters
    ----------
    bank : str
        Bank to load ahead; empty for the set-up's.
    """
    faulthandler.enable()  # a crash says where
    _load(bank)
    print(LOADED, flush=True)
    return _become_node() if _serve() else 0


def _load(bank: str) -> None:
    """Import the core, read the bank, and use every kernel once."""
    from depth_pose.core.config import PipelineConfig
    from depth_pose.core.errors import BankError
    from depth_pose.ros.process.warm_stages import load_bank, make_ahead
    from depth_pose.steps.extract import PeopleExtractor
    from depth_pose.steps.match import Matcher
    from depth_pose.steps.recover import Recoverer
    from depth_pose.steps.refine import Refiner

    config = PipelineConfig()
    make_ahead(PeopleExtractor, config.segment, config.denoise, config.mount)
    with contextlib.suppress(BankError):  # the nodes that need it refuse it, and say why
        loaded = load_bank(bank)
        make_ahead(Matcher, loaded, config.match, config.fit)
        make_ahead(Refiner, loaded, config.refine, config.match, config.fitting)
        make_ahead(Recoverer, loaded, config.recover, config.smooth, config.match, config.fitting)
    gc.collect()
    gc.freeze()  # what is here stays; a collection that wrote to it would end the sharing


def _serve() -> bool:
    """Fork when asked; True in a forked process, False when the supervisor is gone."""
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # the supervisor sees their ends by itself
    link = socket.socket(fileno=0)
    while True:
        asked, (*files,), _, _ = socket.recv_fds(link, 1, 1)
        if not asked:
            return False
        if os.fork() == 0:
            link.detach()
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            for standard in range(3):
                os.dup2(files[0], standard)
            os.close(files[0])
            return True
        os.close(files[0])


def _become_node() -> int:
    """Import ROS, wait for a name and a command line, be that node; gives its exit code."""
    print(f"{PROCESS_ID}{os.getpid()}", flush=True)
    for number in STOPS:
        signal.signal(number, lambda *_: sys.exit(0))  # until the node has its own handlers
    line, leave = "", None
    try:
        mains = {name: importlib.import_module(f"depth_pose.ros.nodes.{name}_node").main for name in NODES}
        if not select.select([0], [], [], 0.0)[0]:
            leave = join_early()
        print(WAITS, flush=True)
        line = sys.stdin.readline()
    except SystemExit:
        pass
    if not line:
        if leave is not None:
            leave()
        return 0
    threading.Thread(target=_end_with_supervisor, daemon=True).start()
    name, arguments = json.loads(line)
    try:
        return int(mains[name](arguments))
    except SystemExit:  # a signal before the node's own handlers
        return 0
    except Exception:
        traceback.print_exc()
        return 1


def _end_with_supervisor() -> None:
    """Have this process sent SIGTERM when its socket is closed, also by the supervisor's death."""
    with contextlib.suppress(OSError):
        os.read(0, 1)
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    code = main(sys.argv[1])
    gc.collect()  # what is left of a node lets go of its shared memory
    with contextlib.suppress(OSError):
        print(f"{EXIT_CODE}{code}", flush=True)
    os._exit(code)  # taking everything down one by one would first copy all that is shared
