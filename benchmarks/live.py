"""Play a recording to the live nodes at sensor rates: answers, latency, processor time, memory.

    python benchmarks/live.py -o live
    python benchmarks/live.py --recording bags/person.mcap --fps 30 --seconds 60

The frames of a recording are published with the present time as their stamp, forwards and backwards
over and over, by this process, which also receives the skeletons. It prints for each rate the share of
frames answered, the latency from the stamp to the skeleton's arrival, and each node's processor time per
frame beside that of its stage alone (measured first, in this process); and at the end the memory of each
process (proportional set size: shared pages count in parts) and the start time. ``live.png`` shows the
distribution of the latencies.
"""

from __future__ import annotations

import argparse
import os
import random
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("ROS_DOMAIN_ID", str(random.SystemRandom().randrange(1, 101)))
os.environ.setdefault("OMP_NUM_THREADS", "1")

if TYPE_CHECKING:
    from depth_pose.core.frame import DepthFrame
    from depth_pose.ros.process.supervisor import Suite

IMAGE, INFO = "/camera/depth/image_raw", "/camera/depth/camera_info"
_TICKS = os.sysconf("SC_CLK_TCK")


def cpu_s(pid: int) -> float:
    """Processor time that a process has taken, all its threads."""
    words = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(words[11]) + int(words[12])) / _TICKS


def pss_mb(pid: int) -> float:
    """Proportional set size of a process."""
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
        if line.startswith("Pss:"):
            return int(line.split()[1]) / 1000
    raise ValueError("this kernel does not report the proportional set size")


def stages_ms(frames: Sequence[DepthFrame], bank: str | None) -> dict[str, float]:
    """Processor time of each stage alone, median over the frames, milliseconds."""
    from depth_pose.bank import Bank, default_bank_path
    from depth_pose.pipeline import PosePipeline

    pipeline = PosePipeline(Bank.load(bank or default_bank_path()))
    pipeline.warm_up()
    spent: dict[str, list[float]] = {"denoise": [], "matcher": [], "refine": [], "recovery": []}

    def timed(name: str, call: Any, *arguments: Any) -> Any:
        before = time.thread_time()
        result = call(*arguments)
        spent[name].append(1e3 * (time.thread_time() - before))
        return result

    for frame in frames:
        people = timed("denoise", pipeline.perception.perceive, frame)
        matches = timed("matcher", pipeline.matcher.match, people)
        refined = timed("refine", pipeline.refiner.refine, people, matches)
        timed("recovery", pipeline.recoverer.recover, people, refined)
    return {name: statistics.fmean(times) for name, times in spent.items()}


@dataclass
class Run:
    """Measurements at one rate."""

    fps: float
    sent: dict[int, float] = field(default_factory=dict)
    latency_s: list[float] = field(default_factory=list)
    node_ms: dict[str, float] = field(default_factory=dict)

    @property
    def answered(self) -> float:
        """Share of the frames that were answered."""
        return len(self.latency_s) / len(self.sent)


class Bench:
    """Publisher of frames and subscriber to skeletons."""

    def __init__(self, frames: Sequence[DepthFrame]) -> None:
        import rclpy
        from depth_pose_msgs.msg import Skeleton
        from parts.background_spin import spin_in_background
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from sensor_msgs.msg import CameraInfo, Image

        rclpy.init(args=[])
        self._node = rclpy.create_node("bench")
        sensor = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._images = self._node.create_publisher(Image, IMAGE, sensor)
        self._infos = self._node.create_publisher(CameraInfo, INFO, sensor)
        self._node.create_subscription(Skeleton, "/depth_pose/skeleton", self._take, QoSProfile(depth=100))
        messages = [messages_of(frame) for frame in frames]
        self._messages = messages + messages[-2:0:-1]
        self._run: Run | None = None
        self._last_s = 0.0
        spin_in_background(self._node)

    def wait(self, timeout_s: float = 30.0) -> None:
        """Wait until the nodes listen."""
        deadline = time.monotonic() + timeout_s
        while not (self._images.get_subscription_count() and self._infos.get_subscription_count()):
            if time.monotonic() > deadline:
                raise TimeoutError("the denoise node does not listen")
            time.sleep(0.05)
        time.sleep(0.5)

    def _take(self, skeleton: Any) -> None:
        now = time.time()
        stamp = skeleton.header.stamp
        sent = self._run.sent.get(stamp.sec * 1_000_000_000 + stamp.nanosec) if self._run else None
        if self._run is not None and sent is not None:
            self._run.latency_s.append(now - sent)
            self._last_s = time.monotonic()

    def play(self, fps: float, seconds: float, suite: Suite) -> Run:
        """Send frames at a rate."""
        from depth_pose.ros.messages.basics import ns_to_stamp
        from depth_pose.ros.process.supervisor import NODES

        self._send(fps, 2.0, ns_to_stamp)  # until tracking runs
        self._run = run = Run(fps)
        before = {name: cpu_s(suite.pid(name) or 0) for name in NODES}
        self._send(fps, seconds, ns_to_stamp)
        self._last_s = time.monotonic()
        while time.monotonic() - self._last_s < 1.0:  # frames in progress still arrive
            time.sleep(0.05)
        answered = max(len(run.latency_s), 1)
        run.node_ms = {n: 1e3 * (cpu_s(suite.pid(n) or 0) - before[n]) / answered for n in NODES}
        self._run = None
        return run

    def _send(self, fps: float, seconds: float, to_stamp: Any) -> None:
        started = time.monotonic()
        for k in range(round(fps * seconds)):
            time.sleep(max(0.0, started + k / fps - time.monotonic()))
            image, info = self._messages[k % len(self._messages)]
            now = time.time_ns()
            image.header.stamp = info.header.stamp = to_stamp(now)
            if self._run is not None:
                self._run.sent[now] = now / 1e9
            self._infos.publish(info)
            self._images.publish(image)


def messages_of(frame: DepthFrame) -> tuple[Any, Any]:
    from sensor_msgs.msg import CameraInfo, Image

    camera = frame.camera
    depth_mm = np.round(1e3 * frame.depth).astype("<u2")
    image = Image(height=camera.height, width=camera.width, encoding="16UC1", step=2 * camera.width)
    image.data = depth_mm.tobytes()
    info = CameraInfo(height=camera.height, width=camera.width, distortion_model="plumb_bob", d=[0.0] * 5)
    info.k = [camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0]
    image.header.frame_id = info.header.frame_id = frame.frame_id
    return image, info


def report(runs: Sequence[Run], alone: dict[str, float], output: Path) -> None:
    """Print the tables and draw."""
    print("\n| frames a second | answered | latency p50 | p95 | p99 |\n|---|---|---|---|---|")
    for run in runs:
        p50, p95, p99 = (1e3 * float(np.percentile(run.latency_s, q)) for q in (50, 95, 99))
        print(f"| {run.fps:g} | {run.answered:.2%} | {p50:.0f} ms | {p95:.0f} ms | {p99:.0f} ms |")
    print("\n| ms of processor per frame | " + " | ".join(alone) + " | all |")
    print("|---|" + "---|" * (len(alone) + 1))
    rows = {"stage alone": alone} | {f"node at {run.fps:g} a second": run.node_ms for run in runs}
    for name, row in rows.items():
        print(f"| {name} | " + " | ".join(f"{row[n]:.1f}" for n in alone) + f" | {sum(row.values()):.1f} |")
    figure, axes = plt.subplots(figsize=(7, 3.5), layout="constrained")
    for run in runs:
        latency_ms = np.sort(run.latency_s) * 1e3
        share = np.arange(1, len(latency_ms) + 1) / len(run.sent)
        axes.plot(latency_ms, share, label=f"{run.fps:g} frames a second")
    axes.axvline(100.0, color="tab:gray", ls=":", label="100 ms")
    axes.set(xlabel="latency from stamp to skeleton, ms", ylabel="share of the frames sent", xlim=(0, None))
    axes.legend(loc="lower right")
    axes.grid(alpha=0.3)
    figure.savefig(output.with_suffix(".png"), dpi=110)


def main() -> None:
    """Run all rates, print the tables and draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--fps", type=float, nargs="+", default=[25.0, 30.0], help="rates, one after another")
    parser.add_argument("--seconds", type=float, default=40.0, help="at each rate")
    parser.add_argument("--frames", type=int, default=300, help="of the recording, at most")
    parser.add_argument("--bank", help="exemplar bank; the set-up's by default")
    parser.add_argument("--recording", type=Path, help="MCAP file with depth images; simulated by default")
    parser.add_argument("-o", "--output", type=Path, default=Path("live"))
    arguments = parser.parse_args()

    from soak import make_recording

    from depth_pose.io.mcap_read import read_frames
    from depth_pose.ros.process import NODES
    from depth_pose.ros.process.supervisor import Suite

    recording = arguments.recording or arguments.output.with_name("live_input.mcap")
    if not recording.is_file():
        make_recording(recording)
    frames = [frame for frame, _ in zip(read_frames(recording), range(arguments.frames), strict=False)]
    alone = stages_ms(frames, arguments.bank)
    started = time.monotonic()
    with Suite(bank=arguments.bank, sink=lambda line: None) as suite:
        start_s = time.monotonic() - started
        bench = Bench(frames)
        bench.wait()
        runs = []
        for fps in arguments.fps:
            print(f"{fps:g} frames a second for {arguments.seconds:g} s ...", flush=True)
            runs.append(bench.play(fps, arguments.seconds, suite))
        pids = {name: suite.pid(name) for name in NODES}
        memory = {name: pss_mb(pid) for name, pid in pids.items() if pid is not None}
    print(f"\n{len(frames)} frames of {frames[0].camera.width} x {frames[0].camera.height}, {recording.name}")
    print(f"start, from nothing to all nodes ready: {start_s:.1f} s; load average {os.getloadavg()[0]:.1f}")
    report(runs, alone, arguments.output)
    print("\n| memory (PSS) | " + " | ".join(memory) + " | all |\n|---|" + "---|" * (len(memory) + 1))
    print("| MB | " + " | ".join(f"{m:.0f}" for m in memory.values()) + f" | {sum(memory.values()):.0f} |")


if __name__ == "__main__":
    main()
