"""Play a recording over and over to the live nodes, and measure the growth of memory and latency.

    python benchmarks/soak.py --hours 8 -o soak
    python benchmarks/soak.py --hours 0.05 --stall 20

A recording loops, in which three people walk about, hide and cross; with each loop they disappear and enter
again. Two other processes subscribe to all points: one takes half a second for each cloud, the other stops
reading for good after a minute (SIGSTOP). Every two seconds the memory of every process is read, and every
answer's latency counts from the moment its frame was sent. Growth is that of the resident set. With
``--stall`` one node after another is stopped for two seconds, so that the queues before it fill, as they do
without processor time. Writes ``soak.npz``, ``soak.png`` and prints a table: slope of each process's memory
after the first tenth, people in view, and the 95th percentile of the latency in the first and last tenth.
"""

from __future__ import annotations

import argparse
import itertools
import os
import random
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from depth_pose.io.messages import read_people
from depth_pose.io.schemas import PEOPLE_TOPIC
from depth_pose.ros import stay_local
from depth_pose.ros.process import NODES

os.environ.setdefault("ROS_DOMAIN_ID", str(random.SystemRandom().randrange(1, 101)))

FPS = 15.0
"""Frame rate of the single person's recording, hertz."""
SECONDS, PEOPLE, WIDTH = 20.0, 3, 320
"""Length of a recording; number of people in the room's, and its image width."""
EVERY_S, STALL_S = 2.0, 2.0
"""Interval of memory readings, and duration of a node's stop, seconds."""
SLOW_S, DEAF_AFTER_S = 0.5, 60.0
"""Time the slow subscriber takes for a cloud, and when the other one stops reading, seconds."""


def memory_bytes(pid: int | None, kind: str = "Rss:") -> float:
    """Resident memory of a process, or its proportional share (``"Pss:"``); NaN if it has ended."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except (FileNotFoundError, ProcessLookupError):
        return float("nan")
    return next((1024.0 * int(line.split()[1]) for line in lines if line.startswith(kind)), float("nan"))


def slope_mb_per_hour(seconds: np.ndarray, memory: np.ndarray) -> float:
    """Growth by least squares, without the first tenth, in which libraries are still loaded."""
    kept = (seconds > seconds[-1] / 10) & np.isfinite(memory)
    return float(np.polyfit(seconds[kept] / 3600, memory[kept] / 1e6, 1)[0])


def make_recording(path: Path) -> None:
    """Simulate a person in front of a time-of-flight sensor."""
    from dataclasses import replace

    from depth_pose.sim.config import Person
    from depth_pose.sim.motion import load_motion
    from depth_pose.sim.simulate import Stage, simulate

    stage = Stage()
    stage = replace(stage, sensor=replace(stage.sensor, fps=FPS))
    simulate(path, Person().body(), load_motion("play", FPS, SECONDS), stage)


def make_room(path: Path, fps: float) -> None:
    """Simulate people who walk about in a room, hide and cross."""
    from depth_pose.sim.clips import sample_clip, write_clip

    write_clip(path, sample_clip(np.random.default_rng(5), round(SECONDS * fps), fps, PEOPLE, WIDTH))


def listen_slowly() -> None:
    """Run a subscriber that takes long for each cloud, in a separate process."""
    import rclpy
    from rclpy.qos import qos_profile_sensor_data
    from sensor_msgs.msg import PointCloud2

    rclpy.init()
    node = rclpy.create_node("slow_listener")
    node.create_subscription(
        PointCloud2, "/depth_pose/points", lambda _: time.sleep(SLOW_S), qos_profile_sensor_data
    )
    rclpy.spin(node)


class Soak:
    """Measurements during the run."""

    def __init__(self) -> None:
        self.sent: dict[int, int] = {}
        self.frames = 0
        self.latency: list[tuple[float, float]] = []
        self.people: list[int] = []
        self.memory: list[tuple[float, ...]] = []
        self.shared_mb = float("nan")
        self.started = time.monotonic()

    def run(self, recording: Path, bank: str | None, minutes: float, stall_s: float) -> dict[str, int]:
        """Play; return the number of restarts."""
        from depth_pose.ros.process.supervisor import Suite
        from depth_pose.ros.tools.bag import Player, Recorder, header_stamp_ns

        def sent(message: object, now_ns: int) -> None:
            if message.topic.endswith("image_raw"):  # type: ignore[attr-defined]
                self.sent[header_stamp_ns(message.data)] = now_ns  # type: ignore[attr-defined]
                self.frames += 1

        def received(topic: str, data: bytes, now_ns: int) -> None:
            self.people.append(len(read_people(data).skeletons))
            went = self.sent.pop(header_stamp_ns(data), None)
            if went is not None:
                self.latency.append((time.monotonic() - self.started, (now_ns - went) / 1e9))

        topics = ["/camera/depth/image_raw", "/camera/depth/camera_info"]
        suite = Suite(bank=bank, parameters={"use_sim_time": True}, sink=lambda line: None)
        written = recording.with_name("soak_skeletons.mcap")
        with suite, Recorder(written, [PEOPLE_TOPIC], on_message=received) as recorder:
            recorder.wait_subscribed()
            player = Player(recording, loop=True, topics=topics, wait_for_subscribers=topics, on_message=sent)
            self.started = time.monotonic()
            playing = threading.Thread(target=player.run, daemon=True)
            playing.start()
            slow, deaf = (subprocess.Popen([sys.executable, __file__, "--listen"]) for _ in range(2))
            stalled, next_stall = itertools.cycle(NODES), stall_s or float("inf")
            while (now := time.monotonic() - self.started) < 60 * minutes:
                pids = [suite.pid(name) for name in NODES]
                self.memory.append((now, *map(memory_bytes, pids)))
                print(f"\r{now / 60:.1f} min, {len(self.latency)} answers", end="", flush=True)
                if now > DEAF_AFTER_S:
                    os.kill(deaf.pid, signal.SIGSTOP)
                if now > next_stall and (pid := suite.pid(next(stalled))) is not None:
                    next_stall += stall_s
                    os.kill(pid, signal.SIGSTOP)
                    time.sleep(STALL_S)
                    os.kill(pid, signal.SIGCONT)
                time.sleep(EVERY_S)
            self.shared_mb = sum(memory_bytes(pid, "Pss:") for pid in pids) / 1e6
            player.stop()
            playing.join(10.0)
            for listener in (slow, deaf):
                listener.kill()
                listener.wait(5.0)
            restarts = suite.restarts
        written.unlink()
        return restarts


def report(soak: Soak, restarts: dict[str, int], output: Path) -> None:
    """Draw, and print the table."""
    memory, latency = np.array(soak.memory), np.array(soak.latency)
    np.savez_compressed(output.with_suffix(".npz"), memory=memory, latency=latency)
    names = list(restarts)
    end = memory[-1, 0]
    parts = [latency[latency[:, 0] < end / 10, 1], latency[latency[:, 0] > end * 0.9, 1]]
    p95 = [1e3 * float(np.percentile(part, 95)) for part in parts]
    figure, (top, bottom) = plt.subplots(2, 1, figsize=(9, 6), sharex=True, layout="constrained")
    print()
    for k, name in enumerate(names, start=1):
        slope = slope_mb_per_hour(memory[:, 0], memory[:, k])
        top.plot(memory[:, 0] / 60, memory[:, k] / 1e6, label=f"{name}, {slope:+.1f} MB an hour")
        print(f"{name:12s} {memory[-1, k] / 1e6:6.0f} MB, {slope:+.2f} MB an hour")
    print(f"all, what they share counted once: {soak.shared_mb:.0f} MB; restarts: {restarts}")
    top.set(ylabel="resident memory, MB", ylim=(0, 1.1 * np.nanmax(memory[:, 1:]) / 1e6))
    top.legend(loc="lower right")
    bottom.plot(latency[:, 0] / 60, 1e3 * latency[:, 1], ".", ms=1, alpha=0.4, color="tab:gray")
    edges = np.linspace(0, end, 61)
    rows = [latency[(latency[:, 0] >= a) & (latency[:, 0] < b), 1] for a, b in itertools.pairwise(edges)]
    middle = (edges[1:] + edges[:-1]) / 120
    for q, style in ((50, "-"), (95, "--")):
        line = [1e3 * np.percentile(r, q) if len(r) else np.nan for r in rows]
        bottom.plot(middle, line, style, color="tab:red", label=f"{q} %")
    bottom.set(xlabel="minutes", ylabel="latency, ms", ylim=(0, 3 * max(p95)))
    bottom.legend(loc="upper right")
    figure.savefig(output.with_suffix(".png"), dpi=110)
    print(f"answers {len(latency)}, {len(latency) / max(soak.frames, 1):.1%} of the frames sent")
    print(
        f"people in a frame: {min(soak.people)} to {max(soak.people)}, {np.mean(soak.people):.2f} on average"
    )
    print(f"latency, 95 %: {p95[0]:.1f} ms in the first tenth, {p95[1]:.1f} ms in the last")


def main() -> None:
    """Run the nodes and print the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--hours", type=float, default=0.5)
    parser.add_argument("--listen", action="store_true", help="be the slow listener (the script starts it)")
    parser.add_argument("--stall", type=float, default=0.0, help="seconds between stopped nodes; 0: none")
    parser.add_argument("--bank", help="exemplar bank; the set-up's by default")
    parser.add_argument("--fps", type=float, default=15.0, help="frames a second of the simulated recording")
    parser.add_argument("--recording", type=Path, help="MCAP file to loop; simulated by default")
    parser.add_argument("-o", "--output", type=Path, default=Path("soak"))
    arguments = parser.parse_args()
    stay_local()
    if arguments.listen:
        listen_slowly()
    recording = arguments.recording or arguments.output.with_name("soak_input.mcap")
    if not recording.is_file():
        make_room(recording, arguments.fps)
    soak = Soak()
    restarts = soak.run(recording, arguments.bank, 60.0 * arguments.hours, arguments.stall)
    report(soak, restarts, arguments.output)


if __name__ == "__main__":
    main()
