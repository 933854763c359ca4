from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from depth_pose_msgs.msg import Joint as JointMsg
from depth_pose_msgs.msg import Packed, SkeletonArray
from depth_pose_msgs.msg import Skeleton as SkeletonMsg
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField

from depth_pose.body.pose import BodyPose, Fitted, FittedBody
from depth_pose.core.camera import Camera
from depth_pose.core.errors import InputError
from depth_pose.core.labels import HIDDEN
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.pose_match import Candidate, PoseMatch
from depth_pose.core.result import BUILD_SIZE, Skeleton
from depth_pose.core.rotations import quat_to_matrix
from depth_pose.core.skeleton import BONES, JOINTS, NODE_INDEX, NODES, JointState, Source
from depth_pose.io.skeleton_cdr import write_people, write_skeleton
from depth_pose.ros.messages.basics import ns_to_stamp, stamp_to_ns
from depth_pose.ros.messages.fits import fitted_to_msg, msg_to_fitted
from depth_pose.ros.messages.frames import image_to_frame, msg_to_frame
from depth_pose.ros.messages.matches import matches_to_msg, msg_to_matches
from depth_pose.ros.messages.people import POINT_DTYPE, msg_to_people, people_to_cloud, people_to_msg
from depth_pose.ros.messages.skeletons import msg_to_skeleton
from depth_pose.ros.transport import drawing, tf
from depth_pose.track.person_view import see_people
from depth_pose.track.tracked_person import TrackedPerson
from skeletons import random_skeleton


def over_the_wire(message):
    return deserialize_message(serialize_message(message), type(message))


def assert_same_bits(a, b):
    assert a.dtype == b.dtype and a.shape == b.shape
    assert a.tobytes() == b.tobytes()


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def measurement(rng):
    places, sigma, confidence, heels = (
        rng.random(shape).astype(np.float32) for shape in ((19, 3), (19, 2), 19, (2, 5))
    )
    return JointMeasurement(places, sigma, confidence, heels, left_right_confidence=0.7, probability=0.6)


@pytest.fixture
def people(rng):
    """Two people on a small grid, the second of whom has too few points."""
    camera = Camera(40, 30, 50.0, 51.0, 19.5, 14.5)
    labels = rng.choice(np.array([0, 1, HIDDEN], np.uint8), (30, 40))
    labels[0, :5] = 2
    depth = np.where((labels == 1) | (labels == 2), rng.uniform(2.0, 3.0, labels.shape), 0.0)
    found = [
        TrackedPerson(
            k,
            f"body_{k + 4}",
            float(np.float32(0.3 * k)),
            measured,
        )
        for k, measured in ((1, measurement(rng)), (2, None))
    ]
    depth, floor = depth.astype(np.float32), np.array([0.0, -0.8, -0.6, 1.25])
    return see_people(1_700_000_000_123_456_789, "optical", camera, depth, labels, found, floor)


@pytest.fixture
def skeleton(rng):
    return random_skeleton(rng, stamp_ns=5_000_000_001, body_id="person_3")


def random_rotations(rng, count):
    quats = rng.normal(size=(count, 4))
    return quat_to_matrix(quats / np.linalg.norm(quats, axis=1, keepdims=True))


def test_the_cloud_has_points_and_labels(people):
    cloud = over_the_wire(people_to_cloud(people))
    assert (cloud.point_step, cloud.row_step, len(cloud.data)) == (16, 16 * 40, 16 * 40 * 30)
    assert [(f.name, f.offset) for f in cloud.fields] == [("x", 0), ("y", 4), ("z", 8), ("label", 12)]
    records = np.frombuffer(cloud.data, POINT_DTYPE).reshape(30, 40)
    assert_same_bits(np.stack([records[axis] for axis in "xyz"], axis=-1), people.points)
    assert_same_bits(records["label"].copy(), people.labels)


def test_people_round_trip_is_exact(people):
    back = msg_to_people(over_the_wire(people_to_msg(people)))
    assert (back.stamp_ns, back.frame_id, back.camera) == (people.stamp_ns, people.frame_id, people.camera)
    assert_same_bits(back.floor, people.floor)
    assert [p.body_id for p in back.persons] == [p.body_id for p in people.persons] == ["body_5"]
    for a, b in zip(back.persons, people.persons, strict=True):
        assert a.found.probability == b.found.probability and a.found.label == b.found.label
        assert (a.measured is None) == (b.measured is None)
        if a.measured is not None:
            for name in ("places", "sigma", "confidence", "heels"):
                assert_same_bits(getattr(a.measured, name), getattr(b.measured, name))
            assert a.measured.left_right_confidence == b.measured.left_right_confidence
            assert a.measured.probability == b.measured.probability
        assert (a.is_cut_below, a.is_cut_beside) == (b.is_cut_below, b.is_cut_beside)
        assert_same_bits(a.points, b.points)
        assert_same_bits(a.full.labels, b.full.labels)
        assert_same_bits(a.coarse.depth, b.coarse.depth)


def test_foreign_people_are_refused(people):
    message = people_to_msg(people)
    for data, says in (
        (b"", "0 bytes of data"),
        (bytes(message.data)[:-8], "the data has"),
        (b"x" + bytes(message.data)[1:], "another version"),
    ):
        with pytest.raises(InputError, match=says):
            msg_to_people(Packed(data=data))
    with pytest.raises(InputError, match="another version"):
        msg_to_matches(message)


def skeleton_msg(skeleton):
    return deserialize_message(write_skeleton(skeleton), SkeletonMsg)


def test_skeleton_round_trip_is_exact(skeleton):
    back = msg_to_skeleton(skeleton_msg(skeleton))
    for name in ("stamp_ns", "frame_id", "body_id", "source", "confidence", "residual", "scale"):
        assert getattr(back, name) == getattr(skeleton, name)
    for name in ("positions", "quats_xyzw", "joint_confidence", "joint_states", "build"):
        assert_same_bits(getattr(back, name), getattr(skeleton, name))


def test_skeleton_joints_go_by_name_not_place(skeleton):
    msg = skeleton_msg(skeleton)
    msg.joints = list(reversed(msg.joints))
    assert_same_bits(msg_to_skeleton(msg).positions, skeleton.positions)
    msg.joints[0].name = "tail"
    with pytest.raises(InputError, match="tail"):
        msg_to_skeleton(msg)


def test_lost_skeleton_has_no_joints():
    lost = Skeleton.lost(-1_500_000_000, "optical")
    msg = skeleton_msg(lost)
    assert msg.source == msg.LOST and not msg.joints
    back = msg_to_skeleton(msg)
    assert back.is_lost and back.positions.shape == (0, 3) and back.quats_xyzw.shape == (0, 4)
    assert back.stamp_ns == lost.stamp_ns


def test_a_source_that_there_is_not_is_refused(skeleton):
    msg = skeleton_msg(skeleton)
    msg.source = 77
    with pytest.raises(InputError, match="source is 77"):
        msg_to_skeleton(msg)


@pytest.mark.parametrize("field, value, says", [
    ("joint_states", np.full(19, 250, np.uint8), "has the state 250"),
    ("build", np.zeros(2, np.float32), "has 2 numbers"),
    ("build", np.full(13, np.nan, np.float32), "has the number nan"),
    ("joint_confidence", np.full(19, np.nan, np.float32), "has the confidence nan"),
    ("joint_confidence", np.full(19, 1.5, np.float32), "has the confidence 1.5"),
    ("joint_confidence", np.full(19, -1.0, np.float32), "has the confidence -1"),
    ("confidence", float("nan"), "has the confidence nan"),
    ("confidence", 7.0, "has the confidence 7"),
    ("residual", float("nan"), "has the number nan"),
    ("residual", 1e30, "has the number 1e\\+30"),
])  # fmt: skip
def test_numbers_that_no_skeleton_has_are_refused(skeleton, field, value, says):
    with pytest.raises(InputError, match=says):
        msg_to_skeleton(skeleton_msg(replace(skeleton, **{field: value})))


def test_more_people_than_labels_or_one_of_them_twice_are_refused(people):
    def fitted(ids):
        return fitted_to_msg([Fitted.lost(people.stamp_ns, i) for i in ids], people)

    def matches(ids):
        return matches_to_msg([PoseMatch(i, "bank", 1.0, ()) for i in ids], people)

    for make, read in ((fitted, partial(msg_to_fitted, vertices=9)), (matches, msg_to_matches)):
        assert len(read(make(["a", "b"]))[1]) == 2
        with pytest.raises(InputError, match="have 'a' twice"):
            read(make(["a", "b", "a"]))
        crowd = make([str(i) for i in range(10_000)])
        with pytest.raises(InputError, match="of 10000 people; at most 255"):
            read(crowd)


def test_matches_make_a_round_trip(rng, people):
    candidates = tuple(
        Candidate(
            i, i + 1, quat_to_matrix(q / np.linalg.norm(q)), rng.normal(size=3), rng.random(), rng.random()
        )
        for i, q in enumerate(rng.normal(size=(4, 4)))
    )
    matches = PoseMatch("body_5", "bank-hash", 1 / 3, candidates), PoseMatch("body_6", "", 0.0, ())
    msg = over_the_wire(matches_to_msg(matches, people))
    assert stamp_to_ns(msg.header.stamp) == people.stamp_ns
    _, (back, empty) = msg_to_matches(msg)
    assert (back.body_id, back.bank_id, back.scale) == ("body_5", "bank-hash", 1 / 3)
    for a, b in zip(back.candidates, candidates, strict=True):
        assert (a.exemplar, a.view, a.distance, a.score) == (b.exemplar, b.view, b.distance, b.score)
        assert_same_bits(a.rotation, b.rotation)
        assert_same_bits(a.translation, b.translation)
    assert empty == matches[1]


def test_fitted_bodies_make_a_round_trip(people, body, rng):
    """A build, a pose and joints that are not all the body's own."""
    build = rng.normal(0.0, 0.03, BUILD_SIZE).astype(np.float32)
    rotations = random_rotations(rng, len(NODES))
    pose = BodyPose(rotations, np.array([0.1, -0.2, 3.0]), 0.9)
    posed = body.pose(rotations, pose.root, pose.scale)
    nodes = posed.nodes.copy()
    nodes[NODE_INDEX["left_foot"]] += 0.05
    fitted = FittedBody(pose, posed.vertices, nodes)
    known = Fitted("body_5", people.stamp_ns, Source.REFINED, fitted, build, 1 / 3, 0.01)
    msg = over_the_wire(fitted_to_msg([known, Fitted.lost(people.stamp_ns, "body_6")], people))
    _, (back, lost) = msg_to_fitted(msg, len(body.vertices))
    for name in ("body_id", "stamp_ns", "source", "score", "mean_depth_error"):
        assert getattr(back, name) == getattr(known, name)
    assert back.pose.scale == 0.9
    assert_same_bits(back.pose.rotations, rotations)
    assert_same_bits(back.pose.root, pose.root)
    assert_same_bits(back.nodes, nodes)
    assert_same_bits(back.body.vertices, posed.vertices)
    assert_same_bits(back.build, build)
    assert (lost.is_lost, lost.body_id, lost.score) == (True, "body_6", 1.0)
    with pytest.raises(InputError, match=r"vertices; 1 bodies have 7 each"):
        msg_to_fitted(msg, 7)


def test_everybody_in_one_message(skeleton):
    msg = deserialize_message(write_people([skeleton, skeleton], 7, "optical"), SkeletonArray)
    assert [s.body_id for s in msg.skeletons] == ["person_3", "person_3"]
    assert not deserialize_message(write_people([], 7, "optical"), SkeletonArray).skeletons


@pytest.mark.parametrize("stamp_ns", [0, 1, 999_999_999, 1_000_000_000, -1, 2**31 * 10**9 - 1])
def test_stamps(stamp_ns):
    assert stamp_to_ns(ns_to_stamp(stamp_ns)) == stamp_ns


def info_of(width, height):
    return CameraInfo(width=width, height=height, k=[90.0, 0, width / 2, 0, 91.0, height / 2, 0, 0, 1.0])


def test_image_to_frame():
    depth_mm = np.arange(6, dtype="<u2").reshape(2, 3) * 1000
    msg = Image(height=2, width=3, encoding="16UC1", step=6, data=depth_mm.tobytes())
    msg.header.stamp.sec, msg.header.frame_id = 4, "optical"
    frame = image_to_frame(over_the_wire(msg), info_of(3, 2))
    np.testing.assert_array_equal(frame.depth, depth_mm / np.float32(1000))
    assert frame.depth.dtype == np.float32
    assert (frame.stamp_ns, frame.frame_id) == (4_000_000_000, "optical")
    assert (frame.camera.fx, frame.camera.cy) == (90.0, 1.0)
    with pytest.raises(InputError, match="3 x 2"):
        image_to_frame(msg, info_of(6, 4))
    info = info_of(3, 2)
    info.d, info.p = [0.1, 0.0, 0.0, 0.0, 0.0], [80.0, 0, 1.5, 0, 0, 81.0, 1.0, 0, 0, 0, 1, 0]
    rectified = image_to_frame(msg, info, rectified=True)
    np.testing.assert_array_equal(rectified.depth, frame.depth)
    assert (rectified.camera.fx, rectified.camera.fy) == (80.0, 81.0)
    info.p = [0.0] * 12  # as many drivers leave it
    assert image_to_frame(msg, info, rectified=True).camera.fx == 90.0
    msg.encoding = "rgb8"
    with pytest.raises(InputError, match="rgb8"):
        image_to_frame(msg, info_of(3, 2))


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
    frame = msg_to_frame(over_the_wire(msg))
    assert (frame.camera.width, frame.camera.height) == (width, height)
    assert frame.camera.fx == pytest.approx(fx, abs=1e-3)
    np.testing.assert_allclose(frame.depth, np.nan_to_num(z), atol=1e-6)


def test_markers(skeleton):
    clear, joints, bones, name = over_the_wire(drawing.skeletons_to_markers([skeleton], 1, "optical")).markers
    assert clear.action == clear.DELETEALL and name.text == skeleton.body_id
    assert len(joints.points) == len(joints.colors) == len(JOINTS)
    assert len(bones.points) == len(bones.colors) == 2 * len(BONES)
    parent, child = BONES[5]
    for end, joint in ((bones.points[10], parent), (bones.points[11], child)):
        np.testing.assert_array_equal([end.x, end.y, end.z], skeleton.positions[joint])
    seen = skeleton.joint_states.tolist().index(JointState.SEEN)
    assert joints.colors[seen].g > joints.colors[seen].r
    (clear,) = drawing.skeletons_to_markers([], 1, "optical").markers
    assert clear.action == clear.DELETEALL


def test_mesh_marker(rng):
    vertices, faces = rng.normal(size=(5, 3)), np.array([[0, 1, 2], [2, 3, 4]], np.int32)
    marker = over_the_wire(drawing.mesh_to_marker(vertices, faces, 7, "optical"))
    assert marker.type == marker.TRIANGLE_LIST and marker.header.stamp.nanosec == 7
    np.testing.assert_array_equal([(p.x, p.y, p.z) for p in marker.points], vertices[faces.ravel()])


def test_transforms(skeleton):
    transforms = tf.skeletons_to_transforms([skeleton], skeleton, "left/")
    own = [f"left/{skeleton.body_id}_{name}" for name in JOINTS]
    assert [t.child_frame_id for t in transforms] == ["left/" + name for name in JOINTS] + own
    t = transforms[4].transform
    assert [t.translation.x, t.translation.y, t.translation.z] == skeleton.positions[4].tolist()
    assert t.rotation.w == skeleton.quats_xyzw[4, 3]
    assert not tf.skeletons_to_transforms([], Skeleton.lost(1, "optical"))


def test_motion_and_boxes_cross_at_once(skeleton):
    """Numbers of all joints are one array each, which a message takes without a look at every number."""
    sent = skeleton_msg(skeleton)
    assert sent.tracking == SkeletonMsg.TRACKING_TRACKED
    wrist = JointMsg.LEFT_WRIST
    assert sent.joints[wrist].name == JOINTS[wrist] == "left_wrist"
    np.testing.assert_array_equal(
        sent.joint_velocities[3 * wrist : 3 * wrist + 3], skeleton["left_wrist"].velocity
    )
    xx, xy, xz, yy, yz, zz = sent.joint_covariances[6 * wrist : 6 * wrist + 6]
    np.testing.assert_array_equal(
        [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], skeleton["left_wrist"].covariance
    )
    for place, known in ((sent.centre, skeleton.centre), (sent.velocity, skeleton.velocity),
                         (sent.box_min, skeleton.box[0]), (sent.box_max, skeleton.box[1])):  # fmt: skip
        assert [place.x, place.y, place.z] == known.tolist()
    assert msg_to_skeleton(sent) == skeleton
    lost = skeleton_msg(Skeleton.lost(5, "optical"))
    assert lost.tracking == SkeletonMsg.TRACKING_LOST and not lost.joint_velocities
    assert np.isnan([lost.centre.x, lost.velocity.x, lost.box_min.x]).all()


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("joint_velocities", [0.0] * 56, "has 56 numbers; it is none, or 57"),
        ("joint_covariances", [0.0] * 57, "has 57 numbers; it is none, or 114"),
        ("joint_velocities", [float("nan")] * 57, "has the number nan"),
        ("tracking", 7, "is 7; it is one of 0 to 3"),
    ],
)
def test_odd_motion_is_refused(skeleton, name, value, says):
    message = skeleton_msg(skeleton)
    setattr(message, name, value)
    with pytest.raises(InputError, match=says):
        msg_to_skeleton(message)


def test_every_place_of_a_joint_has_a_constant():
    assert [getattr(JointMsg, name.upper()) for name in JOINTS] == list(range(len(JOINTS)))
