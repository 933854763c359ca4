"""Markers of a recording, read by a decoder that is not ours."""

import numpy as np
import pytest
from mcap_ros2.reader import read_ros2_messages

from depth_pose.core.skeleton import BONES, JOINT_INDEX, JOINTS, JointState, Source
from depth_pose.core.types import Skeleton
from depth_pose.io.markers import COLOURS, MARKERS_TOPIC
from depth_pose.io.mcap_write import SkeletonWriter


def skeleton(name, shift):
    places = np.arange(57, dtype=float).reshape(19, 3) / 10 + shift
    states = np.full(19, int(JointState.SEEN), np.uint8)
    states[JOINT_INDEX["left_wrist"]] = int(JointState.OCCLUDED)
    return Skeleton(
        stamp_ns=1_500_000_000,
        frame_id="optical",
        body_id=name,
        source=Source.REFINED,
        confidence=0.9,
        residual=0.01,
        scale=1.0,
        positions=places,
        quats_xyzw=np.tile([0.0, 0.0, 0.0, 1.0], (19, 1)),
        joint_confidence=np.ones(19, np.float32),
        joint_states=states,
    )


@pytest.mark.parametrize("count", [0, 1, 2])
def test_everybody_is_drawn(tmp_path, count):
    people = [skeleton(f"person_{i}", i) for i in range(count)]
    with SkeletonWriter(tmp_path / "out.mcap") as writer:
        writer.write_markers(people, 1_500_000_000, "optical")
    (read,) = read_ros2_messages(tmp_path / "out.mcap", topics=[MARKERS_TOPIC])
    first, *drawn = read.ros_msg.markers
    assert (first.action, len(drawn)) == (3, 3 * count)  # what was drawn before goes
    for person, joints, bones, name in zip(people, drawn[::3], drawn[1::3], drawn[2::3], strict=True):
        assert (joints.type, bones.type, name.type) == (7, 5, 9)
        assert joints.header.frame_id == "optical" and joints.header.stamp.nanosec == 500_000_000
        assert joints.ns == f"{person.body_id}/joints" and name.text == person.body_id
        assert [(p.x, p.y, p.z) for p in joints.points] == [tuple(p) for p in person.positions.tolist()]
        hidden = joints.colors[JOINTS.index("left_wrist")]
        assert (hidden.r, hidden.g, hidden.b) == pytest.approx(COLOURS[JointState.OCCLUDED])
        assert len(bones.points) == len(bones.colors) == 2 * len(BONES)
