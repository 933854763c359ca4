"""Cameras calibrated from their live topics, as users do: ``depth-pose calibrate --live``."""

import subprocess
import sys
import time

import numpy as np
import pytest
from peer import LIMIT_S, join_own_domain
from sensor_msgs.msg import CameraInfo, Image

from command import environment
from depth_pose.io.recording import Recording
from depth_pose.rooms.rigfile import load_rig

SECONDS = 6.0


@pytest.fixture
def domain(monkeypatch):
    return join_own_domain(monkeypatch)


def call(*arguments, **more):
    return subprocess.run(
        [sys.executable, "-m", "depth_pose.cli", *map(str, arguments)],
        env=environment(**more),
        capture_output=True,
        text=True,
    )


def messages_of(room):
    """The messages of both cameras by their time, with the topic each goes to."""
    found = []
    for k, side in enumerate(("left", "right")):
        recording = Recording(room.with_name(f"{room.stem}_{k}.mcap"))
        for message in recording.messages(*recording.topics):
            name = message.topic.rpartition("/")[2]
            found.append((message.log_time_ns, f"/{side}/depth/{name}", message.data))
    return sorted(found)


def test_two_live_cameras_are_placed(domain, tmp_path, bank_path):
    import rclpy

    room, rig = tmp_path / "room.mcap", tmp_path / "rig.yaml"
    how = f"--room --people 2 --cameras 2 --seconds {SECONDS} --width 240 --seed 4".split()
    assert call("simulate", *how, "-o", room).returncode == 0
    messages = messages_of(room)
    topics = ["/left/depth/image_raw", "/right/depth/image_raw"]
    command = [sys.executable, "-m", "depth_pose.cli", "calibrate", "--live", *topics]
    context = rclpy.context.Context()
    rclpy.init(context=context, args=[])
    node = rclpy.create_node("drivers", context=context)
    kinds = {topic: CameraInfo if "info" in topic else Image for _, topic, _ in messages}
    publishers = {topic: node.create_publisher(kind, topic, 10) for topic, kind in kinds.items()}
    try:
        running = subprocess.Popen(
            [*command, "-o", str(rig), "--bank", str(bank_path), "--seconds", f"{SECONDS + 2.0:g}"],
            env=environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        limit_s = time.monotonic() + LIMIT_S
        while min(p.get_subscription_count() for p in publishers.values()) == 0:
            assert time.monotonic() < limit_s, "it does not subscribe"
            time.sleep(0.05)
        first_ns, began_s = messages[0][0], time.monotonic()
        for at_ns, topic, data in messages:
            time.sleep(max(0.0, began_s + (at_ns - first_ns) * 1e-9 - time.monotonic()))
            publishers[topic].publish(data)
        said, _ = running.communicate(timeout=3.0 * LIMIT_S)
        assert running.returncode == 0, said
    finally:
        rclpy.shutdown(context=context)
    found, truth = load_rig(rig), load_rig(room.with_suffix(".yaml"))
    assert [camera.name for camera in found.cameras] == ["left", "right"]
    assert found.topics == tuple(topics)
    off = [np.linalg.inv(r.cameras[0].T_room_camera) @ r.cameras[1].T_room_camera for r in (found, truth)]
    assert np.linalg.norm((off[0] - off[1])[:3, 3]) < 0.15
    assert rig.with_suffix(".png").exists()


def test_silent_topics_are_named(domain, tmp_path, bank_path):
    done = call(
        *("calibrate", "--live", "/left/depth/image_raw", "/right/depth/image_raw", "--seconds", "5"),
        *("-o", tmp_path / "rig.yaml", "--bank", bank_path),
    )
    assert done.returncode == 1
    assert "nothing came on /left/depth/image_raw, /right/depth/image_raw" in done.stderr
