"""The commands hz and tf, as they stand, on real topics."""

import re
import signal
import threading
import time

import numpy as np
import pytest
from peer import LIMIT_S, within
from rclpy.qos import QoSProfile
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from depth_pose.core.rotations import rotation_z
from depth_pose.ros.tools.inspect_topics import Place
from depth_pose.ros.transport.tf import LATCHED, TF_QUEUE, stamped


def command(start, *arguments):
    return start("-m", "depth_pose.cli", *arguments)


@pytest.fixture
def beat():
    """Call something again and again, beside the test."""
    stop, threads = threading.Event(), []

    def run(what, hz):
        def loop():
            while not stop.wait(1.0 / hz):
                what()

        threads.append(threading.Thread(target=loop))
        threads[-1].start()

    yield run
    stop.set()
    for thread in threads:
        thread.join()


def test_hz(start, peer, beat):
    out = peer.node.create_publisher(String, "/words", QoSProfile(depth=10))
    beat(lambda: out.publish(String(data="word")), 20)

    def attempt():
        process = command(start, "hz", "/words", "--count", "3")
        assert process.process.wait(LIMIT_S) == 0, process.output
        assert "no messages" not in process.output.partition("average")[0]  # it waits until it has met them
        rates = [float(r) for r in re.findall(r"average rate: ([\d.]+)", process.output)]
        assert len(rates) == 3
        return 10.0 < np.median(rates) < 21.0

    assert any(attempt() for _ in range(10))  # where neither of the two stood still meanwhile


def test_tf(start, peer, beat):
    static = peer.node.create_publisher(TFMessage, "/tf_static", LATCHED)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation_z(np.array(np.pi / 2)), (0.0, 0.0, 1.5)
    static.publish(TFMessage(transforms=[stamped(0, "optical", "floor", T)]))
    moving = peer.node.create_publisher(TFMessage, "/tf", TF_QUEUE)

    def move():
        now = time.time_ns()
        place = np.eye(4)
        place[:3, 3] = (1.0, 2.0, 3.0)
        moving.publish(TFMessage(transforms=[stamped(now, "optical", "body_1_left_wrist", place)]))

    beat(move, 20)
    process = command(start, "tf", "body_1_left_wrist", "--in", "floor", "--count", "1", "--every", "0.5")
    assert process.process.wait(LIMIT_S) == 0, process.output
    assert "- Translation: [2.000, -1.000, 1.500]" in process.output
    assert "- Rotation: in RPY (degree) [0.000, 0.000, -90.000]" in process.output.replace("-0.000", "0.000")
    for listens_s in ("0.5", "1", "2", "4", "8", "16"):  # where that is long enough to hear of both
        process = command(start, "tf", "--every", listens_s)
        process.process.wait(LIMIT_S)
        told = [re.search(rf"{name}\W+in optical", process.output) for name in ("body_1_left_wrist", "floor")]
        if all(told):
            break
    assert process.process.returncode == 0 and all(told), process.output


def test_frames_in_a_circle_and_names_that_forge_lines(start, peer, beat):
    moving = peer.node.create_publisher(TFMessage, "/tf", TF_QUEUE)
    pairs = [("a", "b"), ("b", "a"), ("c", "c"), ("a", "evil\x1b[2J\nnodes are ready")]
    circle = TFMessage(transforms=[stamped(0, above, below, np.eye(4)) for above, below in pairs])
    beat(lambda: moving.publish(circle), 20)
    process = command(start, "tf", "--every", "0.5")
    assert process.process.wait(LIMIT_S) == 0, process.output
    assert "evil\\x1b[2J\\nnodes are ready" in process.output and "\x1b" not in process.output
    process = command(start, "tf", "a", "--in", "c", "--every", "0.2")
    process.wait_for("a in c: not known yet")
    code, _ = process.end(signal.SIGINT)
    assert code == 0 and "Traceback" not in process.output


def test_tf_says_that_there_is_nothing(start):
    process = command(start, "tf", "--every", "0.5")
    assert process.process.wait(LIMIT_S) == 1
    assert "parameter tf: true" in process.output


def test_it_ends_when_told(start):
    def attempt():
        process = command(start, "hz", "/nothing", "--every", "0.3")
        process.wait_for("no messages")
        code, took = process.end(signal.SIGINT)
        assert code == 0
        return took

    within(3.0, attempt)


def test_roll_pitch_yaw():
    T = np.eye(4)
    T[:3, :3] = rotation_z(np.radians(30.0))
    assert np.allclose(Place(0, T).rpy_deg, [0, 0, 30])
    assert np.isclose(abs(Place(0, T).quat_xyzw[2]), np.sin(np.radians(15.0)))
