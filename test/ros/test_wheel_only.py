"""The interfaces that the set-up builds where the wheels lack them are those that others have."""

import json
import os
import sys
from pathlib import Path

import pytest
from hri_msgs.msg import IdsList, NormalizedPointOfInterest2D, Skeleton2D
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from tf2_msgs.msg import TFMessage

PUBLISHED = "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"
"""What ``ros2 topic info -v /tf`` and rosbag2's metadata.yaml say of tf2_msgs/msg/TFMessage on Jazzy."""

FIELDS = {
    "IdsList": "std_msgs/Header header\nstring[] ids",
    "NormalizedPointOfInterest2D": "float32 x\nfloat32 y\nfloat32 c",
    "Skeleton2D": "std_msgs/Header header\nhri_msgs/NormalizedPointOfInterest2D[18] skeleton",
}
"""The fields of hri_msgs 2, which other programs are built with."""


def built(name):
    """The hash that the built package carries."""
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    files = [Path(prefix, "share", f"{name}.json") for prefix in prefixes if prefix]
    found = json.loads(next(file for file in files if file.is_file()).read_text())
    return {t["type_name"]: t["hash_string"] for t in found["type_hashes"]}[name]


@pytest.fixture(scope="module")
def types():
    """Another implementation of REP-2016's hashes, with ROS 2 Jazzy's own types."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in FIELDS.items():
        store.register(get_types_from_msg(text, f"hri_msgs/msg/{name}"))
    return store


def test_tf_has_the_hash_that_jazzy_publishes(types):
    name = "tf2_msgs/msg/TFMessage"
    assert built(name) == PUBLISHED == types.hash_rihs01(name)


@pytest.mark.parametrize("kind", FIELDS)
def test_hri_has_the_hashes_of_its_public_fields(types, kind):
    assert built(f"hri_msgs/msg/{kind}") == types.hash_rihs01(f"hri_msgs/msg/{kind}")


def test_messages_travel():
    sent = Skeleton2D(skeleton=[NormalizedPointOfInterest2D(x=0.5, y=0.25, c=1.0)] * 18)
    assert deserialize_message(serialize_message(sent), Skeleton2D) == sent
    sent = IdsList(ids=["body_1", "body_2"])
    assert deserialize_message(serialize_message(sent), IdsList) == sent
    assert deserialize_message(serialize_message(TFMessage()), TFMessage) == TFMessage()
    assert (Skeleton2D.NOSE, Skeleton2D.NECK, Skeleton2D.LEFT_WRIST, Skeleton2D.RIGHT_EAR) == (0, 1, 7, 17)
