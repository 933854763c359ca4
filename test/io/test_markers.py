"""Markers of a recording, read by a decoder that is not ours."""

import numpy as np
import pytest
from mcap_ros2.reader import read_ros2_messages

from depth_pose.core.skeleton import BONES, JOINT_INDEX, JointState
from depth_pose.io.markers import COLOURS, MARKERS_TOPIC
from depth_pose.io.mcap_write import SkeletonWriter
from skeletons import make_skeleton


def skeleton(name, shift):
    places = np.arange(57, dtype=float).reshape(19, 3) / 10 + shift
    states = np.full(19, int(JointState.SEEN), np.uint8)
    states[JOINT_INDEX["left_wrist"]] = int(JointState.OCCLUDED)
    return make_skeleton(places, stamp_ns=1_500_000_000, body_id=name, joint_states=states)


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
        tints = np.array([COLOURS[JointState(state)] for state in person.joint_states])
        np.testing.assert_allclose([(c.r, c.g, c.b) for c in joints.colors], tints, atol=1e-6)
        ends = np.array(BONES)
        places = np.array([(p.x, p.y, p.z) for p in bones.points]).reshape(-1, 2, 3)
        np.testing.assert_array_equal(places, person.positions[ends])
        np.testing.assert_allclose([(c.r, c.g, c.b) for c in bones.colors[::2]], tints[ends[:, 1]], atol=1e-6)
        assert len(bones.colors) == len(bones.points)
        assert {c.a for marker in (joints, bones, name) for c in (marker.color, *marker.colors)} == {1.0}
        above = name.pose.position
        head = person.positions[JOINT_INDEX["head"]]
        assert (above.x, above.z) == (head[0], head[2]) and 0.1 < head[1] - above.y < 0.5  # y is down
        for marker in (joints, bones, name):
            assert (marker.action, marker.frame_locked) == (0, False)
            assert marker.pose.orientation.w == 1.0 and marker.scale.x + marker.scale.z > 0.0
    assert len({marker.ns for marker in drawn}) == 3 * count  # each of its own, or one replaces the other


def test_each_state_has_a_colour_of_its_own():
    assert set(COLOURS) == set(JointState) and len(set(COLOURS.values())) == len(JointState)
