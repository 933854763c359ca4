"""Standard markers (``visualization_msgs/MarkerArray``) of skeletons in a recording, with no ROS installed.

Viewers without support for skeletons, such as Foxglove and RViz, draw these: a sphere per joint, coloured by
its state, a line per bone, and the person's name. `depth_pose.ros.transport.drawing` publishes the same
markers live.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import BONES, JOINT_INDEX, JointState

MARKERS_TOPIC, MARKER_ARRAY = "/depth_pose/markers", "visualization_msgs/msg/MarkerArray"

LIFETIME_NS = 500_000_000
"""Lifetime of a marker in a viewer (ns)."""

COLOURS = {
    JointState.SEEN: (0.10, 0.80, 0.30),
    JointState.OCCLUDED: (0.95, 0.65, 0.10),
    JointState.OUTSIDE_IMAGE: (0.55, 0.55, 0.60),
    JointState.LOST: (0.85, 0.15, 0.15),
}
"""Red, green, blue of a joint by its state."""

BONE_WIDTH_M, JOINT_SIZE_M, NAME_SIZE_M = 0.02, 0.05, 0.12
"""Sizes (m) for a person who fills the view."""

_LINE_LIST, _SPHERE_LIST, _TEXT, _ADD, _DELETE_ALL = 5, 7, 9, 0, 3
"""Constants of ``visualization_msgs/Marker``."""


@cache
def _store() -> Typestore:
    return get_typestore(Stores.ROS2_JAZZY)


@cache
def definition() -> str:
    """Return the schema's text, with those of the messages that it refers to."""
    return _store().generate_msgdef(MARKER_ARRAY, ros_version=2)[0]


def write_markers(skeletons: Sequence[Skeleton], stamp_ns: int, frame_id: str) -> bytes:
    """Encode the markers of all people in one frame; earlier markers are deleted.

    Parameters
    ----------
    skeletons : sequence of Skeleton
    stamp_ns : int
        Stamp of the depth frame, nanoseconds.
    frame_id : str
        Its optical frame.
    """
    types = _store().types

    def make(kind: str, *values: Any) -> Any:
        return types[kind](*values)

    def point(xyz: Sequence[float]) -> Any:
        return make("geometry_msgs/msg/Point", *xyz)

    def colour(rgb: Sequence[float]) -> Any:
        return make("std_msgs/msg/ColorRGBA", *rgb, 1.0)

    def marker(name: str, kind: int, action: int, size: Sequence[float] = (0, 0, 0)) -> Any:
        nowhere = make("geometry_msgs/msg/Quaternion", 0, 0, 0, 1)
        empty = np.zeros(0, np.uint8)
        return make(
            "visualization_msgs/msg/Marker",
            *(make("std_msgs/msg/Header", stamp, frame_id), name, 0, kind, action),
            make("geometry_msgs/msg/Pose", point((0, 0, 0)), nowhere),
            *(make("geometry_msgs/msg/Vector3", *size), colour((1.0, 1.0, 1.0))),
            *(make("builtin_interfaces/msg/Duration", 0, LIFETIME_NS), False, [], [], ""),
            make("sensor_msgs/msg/CompressedImage", make("std_msgs/msg/Header", stamp, ""), "", empty),
            *([], "", "", make("visualization_msgs/msg/MeshFile", "", empty), False),
        )

    stamp = make("builtin_interfaces/msg/Time", *divmod(stamp_ns, 1_000_000_000))
    markers = [marker("", _SPHERE_LIST, _DELETE_ALL)]
    for skeleton in skeletons:
        places = [point(xyz) for xyz in skeleton.positions.tolist()]
        tints = [colour(COLOURS[JointState(state)]) for state in skeleton.joint_states.tolist()]
        joints = marker(f"{skeleton.body_id}/joints", _SPHERE_LIST, _ADD, (JOINT_SIZE_M,) * 3)
        bones = marker(f"{skeleton.body_id}/bones", _LINE_LIST, _ADD, (BONE_WIDTH_M, 0.0, 0.0))
        joints.points, joints.colors = places, tints
        bones.points = [places[end] for bone in BONES for end in bone]
        bones.colors = [tints[child] for _, child in BONES for _ in range(2)]
        name = marker(f"{skeleton.body_id}/name", _TEXT, _ADD, (0.0, 0.0, NAME_SIZE_M))
        x, y, z = skeleton.positions[JOINT_INDEX["head"]].tolist()
        name.text, name.pose.position = skeleton.body_id, point((x, y - 2.0 * NAME_SIZE_M, z))
        markers += [joints, bones, name]
    message = make(MARKER_ARRAY, markers)
    return bytes(_store().serialize_cdr(message, MARKER_ARRAY, little_endian=True))
