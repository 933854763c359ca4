"""Memory and start of the live nodes.

    python benchmarks/memory.py

Starts the four nodes, and what helps to start them, as ``depth-pose up`` does, plays a simulated
recording for a while, and reads from /proc what each process holds. RSS counts pages that several
processes share (libraries, the interpreter) once for each; PSS shares them out, so that its sum is what
the machine really gives. Printed too is the time until all nodes are ready, from a warm cache of compiled
kernels.
"""

from __future__ import annotations

import argparse
import os
import random
import tempfile
import threading
import time
from pathlib import Path

os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("ROS_DOMAIN_ID", str(random.SystemRandom().randrange(1, 101)))

from depth_pose.ros.bag import Player
from depth_pose.ros.supervisor import NODES, Suite
from depth_pose.sim.config import Person
from depth_pose.sim.motion import load_motion
from depth_pose.sim.simulate import simulate

TOPICS = ["/camera/depth/image_raw", "/camera/depth/camera_info"]
_PARTS = ("Rss", "Pss", "Pss_Anon", "Pss_File")


def held_mb(pid: int) -> dict[str, float]:
    """Memory of a process by kind, in millions of bytes."""
    held = {}
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()[1:]:
        name, value = line.split(":")
        held[name] = int(value.split()[0]) * 1024 / 1e6
    return held


def descendants(pid: int) -> list[int]:
    """Processes that a process has started, and theirs."""
    tasks = Path(f"/proc/{pid}/task").glob("*/children")
    found = [int(child) for task in tasks for child in task.read_text().split()]
    return found + [further for child in found for further in descendants(child)]


def main() -> None:
    """Run."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--bank", help="exemplar bank; the set-up's by default")
    parser.add_argument("--seconds", type=float, default=15.0, help="how long to play")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder) / "input.mcap"
        simulate(recording, Person().body(), load_motion("play", 25.0, 4.0))
        started = time.monotonic()
        # one start to fill the caches, one to measure
        with Suite(bank=arguments.bank, parameters={"use_sim_time": True}, sink=lambda line: None):
            print(f"ready after {time.monotonic() - started:.1f} s (first start)")
        started = time.monotonic()
        with Suite(bank=arguments.bank, parameters={"use_sim_time": True}, sink=lambda line: None) as suite:
            print(f"ready after {time.monotonic() - started:.1f} s (second start)")
            player = Player(recording, loop=True, topics=TOPICS, wait_for_subscribers=TOPICS)
            playing = threading.Thread(target=player.run, daemon=True)
            playing.start()
            time.sleep(arguments.seconds)
            pids = {name: suite.pid(name) or -1 for name in NODES}
            others = [pid for pid in descendants(os.getpid()) if pid not in pids.values()]
            pids |= {f"helper {k}": pid for k, pid in enumerate(others, start=1)}
            held = {name: held_mb(pid) for name, pid in pids.items()}
            player.stop()
            playing.join(10.0)
    print("| MB | " + " | ".join(("RSS", "PSS", "of it own", "of it files")) + " |")
    print("|---" * (len(_PARTS) + 1) + "|")
    rows = held | {
        "**four nodes**": {p: sum(held[n][p] for n in NODES) for p in _PARTS},
        "**with the helpers**": {p: sum(h[p] for h in held.values()) for p in _PARTS},
    }
    for name, parts in rows.items():
        print(f"| {name} | " + " | ".join(f"{parts[p]:.0f}" for p in _PARTS) + " |")


if __name__ == "__main__":
    main()
