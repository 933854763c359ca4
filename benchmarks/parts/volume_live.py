"""The volume node live: simulated cameras on topics at a given rate, and the node's answers and latency.

    python benchmarks/volume.py dances accuracy --dance swing   # once: makes volume_models/swing.npz
    python benchmarks/volume.py live                     # 8 cameras, 60 a second, 20 s
    python benchmarks/volume.py live --kind depth --cameras 2 --fps 30 --model volume_models/swing_depth.npz

The images are rendered and serialised beforehand and published as bytes, so that the cameras cost little.
Stamps are those of the time at which each is due; latency is from there to the arrival of the skeleton in
another process. Prints a table in Markdown; the load of the machine is in it.
"""

# ruff: noqa: TID251  (a node of its own)

from __future__ import annotations

import os
import random

os.environ["ROS_DOMAIN_ID"] = str(random.SystemRandom().randrange(1, 101))
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

import argparse
import signal
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from command_line import make_parser

from depth_pose.io.messages import write_image
from depth_pose.motion.procedural.dance import perform
from depth_pose.rooms.rigfile import save_rig
from depth_pose.ros import PROFILE_PATH  # noqa: F401  (names the transport's profile)
from depth_pose.sim.clothing import Garment
from depth_pose.sim.roof_cameras import RigRenderer, depth_ring, roof_rig
from depth_pose.sim.wearers import Wearer, dressed_frames
from depth_pose.volume.learn.performances import TEST_SHAPES

SECONDS_OF_DANCE = 4.0
"""Frames of the clip that is played."""
TICKS = os.sysconf("SC_CLK_TCK")


def serialise(rig, kind: str, fps: float) -> list[list[bytearray]]:
    """Images of every time and camera as messages, forwards and backwards."""
    renderer, sets = RigRenderer(rig), []
    clip = perform("swing", 21, SECONDS_OF_DANCE, fps, start_beat=0.5)
    for meshes, _ in dressed_frames(Wearer(TEST_SHAPES[1], Garment(skirt=0.65, flare=0.27)), clip):
        images = renderer.images(meshes, kind)
        if kind == "depth":  # as drivers send it
            images = [np.round(1e3 * i).astype(np.uint16) for i in images]
        sets.append([bytearray(write_image(0, c.name, i)) for c, i in zip(rig, images, strict=True)])
    return sets + sets[-2:0:-1]


def seconds_of(pid: int) -> float:
    """Processor time that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


class Stage:
    """The cameras' publishers, and the subscriber to the skeletons."""

    def __init__(self, topics: list[str]) -> None:
        import rclpy
        from depth_pose_msgs.msg import Skeleton
        from diagnostic_msgs.msg import DiagnosticArray
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from sensor_msgs.msg import Image

        rclpy.init(args=[])
        self.node = rclpy.create_node("stage")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        sensor = QoSProfile(depth=2, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.cameras = [self.node.create_publisher(Image, t, sensor) for t in topics]
        self.latencies: list[float] = []
        self.told: dict[str, str] = {}
        self.counts, self.reports = False, 0
        self.node.create_subscription(Skeleton, "/depth_pose/skeleton", self.hear, 10, raw=True)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self.note, 10)

    def hear(self, data: bytes) -> None:
        if self.counts:
            seconds, nanoseconds = struct.unpack_from("<iI", data, 4)
            self.latencies.append(time.time() - seconds - 1e-9 * nanoseconds)

    def note(self, message) -> None:
        for status in message.status:
            if status.name == "/depth_pose/volume":
                self.told, self.reports = {v.key: v.value for v in status.values}, self.reports + 1

    def listen_for(self, reports: int) -> None:
        """Wait for this many further diagnostics of the node."""
        wanted = self.reports + reports
        while self.reports < wanted:
            self.executor.spin_once(timeout_sec=0.1)

    def play(self, sets: list[list[bytearray]], fps: float, seconds: float) -> None:
        began, began_ns, sent = time.monotonic(), time.time_ns(), 0
        while sent < round(seconds * fps):
            stamp = struct.pack("<iI", *divmod(began_ns + round(sent * 1e9 / fps), 10**9))
            for publisher, message in zip(self.cameras, sets[sent % len(sets)], strict=True):
                message[4:12] = stamp
                publisher.publish(bytes(message))
            sent += 1
            while (left := began + sent / fps - time.monotonic()) > 0:
                self.executor.spin_once(timeout_sec=left)
        patience = time.monotonic() + 0.3
        while time.monotonic() < patience:
            self.executor.spin_once(timeout_sec=0.05)


def measure(given: argparse.Namespace) -> None:
    rig = roof_rig(given.cameras) if given.kind == "silhouettes" else depth_ring(given.cameras)
    topics = [f"/{c.name}/image" for c in rig]
    sets = serialise(rig, given.kind, given.fps)
    with tempfile.TemporaryDirectory() as folder:
        save_rig(Path(folder) / "rig.yaml", rig, topics)
        settings = [f"model:={given.model}", f"rig:={folder}/rig.yaml", *given.set]
        command = [sys.executable, "-m", "depth_pose.ros.nodes.volume_node", "--ros-args"]
        command += [a for s in settings for a in ("-p", s)]
        node = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        try:
            run(given, node, Stage(topics), sets)
        finally:
            node.send_signal(signal.SIGINT)
            node.wait(10)


def run(given: argparse.Namespace, node: subprocess.Popen[str], stage: Stage, sets) -> None:
    for line in node.stdout:
        if "is ready" in line:
            break
    else:
        raise SystemExit("the node ended before it was ready")
    while any(c.get_subscription_count() < 1 for c in stage.cameras):
        stage.executor.spin_once(timeout_sec=0.1)
    stage.play(sets, given.fps, 3.0)  # the person's height is found in the first 60 frames
    stage.listen_for(2)
    stage.counts = True
    cpu, own = seconds_of(node.pid), time.process_time()
    before = dict(stage.told)
    began = time.monotonic()
    stage.play(sets, given.fps, given.seconds)
    took = time.monotonic() - began - 0.3
    cpu, own = seconds_of(node.pid) - cpu, time.process_time() - own
    stage.listen_for(2)
    found = 1e3 * np.array(stage.latencies)
    asked = round(given.seconds * given.fps)
    rows = {
        "sets published": f"{asked} of {given.cameras} images, {asked / took:.1f} a second",
        "answers": f"{len(found)}, {len(found) / took:.1f} a second",
        "latency": f"median {np.median(found):.1f} ms, 95 % below {np.percentile(found, 95):.1f} ms, "
        f"most {found.max():.1f} ms",
        "node": f"{1e3 * cpu / len(found):.1f} ms of processor time an answer, {cpu / took:.0%} of a core",
        "cameras": f"{own / took:.0%} of another",
        "load of the machine": f"{os.getloadavg()[0]:.1f} on {os.cpu_count()} cores",
    }
    for key in sorted(set(stage.told) - {"rate_hz", "answered", "confidence", "misfit", "stature_m"}):
        if not key.startswith("latency"):
            rows[key] = f"{stage.told[key]} (before: {before.get(key, 0)})"
    print("| | |\n|---|---|")
    for name, value in rows.items():
        print(f"| {name} | {value} |")


def main() -> None:
    parser = make_parser(__doc__)
    parser.add_argument("--model", type=Path, default=Path("volume_models/swing.npz"))
    parser.add_argument("--kind", choices=("silhouettes", "depth"), default="silhouettes")
    parser.add_argument("--cameras", type=int, default=8)
    parser.add_argument("--fps", type=float, default=60.0)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--set", action="append", default=[], metavar="NAME:=VALUE", help="node's parameter")
    given = parser.parse_args()
    if not given.model.exists():
        what = "depth" if given.kind == "depth" else "accuracy"
        raise SystemExit(f"there is no {given.model}: volume.py dances {what} --dance swing makes it")
    measure(given)
