"""What ships for RViz and Foxglove shows topics that the nodes publish, with a QoS that they serve."""

import importlib
import json

import pytest
import rclpy
from peer import SOURCE, join_own_domain
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from yaml import safe_load

SCRIPTS = SOURCE.parent / "launch_scripts"
TYPES = {
    "MarkerArray": "visualization_msgs/msg/MarkerArray",
    "Marker": "visualization_msgs/msg/Marker",
    "PointCloud2": "sensor_msgs/msg/PointCloud2",
    "Image": "sensor_msgs/msg/Image",
    "Pose": "geometry_msgs/msg/PoseStamped",
}
"""Displays of rviz_default_plugins, and what they show."""


@pytest.fixture(scope="module")
def published(bank_path):
    """Type and publishers of each topic of the nodes that show something."""
    with pytest.MonkeyPatch.context() as patch:
        join_own_domain(patch)
        yield from _published(bank_path)


def _published(bank_path):
    rclpy.init(args=["--ros-args", "-p", f"bank:={bank_path}"])
    nodes = []
    for name in ("denoise", "refine", "recovery"):
        module = importlib.import_module(f"depth_pose.ros.nodes.{name}_node")
        nodes.append(getattr(module, f"{name.capitalize()}Node")())
    found = {}
    for node in nodes:
        own = node.get_publisher_names_and_types_by_node(node.get_name(), node.get_namespace())
        for topic, kinds in own:
            made = [p for p in node.publishers if p.topic_name == topic]
            found[topic] = kinds, [p.qos_profile for p in made]
    yield found
    for node in nodes:
        node.destroy_node()
    rclpy.try_shutdown()


def test_rviz(published):
    displays = safe_load((SCRIPTS / "depth_pose.rviz").read_text())["Visualization Manager"]["Displays"]
    shown = {d["Topic"]["Value"]: d for d in displays if "Topic" in d}
    assert {"/depth_pose/markers", "/depth_pose/points", "/depth_pose/mesh"} <= set(shown)
    for topic, display in shown.items():
        package, _, kind = display["Class"].partition("/")
        kinds, (qos,) = published[topic]
        assert (package, kinds) == ("rviz_default_plugins", [TYPES[kind]])
        if display["Topic"]["Reliability Policy"] == "Reliable":
            assert qos.reliability == ReliabilityPolicy.RELIABLE
        if display["Topic"]["Durability Policy"] == "Transient Local":
            assert qos.durability == DurabilityPolicy.TRANSIENT_LOCAL


def test_foxglove(published):
    layout = json.loads((SCRIPTS / "foxglove_layout.json").read_text())
    panels = layout["configById"]

    def leaves(tree):
        return [tree] if isinstance(tree, str) else [*leaves(tree["first"]), *leaves(tree["second"])]

    assert sorted(leaves(layout["layout"])) == sorted(panels)
    topics = {t for panel in panels.values() for t in panel.get("topics", {})}
    topics |= {
        panel[key] for panel in panels.values() for key in ("topicToRender", "topicPath") if key in panel
    }
    assert "/depth_pose/markers" in topics and topics <= set(published)


def test_colcon_installs_them():
    setup = (SOURCE.parent / "ros_ws/src/depth_pose/setup.py").read_text()
    for name in ("depth_pose.rviz", "foxglove_layout.json", "params.yaml"):
        assert f'"launch/{name}"' in setup and (SCRIPTS / name).is_file()
