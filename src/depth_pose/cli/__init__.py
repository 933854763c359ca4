"""The ``depth-pose`` command.

Nothing is imported here, so that Ctrl-C works from the start; `depth_pose.cli.app` has the commands.
"""

from __future__ import annotations

import os
import signal
import sys

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

LEAST_MEMORY_MB = 1000
"""Minimum address space of a command, MB: with less, libraries hang or crash on loading. ``run`` takes
0.7 to 1 GB."""

STOPPED = 130
"""Exit code after Ctrl-C, as shells have it."""


def main() -> None:
    """Run the command; Ctrl-C while it loads ends it silently."""
    _check_memory()
    is_heard = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if is_heard:  # and not ignored, as in a shell's background job
        signal.signal(signal.SIGINT, _stop)  # a KeyboardInterrupt is lost in some modules' imports
    from depth_pose.cli.app import run_command

    try:
        if is_heard:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        run_command()
    except KeyboardInterrupt:
        raise SystemExit(STOPPED) from None


def _check_memory() -> None:
    """End the command where the address space is limited to too little."""
    if resource is None:
        return
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit != resource.RLIM_INFINITY and limit < LEAST_MEMORY_MB * 10**6:
        need = f"depth-pose needs {LEAST_MEMORY_MB}"
        sys.exit(f"error: there is too little memory: ulimit -v allows {limit // 10**6} MB, {need}")


def _stop(*_: object) -> None:
    os._exit(STOPPED)
