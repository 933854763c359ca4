"""Measure start, memory and gaps in the skeletons when nodes die, hang or starve (docs/faults.md).

    python benchmarks/faults.py --times 20
    python benchmarks/faults.py --times 5 --only start one starved
    python benchmarks/faults.py --random 30

The suite runs in a separate process. This one publishes a simulated person at 15 frames a second, receives
the skeletons, and injects one fault after another into the nodes' processes. The gap is the longest time
between two skeletons from the fault on. With ``--random`` nodes die and hang in random order for minutes,
also while others are still starting.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import os
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from depth_pose.ros import stay_local
from depth_pose.ros.process import NODES

os.environ.setdefault("ROS_DOMAIN_ID", str(random.SystemRandom().randrange(1, 101)))

FPS, SECONDS = 15.0, 10.0
"""Frames a second, and seconds of the simulated recording."""

IMAGE, INFO = "/camera/depth/image_raw", "/camera/depth/camera_info"
STOPPED_S, HOGGED_S = 6.0, 20.0
"""Seconds for which processes are stopped, or get hardly any processor time."""

RANDOM_SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGSEGV, signal.SIGABRT, signal.SIGSTOP)
"""Signals of faults in random order, as often as they stand here."""

CALM_S, LIMIT_S = 3.0, 120.0
"""Seconds without a fault before the next one, and time limit of a recovery."""


def run_suite(bank: str | None) -> None:
    """Run the nodes and print, ten times a second, which are ready, with process ids, until stdin ends."""
    from depth_pose.ros.process.supervisor import Suite

    os.set_blocking(0, False)
    with Suite(bank=bank, sink=lambda line: print(line, file=sys.stderr, flush=True)) as suite:
        while sys.stdin.buffer.raw.read(1) != b"":  # type: ignore[attr-defined]
            ready = {name: suite.pid(name) for name in NODES if suite.is_ready(name)}
            print(json.dumps(ready), flush=True)
            time.sleep(0.1)


class Watched:
    """The suite in a separate process, with the state that `run_suite` prints."""

    def __init__(self, bank: str | None, log: Path) -> None:
        command = [sys.executable, __file__, "--suite", *(["--bank", bank] if bank else [])]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log.open("wb")
        )
        self.ready: dict[str, int] = {}
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.ready = json.loads(line)

    def end(self) -> None:
        """Shut it down in order."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait(30.0)


class Stream:
    """A simulated sensor, and the arrival times of skeletons."""

    def __init__(self, frames: Sequence[tuple[Any, Any]]) -> None:
        import rclpy
        from depth_pose_msgs.msg import Skeleton
        from parts.background_spin import spin_in_background
        from rclpy.qos import QoSProfile, qos_profile_sensor_data
        from sensor_msgs.msg import CameraInfo, Image

        rclpy.init(args=[])
        node = rclpy.create_node("bench")
        self._images = node.create_publisher(Image, IMAGE, qos_profile_sensor_data)
        self._infos = node.create_publisher(CameraInfo, INFO, qos_profile_sensor_data)
        node.create_subscription(Skeleton, "/depth_pose/skeleton", self._take, QoSProfile(depth=100))
        self._frames = itertools.cycle(frames)
        self.came_s: list[float] = []
        node.create_timer(1.0 / FPS, self._send)
        spin_in_background(node)

    def _take(self, skeleton: Any) -> None:
        if skeleton.source != skeleton.LOST:
            self.came_s.append(time.monotonic())

    def _send(self) -> None:
        image, info = next(self._frames)
        image.header.stamp.sec, image.header.stamp.nanosec = divmod(time.time_ns(), 1_000_000_000)
        info.header.stamp = image.header.stamp
        self._infos.publish(info)
        self._images.publish(image)

    def gap_s(self, since_s: float) -> float:
        """Return the longest time without a skeleton after a given moment."""
        times = [since_s, *(t for t in list(self.came_s) if t > since_s), time.monotonic()]
        return max(b - a for a, b in itertools.pairwise(times))

    def answers_since(self, since_s: float) -> int:
        """Return the number of skeletons since a time."""
        return sum(came_s >= since_s for came_s in list(self.came_s))

    def await_calm(self, suite: Watched) -> None:
        """Wait until every node is ready and skeletons arrive without a pause."""
        limit_s, calm_s = time.monotonic() + LIMIT_S, time.monotonic()
        while time.monotonic() - calm_s < CALM_S:
            if len(suite.ready) < len(NODES) or self.gap_s(time.monotonic() - CALM_S) > 1.0:
                calm_s = time.monotonic()
            if time.monotonic() > limit_s:
                raise TimeoutError(f"skeletons did not come again; ready were {suite.ready}")
            time.sleep(0.05)


def messages_of(path: Path) -> list[tuple[Any, Any]]:
    """Simulate a person in front of a time-of-flight sensor, as messages; forwards and backwards."""
    from dataclasses import replace

    import numpy as np
    from sensor_msgs.msg import CameraInfo, Image

    from depth_pose.io.mcap_read import read_frames
    from depth_pose.sim.config import Person
    from depth_pose.sim.motion import load_motion
    from depth_pose.sim.simulate import Stage, simulate

    stage = Stage()
    simulate(
        path,
        Person().body(),
        load_motion("play", FPS, SECONDS),
        replace(stage, sensor=replace(stage.sensor, fps=FPS)),
    )
    made = []
    for frame in read_frames(path):
        c = frame.camera
        image = Image(height=c.height, width=c.width, encoding="16UC1", step=2 * c.width)
        image.data = np.round(1e3 * frame.depth).astype("<u2").tobytes()
        info = CameraInfo(height=c.height, width=c.width, distortion_model="plumb_bob", d=[0.0] * 5)
        info.k = [c.fx, 0.0, c.cx, 0.0, c.fy, c.cy, 0.0, 0.0, 1.0]
        image.header.frame_id = info.header.frame_id = frame.frame_id
        made.append((image, info))
    return made + made[-2:0:-1]


def descendants(pid: int) -> list[int]:
    """Descendants of a process."""
    found = []
    for children in Path(f"/proc/{pid}/task").glob("*/children"):
        with contextlib.suppress(OSError):  # it has ended
            for child in map(int, children.read_text().split()):
                found += [child, *descendants(child)]
    return found


def pss_mb(pid: int) -> float:
    """Proportional set size of a process: shared pages count in parts."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    return next(int(line.split()[1]) / 1000 for line in lines if line.startswith("Pss:"))


def measure_start(bank: str | None) -> tuple[float, float]:
    """Start ``depth-pose up``; return seconds until all nodes are ready, and MB of its processes at rest."""
    command = [sys.executable, "-m", "depth_pose.cli", "up", "--local", *(["--bank", bank] if bank else [])]
    began_s = time.monotonic()
    up = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        assert up.stdout is not None
        said = next((line for line in up.stdout if "all nodes are ready" in line), "")
        took_s = time.monotonic() - began_s
        if not said:
            raise RuntimeError("up has ended before all nodes were ready")
        time.sleep(5.0)  # until everything is loaded, including spare processes
        return took_s, sum(map(pss_mb, [up.pid, *descendants(up.pid)]))
    finally:
        up.send_signal(signal.SIGINT)
        up.communicate(timeout=30.0)


def kill(count: int, turn: int, suite: Watched) -> None:
    """Kill ``count`` nodes at once, different ones each turn."""
    for name in list(itertools.islice(itertools.cycle(NODES), turn, turn + count)):
        os.kill(suite.ready[name], signal.SIGKILL)


def hang(turn: int, suite: Watched) -> None:
    """Stop a node, a different one each turn."""
    os.kill(suite.ready[NODES[turn % len(NODES)]], signal.SIGSTOP)


def stop(count: int, turn: int, suite: Watched) -> None:
    """Stop ``count`` nodes and their supervisor for longer than the watchdog's time limit."""
    names = itertools.islice(itertools.cycle(NODES), turn, turn + count)
    stopped = [suite.process.pid, *(suite.ready[name] for name in names)]
    for pid in stopped:
        os.kill(pid, signal.SIGSTOP)
    time.sleep(STOPPED_S)
    for pid in stopped:
        os.kill(pid, signal.SIGCONT)


def starve(suite: Watched) -> None:
    """Run a busy program with priority over all nodes on one core: they get about 1/300 of it."""
    cores = os.sched_getaffinity(0)
    hog = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    os.sched_setaffinity(hog.pid, {max(cores)})
    set_share(suite, {max(cores)}, os.SCHED_IDLE, 19)
    time.sleep(HOGGED_S)
    set_share(suite, cores, os.SCHED_OTHER, 0)
    hog.kill()
    hog.wait()


def set_share(suite: Watched, cores: set[int], policy: int, group_nice: int) -> None:
    """Set the cores and the processor share of all processes of the suite."""
    for pid in [suite.process.pid, *descendants(suite.process.pid)]:
        with contextlib.suppress(OSError):  # it has ended, or there are no groups by session
            for task in Path(f"/proc/{pid}/task").iterdir():
                os.sched_setaffinity(int(task.name), cores)
                os.sched_setscheduler(int(task.name), policy, os.sched_param(0))
            Path(f"/proc/{pid}/autogroup").write_text(str(group_nice))


FAULTS: dict[str, tuple[str, Callable[[int, Watched], None]]] = {
    "one": ("one node killed (-9)", lambda turn, suite: kill(1, turn, suite)),
    "two": ("two nodes killed at once", lambda turn, suite: kill(2, turn, suite)),
    "three": ("three nodes killed at once", lambda turn, suite: kill(3, turn, suite)),
    "all": ("all nodes killed at once", lambda turn, suite: kill(len(NODES), turn, suite)),
    "hang": ("one node hangs (SIGSTOP)", hang),
    "half": (f"two nodes and `up` stopped for {STOPPED_S:.0f} s", lambda turn, suite: stop(2, turn, suite)),
    "stopped": (
        f"all nodes and `up` stopped for {STOPPED_S:.0f} s",
        lambda turn, suite: stop(len(NODES), turn, suite),
    ),
    "starved": (f"all starved for {HOGGED_S:.0f} s", lambda turn, suite: starve(suite)),
}
"""Faults by name: function, label and duration, from the end of which the gap counts."""


def measure_fault(name: str, turn: int, suite: Watched, stream: Stream) -> tuple[float, float]:
    """Inject a fault once; return the longest gap in the skeletons, and the time until all were ready."""
    stream.await_calm(suite)
    before, began_s = dict(suite.ready), time.monotonic()
    FAULTS[name][1](turn, suite)
    if name in ("half", "stopped", "starved"):
        began_s = time.monotonic()
    ready_s = began_s
    while len(suite.ready) == len(NODES) and suite.ready == before and time.monotonic() < began_s + 10.0:
        time.sleep(0.01)  # until it is detected
    while len(suite.ready) < len(NODES) and time.monotonic() < began_s + LIMIT_S:
        time.sleep(0.01)
    if suite.ready != before:
        ready_s = time.monotonic()
    stream.await_calm(suite)
    return stream.gap_s(began_s), ready_s - began_s


def measure_random(minutes: float, suite: Watched, stream: Stream) -> str:
    """Kill, crash and stop random nodes at random times; return the row of the table.

    Raises TimeoutError where skeletons do not come again, at the end or within `LIMIT_S` of all faults.
    """
    rng, counts = random.Random(1), Counter[str]()
    stream.await_calm(suite)
    began_s, memory_mb = time.monotonic(), suite_mb(suite)
    while time.monotonic() < began_s + 60.0 * minutes:
        time.sleep(rng.choice([0.05, 0.5, 2.0, 6.0]) * rng.random())
        number = rng.choice(RANDOM_SIGNALS)
        for name in rng.sample(list(NODES), rng.choice([1, 1, 1, 2, 3, len(NODES)])):
            pid = suite.ready.get(name)
            if pid is not None:
                with contextlib.suppress(ProcessLookupError):  # it has died a moment ago
                    os.kill(pid, number)
                    counts[number.name] += 1
        if rng.random() < 0.1:
            stream.await_calm(suite)
    stream.await_calm(suite)
    signals = ", ".join(f"{count} {name}" for name, count in sorted(counts.items()))
    return (
        f"| {signals} in {minutes:g} min | {stream.gap_s(began_s):.1f} s | "
        f"{stream.answers_since(began_s)} of {round((time.monotonic() - began_s) * FPS)} | "
        f"{memory_mb:.0f}, {suite_mb(suite):.0f} MB |"
    )


def suite_mb(suite: Watched) -> float:
    """Proportional set size of all processes of the suite, MB."""
    return sum(map(pss_mb, [suite.process.pid, *descendants(suite.process.pid)]))


def main() -> None:
    """Run the suite and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--times", type=int, default=5, help="repetitions of each")
    parser.add_argument("--only", nargs="+", choices=["start", *FAULTS], default=["start", *FAULTS])
    parser.add_argument("--bank", help="exemplar bank; the set-up's by default")
    parser.add_argument("--log", type=Path, default=Path(os.devnull), help="file for the nodes' output")
    parser.add_argument("--suite", action="store_true", help="run the nodes (the script starts it)")
    parser.add_argument("--random", type=float, metavar="MINUTES", help="faults in random order")
    arguments = parser.parse_args()
    stay_local()
    if arguments.suite:
        return run_suite(arguments.bank)
    if "start" in arguments.only and arguments.random is None:
        starts, sizes = zip(*(measure_start(arguments.bank) for _ in range(arguments.times)), strict=True)
        print(f"start of `up`: {summary(starts)}; processes at rest: {max(sizes):.0f} MB (PSS)", flush=True)
    faults = [name for name in FAULTS if name in arguments.only]
    if not faults:
        return None
    with tempfile.TemporaryDirectory() as folder:
        frames = messages_of(Path(folder) / "person.mcap")
    suite, stream = Watched(arguments.bank, arguments.log), Stream(frames)
    if arguments.random is not None:
        print("| faults | longest gap | answers | memory before, after |")
        print("|---|---|---|---|")
        print(measure_random(arguments.random, suite, stream), flush=True)
        suite.end()
        return None
    print("| fault | longest gap: median, worst | all ready again: median, worst | times |")
    print("|---|---|---|---|")
    for name in faults:
        found = []
        for turn in range(arguments.times):
            found.append(measure_fault(name, turn, suite, stream))
            print(f"{name} {found[-1][0]:.2f} {found[-1][1]:.2f}", file=sys.stderr, flush=True)
        gaps, ready = zip(*found, strict=True)
        print(f"| {FAULTS[name][0]} | {summary(gaps)} | {summary(ready)} | {len(found)} |", flush=True)
    print(f"load average {os.getloadavg()[0]:.1f}")
    suite.end()
    return None


def summary(seconds: Sequence[float]) -> str:
    """Format median and worst."""
    return f"{statistics.median(seconds):.2f}, {max(seconds):.2f} s"


if __name__ == "__main__":
    main()
