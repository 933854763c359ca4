"""Messages of ROS 1 as those of ROS 2.

They become CDR by rosbags, where the type is one of ROS 1 Noetic's, of the same definition (MD5), and has the
same fields in ROS 2. No code is made of definitions that a recording brings.
"""

from __future__ import annotations

import struct
from functools import cache
from typing import Any

from depth_pose.io._topics import DamageError

_TF_MD5 = {"tf2_msgs/msg/TFMessage": "94810edda583a504dfda3829e70d7eec"}
"""Types that ROS 2 has with the same fields, and rosbags' list of Noetic's has not; as `rosmsg md5`."""


@cache
def _stores() -> tuple[Any, Any]:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_JAZZY)


@cache
def why_not(kind: str, md5: str) -> str:
    """Say why messages of a type, and with this checksum of its definition, cannot become ROS 2's.

    Empty where they can; without a checksum the type's name has to do.
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
    """Types of a message's fields, down to numbers; without the header's counter, which ROS 2 has not."""
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
    """Make CDR of a ROS 1 message."""
    from rosbags.serde import SerdeError

    try:
        return bytes(_stores()[1].ros1_to_cdr(data, kind))
    except (SerdeError, struct.error, ValueError, AssertionError, IndexError) as error:
        raise DamageError(f"a message is no {kind}") from error
