"""What the viewer costs the nodes: their CPU time over a replay, without and with a viewer that listens.

python benchmarks/viewer_cost.py RECORDING.mcap [ROUNDS]

The viewer runs in a process of its own, as it always does; a browser may be open on it (port 8080). Prints
CPU seconds of each by second of the recording; the difference between the first two is the nodes' share.
"""

from __future__ import annotations

import subprocess
import sys
import time

import numpy as np
import psutil

from depth_pose.io.mcap_read import DepthReader
from depth_pose.ros.process.supervisor import Suite
from depth_pose.ros.transport.bag import Player


def cpu_s(processes):
    return sum(sum(p.cpu_times()[:2]) for p in processes)


def nodes():
    """The processes of the nodes: all below this one but the viewer."""
    return [
        p
        for p in psutil.Process().children(recursive=True)
        if p.is_running() and "view" not in p.cmdline()[-4:]
    ]


def replay(recording, topics):
    """CPU seconds of the nodes over one replay, and its length."""
    running = nodes()
    before, started = cpu_s(running), time.monotonic()
    Player(recording, topics=topics, wait_for_subscribers=topics).run()
    time.sleep(1.0)
    return cpu_s(running) - before, time.monotonic() - started - 1.0


def main():
    recording, rounds = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 3
    topic = DepthReader(recording).topic
    topics = [topic.name, topic.info_topic]
    shares = {False: [], True: []}
    viewer_share = []
    with Suite(sink=lambda line: None) as suite:
        replay(recording, topics)  # warm
        for _ in range(rounds):
            for with_viewer in (False, True):
                viewer = None
                if with_viewer:
                    command = [sys.executable, "-m", "depth_pose.cli", "view", "--port", "8080"]
                    viewer = psutil.Process(subprocess.Popen(command, stdout=subprocess.DEVNULL).pid)
                    time.sleep(15.0)
                    its = cpu_s([viewer])
                cpu, seconds = replay(recording, topics)
                shares[with_viewer].append(cpu / seconds)
                if viewer is not None:
                    viewer_share.append((cpu_s([viewer]) - its) / seconds)
                    viewer.terminate()
                    viewer.wait(10)
        assert suite.failure is None
    without, with_it = (np.array(shares[w]) for w in (False, True))
    print(f"{topic.frames} frames of {topic.name} in {seconds:.1f} s, {rounds} rounds; cores in use:")
    print(f"nodes without a viewer: {without.round(3)}, median {np.median(without):.3f}")
    print(f"nodes with a viewer:    {with_it.round(3)}, median {np.median(with_it):.3f}")
    print(f"the viewer itself:      {np.round(viewer_share, 3)}")


if __name__ == "__main__":
    main()
