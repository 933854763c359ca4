"""Conversion of ROS 1 messages to ROS 2.

rosbags converts them to CDR if the type is one of ROS 1 Noetic's, with the same definition (MD5), and has the
same fields in ROS 2. No code is generated from definitions in a recording.
"""

from __future__ import annotations

import struct
from functools import cache
from typing import Any

from depth_pose.io._topics import DamageError

_TF_MD5 = {"tf2_msgs/msg/TFMessage": "94810edda583a504dfda3829e70d7eec"}
"""Types with the same fields in ROS 2 that are missing in rosbags' list of Noetic types; from `rosmsg
md5`."""


@cache
def _stores() -> tuple[Any, Any]:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_JAZZY)


@cache
def why_not(kind: str, md5: str) -> str:
    """Return why messages of a type and definition checksum cannot be converted to ROS 2.

    Empty if they can. Without a checksum only the type's name is compared.
    """
    from rosbags.typesys.base import TypesysError

    noetic, jazzy = _stores()
    try:
        if kind in _TF_MD5:
            known = _TF_MD5[kind]
        else:
            known = noetic.generate_msgdef(kind, ros_version=1)[1]
            if _layout(noetic, kind) != _layout(jazzy, kind):
                return f"ROS 1's {kind}, which ROS 2 has with other fields"
    except (TypesysError, KeyError):
        return f"ROS 1's {kind}, which is not one of ROS 2's types"
    return "" if md5 in (known, "") else f"another version of ROS 1's {kind}"


def _layout(store: Any, kind: str) -> Any:
    """Return the types of a message's fields, down to numbers, without the header's ROS 1 counter."""
    fields = store.get_msgdef(kind).fields
    if kind == "std_msgs/msg/Header":
        fields = [field for field in fields if field[0] != "seq"]
    return tuple(_layout_of(store, description) for _, description in fields)


def _layout_of(store: Any, description: Any) -> Any:
    kind, details = description
    if kind.name == "BASE":
        return "int32" if details[0] in ("int32", "uint32") else details[0]
    if kind.name == "NAME":
        return _layout(store, details)
    return kind.name, _layout_of(store, details[0]), details[1]


def to_cdr(data: bytes, kind: str) -> bytes:
    """Convert a ROS 1 message to CDR."""
    from rosbags.serde import SerdeError

    try:
        return bytes(_stores()[1].ros1_to_cdr(data, kind))
    except (SerdeError, struct.error, ValueError, AssertionError, IndexError) as error:
        raise DamageError(f"a message is not a valid {kind}") from error
