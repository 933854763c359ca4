"""Skeleton and body surface as ``visualization_msgs``.

Both markers carry a short lifetime, so that a viewer clears them when skeletons stop.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, Vector3
from numpy.typing import NDArray
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import BONES, JOINT_INDEX, JointState
from depth_pose.io.markers import BONE_WIDTH_M, COLOURS, JOINT_SIZE_M, LIFETIME_NS, NAME_SIZE_M
from depth_pose.ros.messages.basics import make_header

_COLOURS = {state: ColorRGBA(r=r, g=g, b=b, a=1.0) for state, (r, g, b) in COLOURS.items()}
"""Colours of the joints by their state, opaque."""


def skeletons_to_markers(skeletons: Sequence[Skeleton], stamp_ns: int, frame_id: str) -> MarkerArray:
    """Build markers: joints as spheres coloured by state, bones as lines, names; earlier ones are deleted.

    The namespaces are ``BODY_ID/joints``, ``/bones`` and ``/name``.
    """
    markers = [_marker(stamp_ns, frame_id, "", Marker.SPHERE_LIST, Marker.DELETEALL)]
    for skeleton in skeletons:
        markers += _skeleton_markers(skeleton)
    return MarkerArray(markers=markers)


def _skeleton_markers(skeleton: Skeleton) -> list[Marker]:
    def marker(what: str, kind: int) -> Marker:
        name = f"{skeleton.body_id}/{what}"
        return _marker(skeleton.stamp_ns, skeleton.frame_id, name, kind, Marker.ADD)

    joints, bones = marker("joints", Marker.SPHERE_LIST), marker("bones", Marker.LINE_LIST)
    points = [Point(x=x, y=y, z=z) for x, y, z in skeleton.positions.tolist()]
    colours = [_COLOURS[JointState(state)] for state in skeleton.joint_states.tolist()]
    joints.scale = Vector3(x=JOINT_SIZE_M, y=JOINT_SIZE_M, z=JOINT_SIZE_M)
    joints.points, joints.colors = points, colours
    bones.scale = Vector3(x=BONE_WIDTH_M, y=0.0, z=0.0)
    bones.points = [points[end] for bone in BONES for end in bone]
    bones.colors = [colours[child] for _, child in BONES for _ in range(2)]
    name = marker("name", Marker.TEXT_VIEW_FACING)
    name.text = skeleton.body_id
    name.scale.z = NAME_SIZE_M
    x, y, z = skeleton.positions[JOINT_INDEX["head"]].tolist()
    name.pose.position = Point(x=x, y=y - 2.0 * NAME_SIZE_M, z=z)
    return [joints, bones, name]


def mesh_to_marker(
    vertices: NDArray[np.floating], faces: NDArray[np.integer], stamp_ns: int, frame_id: str, number: int = 0
) -> Marker:
    """Build a body surface as a ``TRIANGLE_LIST``.

    Parameters
    ----------
    vertices : (V, 3)
        Surface in the camera frame, metres.
    faces : (F, 3)
        Rows of `vertices`.
    stamp_ns, frame_id
        Of the depth frame.
    number : int
        Number of the person in the frame.
    """
    marker = _marker(stamp_ns, frame_id, "mesh", Marker.TRIANGLE_LIST, Marker.ADD)
    marker.id = number
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
