"""Several cameras in one room: their skeletons merged, from recordings and live.

    python benchmarks/rooms_live.py merged rooms/pair1 rooms/pair2
    python benchmarks/rooms_live.py live rooms/pair1

The recordings are those of ``depth-pose simulate --room --cameras 2 -o rooms/pair1.mcap``. ``live`` starts
a suite for each camera and the fusion node, and plays the frames at their own times with present stamps. It
prints the latency from the stamp of the depth image to the room's skeletons, the share of frames that each
suite answers, the errors, each person's ids, and the effect of the loss and the return of the last camera.
"""

from __future__ import annotations

import argparse
import os
import random
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("ROS_DOMAIN_ID", str(random.SystemRandom().randrange(1, 101)))
os.environ.setdefault("OMP_NUM_THREADS", "1")

LEAD_S = 3.0
"""Seconds of play before anything is measured."""


@dataclass
class Heard:
    """What arrived: stamp, time of arrival, and skeletons."""

    messages: list[tuple[int, float, tuple[Any, ...]]] = field(default_factory=list)

    def take(self, message: Any) -> None:
        """Keep a SkeletonArray."""
        from depth_pose.ros.messages.basics import stamp_to_ns

        self.messages.append((stamp_to_ns(message.header.stamp), time.time(), tuple(message.skeletons)))

    def between(self, begin_s: float, end_s: float) -> list[tuple[int, float, tuple[Any, ...]]]:
        """Return what has stamps in a span of present time."""
        return [m for m in self.messages if begin_s <= m[0] * 1e-9 < end_s]


class Room:
    """Publishers of the cameras' frames and subscribers to all skeletons."""

    def __init__(self, name: Path, seconds: float) -> None:
        import rclpy
        from depth_pose_msgs.msg import SkeletonArray
        from live import messages_of
        from parts.background_spin import spin_in_background
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from sensor_msgs.msg import CameraInfo, Image

        from depth_pose.io.mcap_read import read_frames
        from depth_pose.rooms.rigfile import load_rig

        rclpy.init(args=[])
        self._node = rclpy.create_node("room_bench")
        self.names = [camera.name for camera in load_rig(name.with_suffix(".yaml")).cameras]
        sensor = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.frames: list[list[tuple[int, Any, Any]]] = []
        self._outputs, self.suites = [], [Heard() for _ in self.names]
        for c, camera in enumerate(self.names):
            path = name.with_name(f"{name.name}_{c}.mcap")
            first_ns, frames = None, []
            for frame in read_frames(path):
                first_ns = frame.stamp_ns if first_ns is None else first_ns
                if frame.stamp_ns - first_ns > seconds * 1e9:
                    break
                frames.append((frame.stamp_ns, *messages_of(frame)))
            self.frames.append(frames)
            topics = [(Image, f"/{camera}/depth/image_raw"), (CameraInfo, f"/{camera}/depth/camera_info")]
            self._outputs.append([self._node.create_publisher(kind, t, sensor) for kind, t in topics])
            self._node.create_subscription(
                SkeletonArray, f"/{camera}/depth_pose/skeletons", self.suites[c].take, QoSProfile(depth=100)
            )
        self.room = Heard()
        self._node.create_subscription(
            SkeletonArray, "/depth_pose/room/skeletons", self.room.take, QoSProfile(depth=100)
        )
        spin_in_background(self._node)

    def wait(self) -> None:
        """Wait until every suite listens."""
        deadline = time.monotonic() + 30.0
        while not all(p.get_subscription_count() for pair in self._outputs for p in pair):
            if time.monotonic() > deadline:
                raise TimeoutError("not all suites listen")
            time.sleep(0.05)
        time.sleep(0.5)

    def play(self, silent: Sequence[tuple[float, float]]) -> int:
        """Publish all frames at their times; return present time minus the recording's, nanoseconds.

        The last camera is silent in the given spans of the recording, seconds.
        """
        from depth_pose.ros.messages.basics import ns_to_stamp

        events = sorted((f[0], c, k) for c, frames in enumerate(self.frames) for k, f in enumerate(frames))
        begin_ns = time.time_ns() + 200_000_000 - events[0][0]
        for stamp_ns, c, k in events:
            since_s = (stamp_ns - events[0][0]) * 1e-9
            if c == len(self.names) - 1 and any(a <= since_s < b for a, b in silent):
                continue
            time.sleep(max(0.0, (begin_ns + stamp_ns - time.time_ns()) * 1e-9))
            _, image, info = self.frames[c][k]
            image.header.stamp = info.header.stamp = ns_to_stamp(begin_ns + stamp_ns)
            images, infos = self._outputs[c]
            infos.publish(info)
            images.publish(image)
        time.sleep(1.0)
        return begin_ns


def live(name: Path, seconds: float, loss: tuple[float, float]) -> None:
    """Run the suites and the fusion node, and print what was measured."""
    from parts.rooms_merged import Truth, ids_of_people, joint_errors

    from depth_pose.ros.messages.skeletons import msg_to_skeleton
    from depth_pose.ros.process.supervisor import Suite

    room = Room(name, seconds)
    lines: list[tuple[float, str]] = []

    def suite_of(camera: str) -> Suite:
        topics = {"image_topic": f"/{camera}/depth/image_raw", "info_topic": f"/{camera}/depth/camera_info"}
        return Suite(parameters=topics, remap=(f"__ns:=/{camera}/depth_pose",), sink=lambda line: None)

    suites = [suite_of(camera) for camera in room.names]
    rig = {"rig": str(name.with_suffix(".yaml").absolute())}
    suites.append(
        Suite(parameters=rig, nodes=("fusion",), sink=lambda line: lines.append((time.time(), line)))
    )
    try:
        for suite in suites:
            suite.start()
        for suite in suites:
            suite.wait_ready()
        room.wait()
        begin_ns = room.play([loss])
    finally:
        for suite in suites:
            suite.stop()
    first_s = (begin_ns + min(f[0][0] for f in room.frames)) * 1e-9
    lost_s, back_s = first_s + loss[0], first_s + loss[1]
    print(f"\n{name.name}, load average {os.getloadavg()[0]:.1f}")
    print("| | answered | frames a second | latency p50 | p95 |\n|---|---|---|---|---|")
    for camera, frames, heard in zip(room.names, room.frames, room.suites, strict=True):
        sent = [f for f in frames if f[0] * 1e-9 + begin_ns * 1e-9 < lost_s]
        _row(f"suite of {camera}", heard.between(first_s + LEAD_S, lost_s), lost_s - first_s - LEAD_S, sent)
    together = room.room.between(first_s + LEAD_S, lost_s)
    _row("room", together, lost_s - first_s - LEAD_S)
    truth = Truth.load(name.with_suffix(".npz"))
    print("\n| | mean error | seen by camera 0 | hidden from it | people a message |\n|---|---|---|---|---|")
    for label, begin, end in (
        ("both cameras", first_s + LEAD_S, lost_s),
        ("the last one lost", lost_s + 0.2, back_s),
        ("and returned", back_s + 1.5, np.inf),
    ):
        heard = room.room.between(begin, end)
        if not heard:  # the recording ends before
            continue
        answers = {m[0] - begin_ns: [msg_to_skeleton(s) for s in m[2]] for m in heard}
        errors, seen = joint_errors(truth, answers)
        counts = Counter(len(m[2]) for m in heard)
        kinds = (errors, errors[seen[:, 0]], errors[~seen[:, 0]])
        cells = [f"{1e3 * e.mean():.0f} mm" if e.size else "none" for e in kinds]
        print(f"| {label} | {' | '.join(cells)} | {dict(counts)} |")
    answers = {m[0] - begin_ns: [msg_to_skeleton(s) for s in m[2]] for m in room.room.messages}
    own, others = ids_of_people(truth, answers)
    print(f"\n{len(answers)} messages of the room")
    for p, ids in enumerate(own):
        print(f"person {p + 1} has {_counted(ids)}")
    print(f"nobody there: {_counted(others)}")
    for at, line in lines:
        if "WARN" in line and at > first_s:
            words = line.rsplit("]: ", 1)[-1]
            print(f"{at - lost_s:+.2f} s from the loss, {at - back_s:+.2f} s from the return: {words}")


def _counted(ids: Sequence[str]) -> str:
    counts = Counter(ids).most_common()
    return ", ".join(f"{name} in {count} messages" for name, count in counts) or "no id"


def _row(
    label: str, heard: Sequence[tuple[int, float, Any]], seconds: float, sent: Sequence[Any] = ()
) -> None:
    latency = [1e3 * (at - stamp * 1e-9) for stamp, at, _ in heard] or [np.nan]
    share = f"{len(heard) / (len(sent) * seconds / (seconds + LEAD_S)):.0%}" if sent else ""
    p50, p95 = np.percentile(latency, [50, 95])
    print(f"| {label} | {share} | {len(heard) / seconds:.1f} | {p50:.0f} ms | {p95:.0f} ms |")


def main() -> None:
    """Run one of the commands."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    merged = commands.add_parser("merged", help="recordings: merged skeletons beside single cameras'")
    merged.add_argument("names", type=Path, nargs="+", help="recordings, without _0.mcap")
    merged.add_argument("--skeletons", type=Path, default=Path("rooms_skeletons"), help="where they are kept")
    lives = commands.add_parser("live", help="suites and the fusion node on this machine")
    lives.add_argument("name", type=Path)
    lives.add_argument("--seconds", type=float, default=40.0)
    lives.add_argument(
        "--loss", type=float, nargs=2, default=[20.0, 28.0], help="silence of the last camera, s"
    )
    arguments = parser.parse_args()
    if arguments.command == "merged":
        from parts.rooms_merged import report

        report(arguments.names, arguments.skeletons)
    else:
        live(arguments.name, arguments.seconds, tuple(arguments.loss))


if __name__ == "__main__":
    main()
