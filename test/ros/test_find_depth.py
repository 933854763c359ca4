"""A system whose depth topics have other names and types: what is said, and what ``up --auto`` takes."""

import threading
from contextlib import contextmanager

import pytest
import rclpy
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2

from depth_pose.core.errors import ConfigError
from depth_pose.ros.transport.depth_sources import depth_sources
from depth_pose.ros.transport.find_depth import find_depth

SIZE = {"width": 4, "height": 4}
KINDS = {
    "depth": lambda: Image(encoding="16UC1", step=8, data=bytes(32), **SIZE),
    "labels": lambda: Image(encoding="mono16", step=8, data=bytes(32), **SIZE),
    "colour": lambda: Image(encoding="bgr8", step=12, data=bytes(48), **SIZE),
    "info": lambda: CameraInfo(**SIZE),
    "packed": lambda: CompressedImage(format="16UC1; compressedDepth"),
    "jpeg": lambda: CompressedImage(format="rgb8; jpeg compressed bgr8", data=b"\xff\xd8\xff\xe0"),
    "cloud": PointCloud2,
}


@contextmanager
def published(node, **topics):
    """Publish these topics, ten times a second."""
    stop = threading.Event()
    messages = [(topic, KINDS[kind]()) for kind, names in topics.items() for topic in names]
    senders = [(node.create_publisher(type(message), topic, 1), message) for topic, message in messages]

    def send():
        while not stop.wait(0.1):
            for publisher, message in senders:
                publisher.publish(message)

    thread = threading.Thread(target=send)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def test_an_image_of_depth_among_colours(peer):
    infos = ["/front/range/camera_info", "/front/rgb/camera_info"]
    with published(
        peer.node, depth=["/front/range/image"], colour=["/front/rgb/image"], cloud=["/points"], info=infos
    ):
        found = find_depth()
    assert found.parameters == {"image_topic": "/front/range/image", "info_topic": "/front/range/camera_info"}


@pytest.mark.parametrize(
    ("kind", "topic", "parameters"),
    [
        ("cloud", "/lidar/points", {"cloud_topic": "/lidar/points"}),
        (
            "packed",
            "/cam/depth/compressedDepth",
            {"image_topic": "/cam/depth/compressedDepth", "info_topic": "/cam/camera_info"},
        ),
        ("packed", "/cam/small", {"image_topic": "/cam/small", "info_topic": "/cam/camera_info"}),
    ],
)
def test_the_only_one_of_another_type(peer, kind, topic, parameters):
    others = {"info": ["/cam/camera_info"], "colour": ["/cam/image"], "jpeg": ["/cam/jpeg"]}
    with published(peer.node, **{kind: [topic]}, **others):
        assert find_depth().parameters == parameters


def test_several_are_listed_with_their_parameters(peer):
    with (
        published(peer.node, depth=["/a/depth", "/b/depth"], info=["/a/camera_info", "/b/camera_info"]),
        pytest.raises(ConfigError, match="there are 2 depth topics") as refused,
    ):
        find_depth()
    assert "image_topic:=/a/depth info_topic:=/a/camera_info" in str(refused.value)
    assert "image_topic:=/b/depth info_topic:=/b/camera_info" in str(refused.value)


def test_what_another_suite_publishes_is_not_offered(peer):
    suite = rclpy.create_node("denoise", namespace="left", context=peer.context)
    with (
        published(suite, labels=["/left/labels"], cloud=["/left/points"]),
        published(peer.node, info=["/camera_info"]),
    ):
        peer.until(lambda: peer.node.count_publishers("/left/points"), what="the suite")
        peer.spin(0.5)
        assert not [s for s in depth_sources(peer.node) if s.topic.startswith("/left/")]
    suite.destroy_node()


def test_the_node_says_which_topics_there_are_and_the_parameters(peer, start):
    with published(
        peer.node, cloud=["/lidar/points"], packed=["/cam/depth/compressedDepth"], info=["/cam/camera_info"]
    ):
        node = start("-m", "depth_pose.ros.nodes.denoise_node")
        node.wait_for("nobody publishes /camera/depth/image_raw")
        node.wait_for("cloud_topic:=/lidar/points")
        assert "image_topic:=/cam/depth/compressedDepth info_topic:=/cam/camera_info" in node.output


@pytest.mark.parametrize("local", [[], ["--local"]])
def test_up_takes_the_only_one(peer, start, bank_path, local):
    with published(peer.node, cloud=["/lidar/points"]):
        process = start("-m", "depth_pose.cli", "up", "--auto", "--bank", str(bank_path), *local)
        process.wait_for("depth comes from /lidar/points (sensor_msgs/msg/PointCloud2)")
        process.wait_for("denoise is ready: listens to /lidar/points", 300.0)
