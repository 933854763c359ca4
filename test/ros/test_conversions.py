import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField

from depth_pose.core.errors import InputError
from depth_pose.core.skeleton import BONES, JOINTS, JointState, Source
from depth_pose.core.types import Candidate, PersonCloud, PoseMatch, Skeleton
from depth_pose.ros.transport import conversions as c
from depth_pose.ros.transport import drawing


def over_the_wire(message):
    return deserialize_message(serialize_message(message), type(message))


def assert_same_bits(a, b):
    assert a.dtype == b.dtype and a.shape == b.shape
    assert a.tobytes() == b.tobytes()


@pytest.fixture
def rng():
    return np.random.default_rng(7)


@pytest.fixture
def cloud(rng):
    points = rng.normal(size=(12, 17, 3)).astype(np.float32)
    labels = rng.integers(0, 3, (12, 17)).astype(np.uint8)
    points[labels != 1] = np.nan
    return PersonCloud(1_700_000_000_123_456_789, "optical", points, labels)


@pytest.fixture
def skeleton(rng):
    return Skeleton(
        5_000_000_001,
        "optical",
        "person-3",
        Source.RECOVERED,
        float(np.float32(0.7)),
        float(np.float32(0.0123)),
        float(np.float32(0.93)),
        rng.normal(size=(19, 3)),
        rng.normal(size=(19, 4)),
        rng.random(19).astype(np.float32),
        rng.integers(0, 4, 19).astype(np.uint8),
    )


def test_cloud_round_trip_is_exact(cloud):
    msg = over_the_wire(c.cloud_to_msg(cloud))
    assert (msg.point_step, msg.row_step, len(msg.data)) == (16, 16 * 17, 16 * 17 * 12)
    assert [(f.name, f.offset) for f in msg.fields] == [("x", 0), ("y", 4), ("z", 8), ("label", 12)]
    back = c.msg_to_cloud(msg)
    assert (back.stamp_ns, back.frame_id) == (cloud.stamp_ns, cloud.frame_id)
    assert_same_bits(back.points, cloud.points)
    assert_same_bits(back.labels, cloud.labels)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda m: m.fields.pop(),
        lambda m: setattr(m, "point_step", 20),
        lambda m: setattr(m, "data", bytes(m.data)[:-1]),
        lambda m: setattr(m, "row_step", 3),
        lambda m: setattr(m, "is_bigendian", True),
    ],
)
def test_foreign_cloud_is_refused(cloud, spoil):
    msg = over_the_wire(c.cloud_to_msg(cloud))
    msg.fields = list(msg.fields)
    spoil(msg)
    with pytest.raises(InputError, match="cloud"):
        c.msg_to_cloud(msg)


def test_skeleton_round_trip_is_exact(skeleton):
    back = c.msg_to_skeleton(over_the_wire(c.skeleton_to_msg(skeleton)))
    for name in ("stamp_ns", "frame_id", "body_id", "source", "confidence", "residual", "scale"):
        assert getattr(back, name) == getattr(skeleton, name)
    for name in ("positions", "quats_xyzw", "joint_confidence", "joint_states"):
        assert_same_bits(getattr(back, name), getattr(skeleton, name))


def test_skeleton_joints_go_by_name_not_place(skeleton):
    msg = c.skeleton_to_msg(skeleton)
    msg.joints = list(reversed(msg.joints))
    assert_same_bits(c.msg_to_skeleton(msg).positions, skeleton.positions)
    msg.joints[0].name = "tail"
    with pytest.raises(InputError, match="tail"):
        c.msg_to_skeleton(msg)


def test_lost_skeleton_has_no_joints():
    lost = Skeleton.lost(-1_500_000_000, "optical")
    msg = over_the_wire(c.skeleton_to_msg(lost))
    assert msg.source == msg.LOST and not msg.joints
    back = c.msg_to_skeleton(msg)
    assert back.is_lost and back.positions.shape == (0, 3) and back.quats_xyzw.shape == (0, 4)
    assert back.stamp_ns == lost.stamp_ns


def test_match_round_trip_is_exact(rng):
    candidates = tuple(
        Candidate(i, i + 1, rng.normal(size=4), rng.normal(size=3), rng.random(), rng.random())
        for i in range(4)
    )
    match = PoseMatch(3, "optical", "bank-hash", 1 / 3, candidates)
    back = c.msg_to_match(over_the_wire(c.match_to_msg(match)))
    assert (back.stamp_ns, back.bank_id, back.scale) == (3, "bank-hash", 1 / 3)
    for a, b in zip(back.candidates, candidates, strict=True):
        assert (a.exemplar, a.view, a.distance, a.score) == (b.exemplar, b.view, b.distance, b.score)
        assert_same_bits(a.quat_xyzw, b.quat_xyzw)
        assert_same_bits(a.translation, b.translation)
    empty = PoseMatch(3, "optical", "", 0.0, ())
    assert c.msg_to_match(over_the_wire(c.match_to_msg(empty))) == empty


@pytest.mark.parametrize("stamp_ns", [0, 1, 999_999_999, 1_000_000_000, -1, 2**31 * 10**9 - 1])
def test_stamps(stamp_ns):
    assert c.stamp_to_ns(c.ns_to_stamp(stamp_ns)) == stamp_ns


def info_of(width, height):
    return CameraInfo(width=width, height=height, k=[90.0, 0, width / 2, 0, 91.0, height / 2, 0, 0, 1.0])


def test_image_to_frame():
    depth_mm = np.arange(6, dtype="<u2").reshape(2, 3) * 1000
    msg = Image(height=2, width=3, encoding="16UC1", step=6, data=depth_mm.tobytes())
    msg.header.stamp.sec, msg.header.frame_id = 4, "optical"
    frame = c.image_to_frame(over_the_wire(msg), info_of(3, 2))
    np.testing.assert_array_equal(frame.depth, depth_mm / np.float32(1000))
    assert frame.depth.dtype == np.float32
    assert (frame.stamp_ns, frame.frame_id) == (4_000_000_000, "optical")
    assert (frame.camera.fx, frame.camera.cy) == (90.0, 1.0)
    with pytest.raises(InputError, match="3 x 2"):
        c.image_to_frame(msg, info_of(6, 4))
    msg.encoding = "rgb8"
    with pytest.raises(InputError, match="rgb8"):
        c.image_to_frame(msg, info_of(3, 2))


@pytest.mark.parametrize("kind", ["<f4", ">f8"])
def test_sensor_cloud_to_frame(kind):
    """An organised cloud in any layout gives back the depth image and camera it came from."""
    height, width, fx, cx, cy = 24, 32, 40.0, 15.2, 11.7
    v, u = np.mgrid[:height, :width]
    z = 2.0 + 0.01 * u + 0.02 * v
    z[3:5, 4:9] = np.nan
    points = np.stack([(u - cx) / fx * z, (v - cy) / fx * z, z], axis=-1)
    size = np.dtype(kind).itemsize
    step = 4 * size
    raw = np.zeros((height, width + 1, 4), kind)  # one point of padding at the end of a row
    raw[:, :width, 1:] = points
    datatype = {4: PointField.FLOAT32, 8: PointField.FLOAT64}[size]
    msg = PointCloud2(
        height=height,
        width=width,
        point_step=step,
        row_step=step * (width + 1),
        is_bigendian=kind[0] == ">",
        fields=[
            PointField(name=n, offset=(i + 1) * size, datatype=datatype, count=1) for i, n in enumerate("xyz")
        ],
        data=raw.tobytes(),
    )
    frame = c.msg_to_frame(over_the_wire(msg))
    assert (frame.camera.width, frame.camera.height) == (width, height)
    assert frame.camera.fx == pytest.approx(fx, abs=1e-3)
    np.testing.assert_allclose(frame.depth, np.nan_to_num(z), atol=1e-6)


def test_markers(skeleton):
    joints, bones = over_the_wire(drawing.skeleton_to_markers(skeleton)).markers
    assert len(joints.points) == len(joints.colors) == len(JOINTS)
    assert len(bones.points) == len(bones.colors) == 2 * len(BONES)
    parent, child = BONES[5]
    for end, joint in ((bones.points[10], parent), (bones.points[11], child)):
        np.testing.assert_array_equal([end.x, end.y, end.z], skeleton.positions[joint])
    seen = skeleton.joint_states.tolist().index(JointState.SEEN)
    assert joints.colors[seen].g > joints.colors[seen].r
    lost = drawing.skeleton_to_markers(Skeleton.lost(1, "optical"))
    assert all(m.action == m.DELETE for m in lost.markers)


def test_mesh_marker(rng):
    vertices, faces = rng.normal(size=(5, 3)), np.array([[0, 1, 2], [2, 3, 4]], np.int32)
    marker = over_the_wire(drawing.mesh_to_marker(vertices, faces, 7, "optical"))
    assert marker.type == marker.TRIANGLE_LIST and marker.header.stamp.nanosec == 7
    np.testing.assert_array_equal([(p.x, p.y, p.z) for p in marker.points], vertices[faces.ravel()])


def test_transforms(skeleton):
    transforms = drawing.skeleton_to_transforms(skeleton, "left/")
    assert [t.child_frame_id for t in transforms] == ["left/" + name for name in JOINTS]
    t = transforms[4].transform
    assert [t.translation.x, t.translation.y, t.translation.z] == skeleton.positions[4].tolist()
    assert t.rotation.w == skeleton.quats_xyzw[4, 3]
    assert not drawing.skeleton_to_transforms(Skeleton.lost(1, "optical"))
