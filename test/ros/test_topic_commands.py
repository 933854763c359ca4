"""The commands topics, echo and param, as they stand, on a real node and real topics."""

from pathlib import Path

import pytest
import yaml
from peer import LIMIT_S
from sensor_msgs.msg import CameraInfo, Image

from depth_pose.ros.tools.topics import plain_values
from depth_pose.ros.transport.tf import LATCHED
from depth_pose.sim.config import Person
from depth_pose.sim.motion import load_motion
from depth_pose.sim.simulate import simulate

TRIAL = Path(__file__).with_name("trial_node.py")


@pytest.fixture
def call(start):
    def run(*arguments):
        process = start("-m", "depth_pose.cli", *arguments)
        return process.process.wait(LIMIT_S), process.output

    return run


def test_topics_and_a_latched_message(call, peer):
    latched = peer.node.create_publisher(CameraInfo, "/camera/camera_info", LATCHED)
    latched.publish(CameraInfo(width=640, height=480))
    code, output = call("topics")
    assert code == 0, output
    (line,) = (line for line in output.splitlines() if "/camera/camera_info" in line)
    assert "sensor_msgs/msg/CameraInfo: 1 publish, 0 subscribe" in line
    code, output = call("echo", "/camera/camera_info", "--count", "1")
    assert code == 0, output
    assert yaml.safe_load(output.partition("---")[0])["width"] == 640


def test_echo_names_what_is_published(call, peer):
    peer.node.create_publisher(Image, "/camera/depth", 1)
    code, output = call("echo", "/camera/depht")
    assert code == 1 and "nobody publishes /camera/depht; there are /camera/depth" in output


def test_parameters_are_listed_read_and_set(call, start):
    node = start(TRIAL)
    node.wait_for("is ready")
    code, output = call("param", "list")
    assert code == 0 and "/depth_pose/trial" in output and "segment.near" in output, output
    assert call("param", "get", "trial", "segment.far") == (0, "8.0\n")
    assert call("param", "set", "trial", "segment.far", "5") == (0, "trial segment.far = 5.0\n")
    assert call("param", "get", "/depth_pose/trial", "segment.far") == (0, "5.0\n")
    code, output = call("param", "set", "trial", "segment.far", "500")
    assert code == 2 and "refuses segment.far" in output and "Traceback" not in output
    code, output = call("param", "get", "trial", "segment.fart")
    assert code == 2 and "has no parameter segment.fart" in output
    code, output = call("param", "list", "trail")
    assert code == 1 and "no node /depth_pose/trail runs" in output and "/depth_pose/trial" in output


def test_parameters_are_listed_while_a_recording_plays(call, start, peer, tmp_path):
    """The player has no parameters and would not answer."""
    simulate(tmp_path / "in.mcap", Person().body(), load_motion("stand_casual", 5.0, 1.0))
    node = start(TRIAL)
    node.wait_for("is ready")
    player = start("-m", "depth_pose.cli", "play", str(tmp_path / "in.mcap"), "--loop")
    peer.until(lambda: "player" in peer.node.get_node_names(), what=lambda: player.output)
    code, output = call("param", "list")
    assert code == 0 and "/depth_pose/trial" in output and "player" not in output, output


def test_long_arrays_are_cut():
    shown = plain_values(Image(height=2, width=9, encoding="mono8", step=9, data=bytes(range(18))))
    assert shown["data"] == [*range(8), "... 18 values"]
    assert shown["header"]["stamp"] == {"sec": 0, "nanosec": 0}
