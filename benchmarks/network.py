"""Depth images from one machine to another: how many arrive with the kernel's buffers and the profile's.

    sudo python benchmarks/network.py

Two network namespaces joined by a virtual cable act as the machines, each with its own /dev/shm, so that
images have to go over UDP. A row is a rate of 640 x 480 images, sent best effort for ten seconds; the losses
that the kernel counts (RcvbufErrors) stand beside it. The last row is for nodes with ``--local``, whose
messages must not leave the machine. It needs root, `ip` and `unshare`.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
"""The repository."""
PROFILE = ROOT / "src" / "depth_pose" / "ros" / "fastdds.xml"
LOCAL = PROFILE.with_name("fastdds_local.xml")
SECONDS, DOMAIN = 10.0, "61"
"""Duration of sending, and ROS domain. Set by hand."""


def play(role: str, rate: float) -> None:
    """Act as the sensor or as the listener; print the number of images sent or received."""
    import rclpy
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from sensor_msgs.msg import Image

    rclpy.init()
    node = rclpy.create_node(role)
    qos = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    count = 0

    def took(_: Image) -> None:
        nonlocal count
        count += 1

    if role == "listener":
        node.create_subscription(Image, "image", took, qos)
        end = time.monotonic() + SECONDS + 9.0
        while time.monotonic() < end:
            rclpy.spin_once(node, timeout_sec=0.05)
    else:
        publisher = node.create_publisher(Image, "image", qos)
        image = Image(height=480, width=640, step=1280, encoding="16UC1", data=bytes(614400))
        patience = time.monotonic() + 6.0
        while not publisher.get_subscription_count() and time.monotonic() < patience:
            rclpy.spin_once(node, timeout_sec=0.05)
        begin = time.monotonic()
        while (now := time.monotonic()) - begin < SECONDS:
            publisher.publish(image)
            count += 1
            time.sleep(max(0.0, begin + count / rate - now))
    errors = [line.split() for line in Path("/proc/net/snmp").read_text().splitlines() if line[:4] == "Udp:"]
    print(role, count, dict(zip(*errors, strict=True))["RcvbufErrors"], flush=True)
    os._exit(0)


def between(profile: Path, rate: float) -> tuple[int, int, int]:
    """Send from one namespace to the other; return images sent and received, and the kernel's losses."""
    names = ("depth_pose_a", "depth_pose_b")
    for name in names:
        subprocess.run(["ip", "netns", "add", name], check=True)
    try:
        cable = ["ip", "link", "add", "eth9", "netns", names[0], "type", "veth", "peer", "name", "eth9"]
        subprocess.run([*cable, "netns", names[1]], check=True)
        for number, name in enumerate(names, start=1):
            inside = ["ip", "-n", name]
            subprocess.run([*inside, "addr", "add", f"10.9.9.{number}/24", "dev", "eth9"], check=True)
            for device in ("lo", "eth9"):
                subprocess.run([*inside, "link", "set", device, "up"], check=True)
            subprocess.run([*inside, "route", "add", "default", "dev", "eth9"], check=True)
        variables = {"FASTRTPS_DEFAULT_PROFILES_FILE": str(profile), "ROS_DOMAIN_ID": DOMAIN}
        environment = os.environ | variables | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT"}
        running = []
        for name, role in zip(names, ("sensor", "listener"), strict=True):
            call = f"mount -t tmpfs shm /dev/shm && exec {sys.executable} {__file__} {role} {rate}"
            command = ["ip", "netns", "exec", name, "unshare", "-m", "bash", "-c", call]
            running.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment))
        said = [process.communicate(timeout=60)[0].split() for process in running]
    finally:
        for name in names:
            subprocess.run(["ip", "netns", "del", name], check=False)
    return int(said[0][1]), int(said[1][1]), int(said[1][2])


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        small = Path(folder) / "small.xml"
        text = PROFILE.read_text()
        small.write_text(text.replace(">4194304<", ">212992<"))
        for name, profile in (("kernel's 208 KiB", small), ("4 MiB", PROFILE), ("--local", LOCAL)):
            for rate in (30.0, 15.0) if profile is not LOCAL else (15.0,):
                sent, came, errors = between(profile, rate)
                print(f"| {name} | {rate:.0f} Hz | {came} of {sent} | {errors} |", flush=True)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        play(sys.argv[1], float(sys.argv[2]))
    main()
