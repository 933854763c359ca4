"""Skeleton and body surface as ``visualization_msgs``, and as TF frames.

Both markers carry a short lifetime, so that a viewer clears them when skeletons stop.
"""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, Quaternion, Transform, TransformStamped, Vector3
from numpy.typing import NDArray
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from depth_pose.core.skeleton import BONES, JOINTS, JointState
from depth_pose.core.types import Skeleton
from depth_pose.ros.transport.conversions import make_header

LIFETIME_NS = 500_000_000
"""How long a viewer keeps a marker, nanoseconds."""

_COLOURS = {
    JointState.SEEN: ColorRGBA(r=0.10, g=0.80, b=0.30, a=1.0),
    JointState.OCCLUDED: ColorRGBA(r=0.95, g=0.65, b=0.10, a=1.0),
    JointState.OUTSIDE_IMAGE: ColorRGBA(r=0.55, g=0.55, b=0.60, a=1.0),
    JointState.LOST: ColorRGBA(r=0.85, g=0.15, b=0.15, a=1.0),
}
_BONE_WIDTH_M = 0.02
_JOINT_SIZE_M = 0.05


def skeleton_to_markers(skeleton: Skeleton) -> MarkerArray:
    """Joints as spheres coloured by state, bones as lines; deletes them where nobody is known."""
    action = Marker.DELETE if skeleton.is_lost else Marker.ADD
    joints = _marker(skeleton.stamp_ns, skeleton.frame_id, "joints", Marker.SPHERE_LIST, action)
    bones = _marker(skeleton.stamp_ns, skeleton.frame_id, "bones", Marker.LINE_LIST, action)
    if not skeleton.is_lost:
        points = [Point(x=x, y=y, z=z) for x, y, z in skeleton.positions.tolist()]
        colours = [_COLOURS[JointState(state)] for state in skeleton.joint_states.tolist()]
        joints.scale = Vector3(x=_JOINT_SIZE_M, y=_JOINT_SIZE_M, z=_JOINT_SIZE_M)
        joints.points, joints.colors = points, colours
        bones.scale = Vector3(x=_BONE_WIDTH_M, y=0.0, z=0.0)
        bones.points = [points[end] for bone in BONES for end in bone]
        bones.colors = [colours[child] for _, child in BONES for _ in range(2)]
    return MarkerArray(markers=[joints, bones])


def mesh_to_marker(
    vertices: NDArray[np.floating], faces: NDArray[np.integer], stamp_ns: int, frame_id: str
) -> Marker:
    """Body surface as a ``TRIANGLE_LIST``.

    Parameters
    ----------
    vertices : (V, 3)
        Surface in the camera frame, metres.
    faces : (F, 3)
        Rows of `vertices`.
    stamp_ns, frame_id
        Of the depth frame.
    """
    marker = _marker(stamp_ns, frame_id, "mesh", Marker.TRIANGLE_LIST, Marker.ADD)
    marker.scale = Vector3(x=1.0, y=1.0, z=1.0)
    marker.color = ColorRGBA(r=0.75, g=0.78, b=0.85, a=0.6)
    points = [Point(x=x, y=y, z=z) for x, y, z in vertices.tolist()]
    marker.points = [points[i] for i in faces.ravel().tolist()]
    return marker


def _marker(stamp_ns: int, frame_id: str, namespace: str, kind: int, action: int) -> Marker:
    marker = Marker(header=make_header(stamp_ns, frame_id), ns=namespace, id=0, type=kind, action=action)
    marker.pose.orientation.w = 1.0
    marker.color = ColorRGBA(r=1.0, g=1.0, b=1.0, a=1.0)
    marker.lifetime = Duration(sec=0, nanosec=LIFETIME_NS)
    return marker


def skeleton_to_transforms(skeleton: Skeleton, prefix: str = "") -> list[TransformStamped]:
    """Camera frame to every joint, named ``prefix`` + joint name; none where nobody is known."""
    header = make_header(skeleton.stamp_ns, skeleton.frame_id)
    rows = zip(JOINTS, skeleton.positions.tolist(), skeleton.quats_xyzw.tolist(), strict=False)
    return [
        TransformStamped(
            header=header,
            child_frame_id=prefix + name,
            transform=Transform(
                translation=Vector3(x=p[0], y=p[1], z=p[2]),
                rotation=Quaternion(x=q[0], y=q[1], z=q[2], w=q[3]),
            ),
        )
        for name, p, q in rows
    ]
