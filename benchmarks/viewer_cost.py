"""What the viewer costs the nodes: their CPU time over a replay, without and with a viewer that listens.

python benchmarks/viewer_cost.py RECORDING.mcap [ROUNDS]

The viewer runs in a process of its own, as it always does; a browser may be open on it (port 8080). Nodes
leave out frames on a busy machine, so their time is told by answered frame.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time

import numpy as np
import psutil

from depth_pose.io.mcap_read import DepthReader
from depth_pose.io.schemas import PEOPLE_TOPIC
from depth_pose.ros.process.supervisor import Suite
from depth_pose.ros.tools.bag import Player, Recorder


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
    """CPU milliseconds of the nodes by answered frame of one replay, answers, and its length in seconds."""
    with tempfile.TemporaryDirectory() as folder, Recorder(f"{folder}/out.mcap", [PEOPLE_TOPIC]) as recorder:
        recorder.wait_subscribed()
        running = nodes()
        before, started = cpu_s(running), time.monotonic()
        Player(recording, topics=topics, wait_for_subscribers=topics).run()
        seconds = time.monotonic() - started
        time.sleep(1.0)
        answers = recorder.counts[PEOPLE_TOPIC]
        return 1e3 * (cpu_s(running) - before) / max(answers, 1), answers, seconds


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
                cpu, answers, seconds = replay(recording, topics)
                shares[with_viewer].append(cpu)
                name = "with" if with_viewer else "without"
                print(f"{name}: {answers} answers in {seconds:.1f} s, {cpu:.1f} ms each")
                if viewer is not None:
                    viewer_share.append((cpu_s([viewer]) - its) / seconds)
                    viewer.terminate()
                    viewer.wait(10)
        assert suite.failure is None
    without, with_it = (np.median(shares[w]) for w in (False, True))
    print(
        f"{topic.frames} frames of {topic.name}, {rounds} rounds, CPU of the nodes by answered frame, median:"
    )
    print(f"without a viewer {without:.1f} ms, with one {with_it:.1f} ms")
    print(f"the viewer itself: {np.round(viewer_share, 2)} of a core")


if __name__ == "__main__":
    main()
