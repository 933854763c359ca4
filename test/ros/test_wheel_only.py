"""The interfaces that the set-up builds where the wheels lack them are those that others have."""

import hashlib
import json
import os
import sys
from pathlib import Path

import pytest
from hri_msgs.msg import IdsList, NormalizedPointOfInterest2D, Skeleton2D
from rclpy.serialization import deserialize_message, serialize_message
from tf2_msgs.msg import TFMessage

PUBLISHED = "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"
"""What ``ros2 topic info -v /tf`` and rosbag2's metadata.yaml say of tf2_msgs/msg/TFMessage on Jazzy."""

TYPES = {"uint8": 3, "float32": 10, "string": 17}
ARRAY, SEQUENCE = 48, 144
TIME = ("builtin_interfaces/msg/Time", [("sec", 6, 0, ""), ("nanosec", 7, 0, "")])
HEADER = ("std_msgs/msg/Header", [("stamp", 1, 0, TIME[0]), ("frame_id", 17, 0, "")])
POINT = ("hri_msgs/msg/NormalizedPointOfInterest2D", [(name, 10, 0, "") for name in "xyc"])


def rihs01(described, *referenced):
    """REP-2016's hash of a type, from its fields (name, type, length, nested type)."""

    def describe(name, fields):
        return {
            "type_name": name,
            "fields": [
                {
                    "name": field,
                    "type": {
                        "type_id": kind,
                        "capacity": capacity,
                        "string_capacity": 0,
                        "nested_type_name": nested,
                    },
                }
                for field, kind, capacity, nested in fields
            ],
        }

    text = json.dumps(
        {
            "type_description": describe(*described),
            "referenced_type_descriptions": [describe(*r) for r in sorted(referenced)],
        },
        separators=(", ", ": "),
    )
    return "RIHS01_" + hashlib.sha256(text.encode()).hexdigest()


def built(name):
    """The hash that the built package carries."""
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    files = [Path(prefix, "share", f"{name}.json") for prefix in prefixes if prefix]
    found = json.loads(next(file for file in files if file.is_file()).read_text())
    return {t["type_name"]: t["hash_string"] for t in found["type_hashes"]}[name]


def test_tf_has_the_hash_that_jazzy_publishes():
    assert built("tf2_msgs/msg/TFMessage") == PUBLISHED


@pytest.mark.parametrize(
    ("described", "referenced"),
    [
        pytest.param(POINT, (), id="point"),
        pytest.param(
            ("hri_msgs/msg/IdsList", [("header", 1, 0, HEADER[0]), ("ids", SEQUENCE + 17, 0, "")]),
            (HEADER, TIME),
            id="ids",
        ),
        pytest.param(
            (
                "hri_msgs/msg/Skeleton2D",
                [("header", 1, 0, HEADER[0]), ("skeleton", ARRAY + 1, 18, POINT[0])],
            ),
            (HEADER, TIME, POINT),
            id="skeleton",
        ),
    ],
)
def test_hri_has_the_hashes_of_its_public_fields(described, referenced):
    """Computed here by REP-2016 from the fields of hri_msgs 2, apart from the generators."""
    assert built(described[0]) == rihs01(described, *referenced)


def test_messages_travel():
    sent = Skeleton2D(skeleton=[NormalizedPointOfInterest2D(x=0.5, y=0.25, c=1.0)] * 18)
    assert deserialize_message(serialize_message(sent), Skeleton2D) == sent
    sent = IdsList(ids=["body_1", "body_2"])
    assert deserialize_message(serialize_message(sent), IdsList) == sent
    assert deserialize_message(serialize_message(TFMessage()), TFMessage) == TFMessage()
    assert (Skeleton2D.NOSE, Skeleton2D.NECK, Skeleton2D.LEFT_WRIST, Skeleton2D.RIGHT_EAR) == (0, 1, 7, 17)
