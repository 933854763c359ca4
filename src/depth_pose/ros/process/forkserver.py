"""A process that has everything loaded, from which the nodes are forked.

Most of a node's start is imports, compiled kernels that are read from the cache, and the bank. Here
that is done once; a node forked from this process starts at once, and shares the memory until it
writes to it. A fork takes only the calling thread along, so nothing may start a thread here: rclpy
is imported by the forked node, as loading Fast DDS starts some.

The supervisor sends the two ends of pipes, standard input and output of the new process; it is told
the process id, and the exit code when the process ends. What was forked waits on its standard input
for one line of JSON, the node's name and its command line, and becomes that node.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import json
import os
import select
import selectors
import signal
import socket
import sys
from collections.abc import Sequence

LOADED = "fork server is loaded"
"""It prints this when it forks at once."""

WAITS = "waits to become a node"
"""A forked process prints this when it has imported what a node needs, and has joined the graph."""


def main(arguments: Sequence[str]) -> int:
    """Load, then fork whenever asked; gives the exit code, in a forked process that of the node.

    Parameters
    ----------
    arguments : sequence of str
        File descriptor of the supervisor's socket, and the bank, empty for the set-up's.
    """
    link = socket.socket(fileno=int(arguments[0]))
    _load(arguments[1])
    print(LOADED, flush=True)
    return _become_node() if _serve(link) else 0


def _load(bank: str) -> None:
    """Import the core, read the bank, and use every kernel once."""
    from depth_pose.core.config import PipelineConfig
    from depth_pose.core.errors import BankError
    from depth_pose.ros.nodes.warm_stages import load_bank, make_ahead
    from depth_pose.steps.extract import PersonExtractor
    from depth_pose.steps.match import Matcher
    from depth_pose.steps.recover import Recoverer
    from depth_pose.steps.refine import Refiner

    config = PipelineConfig()
    make_ahead(PersonExtractor, config.segment, config.denoise)
    with contextlib.suppress(BankError):  # the nodes that need it refuse it, and say why
        loaded = load_bank(bank)
        make_ahead(Matcher, loaded, config.match, config.fit)
        make_ahead(Refiner, loaded, config.refine, config.match, config.fitting)
        make_ahead(Recoverer, loaded, config.recover, config.smooth, config.fitting)
    gc.collect()
    gc.freeze()  # what is here stays; a collection that wrote to it would end the sharing


def _serve(link: socket.socket) -> bool:
    """Fork when asked; True in a forked process, False when the supervisor is gone."""
    ended = selectors.PollSelector()
    ended.register(link, selectors.EVENT_READ)
    while True:
        for key, _ in ended.select():
            if key.fileobj is not link:
                ended.unregister(key.fileobj)
                _, status = os.waitpid(key.data, 0)
                os.close(key.fd)
                link.send(json.dumps([key.data, os.waitstatus_to_exitcode(status)]).encode())
                continue
            asked, files, _, _ = socket.recv_fds(link, 16, 2)
            if not asked:
                return False
            pid = os.fork()
            if pid == 0:
                for other in list(ended.get_map().values()):
                    os.close(other.fd)
                link.detach()
                ended.close()
                os.dup2(files[0], 0)
                os.dup2(files[1], 1)
                os.dup2(files[1], 2)
            for file in files:
                os.close(file)
            if pid == 0:
                return True
            ended.register(os.pidfd_open(pid), selectors.EVENT_READ, pid)
            link.send(json.dumps([pid, None]).encode())


def _become_node() -> int:
    """Import ROS, wait for a name and a command line, be that node; gives its exit code."""
    from depth_pose.ros.process.runner import end_with_parent, join_early, leave
    from depth_pose.ros.process.supervisor import NODES

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os._exit(0))  # until the node has its own handlers
    end_with_parent()
    mains = {name: importlib.import_module(f"depth_pose.ros.nodes.{name}_node").main for name in NODES}
    joined = None if select.select([0], [], [], 0.0)[0] else join_early()
    print(WAITS, flush=True)
    line = _read_line()
    if not line:
        if joined is not None:
            leave(joined)
        return 0
    name, arguments = json.loads(line)
    code = int(mains[name](arguments))
    del joined
    return code


def _read_line() -> str:
    """Wait for a line; empty when the supervisor is gone or a signal comes."""

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, stop)
        return sys.stdin.readline()
    except KeyboardInterrupt:
        return ""


if __name__ == "__main__":
    code = main(sys.argv[1:])
    gc.collect()  # what is left of a node lets go of its shared memory
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)  # taking everything down one by one would first copy all that is shared
