"""The pulse of a node's process: signs of life for `up`, and a restart if it did not run for seconds.

A thread writes a byte to the standard output four times a second, also while a frame takes long. If that
output is closed, the parent has ended, and the process ends.

A process that did not run for longer than the lease of its ROS participant may have been dropped from the
ROS graph by others, or have dropped them, and Fast DDS does not always find all of them again. It ends, and
its supervisor restarts it.
"""

from __future__ import annotations

import os
import signal
import threading
import time

from depth_pose.ros.process import BEAT, BEAT_S

PULSE = "DEPTH_POSE_PULSE"
"""Environment variable; if set, a node writes its signs of life to its standard output."""

STARVED_S = 4.5
"""Seconds without running after which others may have dropped a process.

Less than ``leaseDuration`` in ``fastdds.xml``, 5 s, by an announcement or two.
"""

_SETTLED = 8
"""Number of timely beats (2 s) after which a process counts as running again: an earlier restart would starve
as well."""

_GOODBYE_S = 5.0
"""Seconds for an orderly end, after which the process kills itself."""


def start_pulse(beats: bool) -> None:
    """Start the thread; it writes signs of life if enabled, and ends a process that has starved."""
    threading.Thread(target=_beat_until_starved, args=(beats,), name="pulse", daemon=True).start()


def _beat_until_starved(beats: bool) -> None:
    starved, on_time, since_s = False, 0, time.monotonic()
    while not (starved and on_time >= _SETTLED):
        if beats and not _beat():
            break
        time.sleep(BEAT_S)
        last_s, since_s = since_s, time.monotonic()
        starved |= since_s - last_s > STARVED_S
        on_time = on_time + 1 if since_s - last_s < 2.0 * BEAT_S else 0
    else:
        print(f"did not run for {STARVED_S:.1f} s or more; it starts anew, to join ROS again", flush=True)
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(_GOODBYE_S)
    os.kill(os.getpid(), signal.SIGKILL)


def _beat() -> bool:
    """Write a sign of life; return whether the output is still open."""
    try:
        os.write(1, BEAT)
    except OSError:
        return False
    return True
