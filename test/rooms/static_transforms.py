"""Messages of ``/tf_static`` by the definitions of ROS 2 itself."""

from __future__ import annotations

from collections.abc import Sequence

from rosbags.typesys import Stores, get_typestore


def transforms_message(parent: str, child: str, pose: Sequence[float]) -> bytes:
    """Encode one transform: x, y, z, qx, qy, qz, qw of the child frame in its parent."""
    store = get_typestore(Stores.ROS2_JAZZY)
    make = store.types
    header = make["std_msgs/msg/Header"](make["builtin_interfaces/msg/Time"](0, 0), parent)
    p, q = make["geometry_msgs/msg/Vector3"](*pose[:3]), make["geometry_msgs/msg/Quaternion"](*pose[3:])
    transform = make["geometry_msgs/msg/Transform"](p, q)
    message = make["tf2_msgs/msg/TFMessage"](
        [make["geometry_msgs/msg/TransformStamped"](header, child, transform)]
    )
    return bytes(store.serialize_cdr(message, "tf2_msgs/msg/TFMessage"))
