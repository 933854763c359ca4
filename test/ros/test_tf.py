"""`/tf`, REP-155's topics, the floor and the labels, from the real nodes over real DDS."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
import scene
from depth_pose_msgs.msg import Packed, SkeletonArray
from geometry_msgs.msg import PoseStamped
from hri_msgs.msg import IdsList, Skeleton2D
from peer import LIMIT_S, RELIABLE
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo, Image, Imu, JointState
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from depth_pose.body.human_model import JOINTS, LINKS
from depth_pose.core.rotations import quat_to_matrix, rotation_x
from depth_pose.core.skeleton import JOINTS as OURS
from depth_pose.pipeline import PosePipeline
from depth_pose.ros.messages.basics import make_header, stamp_to_ns
from depth_pose.ros.messages.fits import fitted_to_msg
from depth_pose.ros.messages.skeletons import msg_to_skeleton
from depth_pose.ros.transport.tf import stamped
from depth_pose.track.label_image import person_number

LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def recovery(start, bank_path, *parameters):
    arguments = [a for p in (f"bank:={bank_path}", *parameters) for a in ("-p", p)]
    process = start("-m", "depth_pose.ros.nodes.recovery_node", "--ros-args", *arguments)
    process.wait_for("is ready")
    return process


@pytest.fixture(scope="module")
def fitted(bank):
    """The people of some frames, and the bodies fitted to them."""
    pipeline = PosePipeline(bank)
    out = []
    for frame in scene.frames(6):
        people = pipeline.perception.perceive(frame)
        out.append((people, pipeline.refiner.refine(people, pipeline.matcher.match(people))))
    return out


class Inputs:
    """Publishes what the recovery node listens to."""

    def __init__(self, peer):
        self.peer, self.rounds = peer, 0
        self._out = peer.publisher(Packed, "/depth_pose/skeletons_refined")

    def send(self, people, fitted):
        self._out.publish(fitted_to_msg(fitted, people))

    def play(self, fitted):
        """Send frames; each time it is called a little later, as a recording that goes on."""
        for people, bodies in later(fitted, self.rounds * len(fitted) * scene.STEP_NS):
            self.send(people, bodies)
            self.peer.spin(0.1)
            self.newest_ns = people.stamp_ns
        self.rounds += 1


def by_child(message):
    return {t.child_frame_id: t for t in message.transforms}


def matrix(transform):
    t, q = transform.transform.translation, transform.transform.rotation
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = quat_to_matrix(np.array([q.x, q.y, q.z, q.w])), (t.x, t.y, t.z)
    return T


def answers(peer, inputs, fitted, kind, topic, qos=RELIABLE, holds=bool):
    """Send frames until something is heard."""
    heard = peer.listen(kind, topic, qos)
    peer.spin(0.3)
    if not fitted:
        peer.until(lambda: heard, what=topic)
        return heard
    peer.ask(lambda: inputs.play(fitted), lambda: heard and holds(heard), what=topic, every_s=0.2)
    return heard


def test_every_joint_on_tf(start, bank_path, peer, fitted):
    recovery(start, bank_path, "tf:=true", "tf_prefix:=left_")
    skeletons = peer.listen(SkeletonArray, "/depth_pose/skeletons", RELIABLE)
    told = answers(peer, Inputs(peer), fitted, TFMessage, "/tf", holds=lambda h: any(m.transforms for m in h))
    message = next(m for m in reversed(told) if m.transforms)
    first = message.transforms[0]
    peer.until(lambda: any(m.header.stamp == first.header.stamp for m in skeletons), what="its skeletons")
    people = {stamp_to_ns(m.header.stamp): m.skeletons for m in skeletons}
    skeleton = msg_to_skeleton(people[stamp_to_ns(first.header.stamp)][0])
    found = by_child(message)
    assert set(found) == {f"left_{n}" for n in OURS} | {f"left_{skeleton.body_id}_{n}" for n in OURS}
    assert {t.header.frame_id for t in message.transforms} == {"optical"}
    wrist = matrix(found[f"left_{skeleton.body_id}_left_wrist"])
    assert np.array_equal(wrist[:3, 3], skeleton.positions[OURS.index("left_wrist")])


def test_rep_155(start, bank_path, peer, fitted):
    process = recovery(start, bank_path, "rep155:=true", "tf_prefix:=a_")
    inputs = Inputs(peer)
    skeletons = peer.listen(SkeletonArray, "/depth_pose/skeletons", RELIABLE)
    tf = peer.listen(TFMessage, "/tf", RELIABLE)
    somebody = lambda heard: any(m.ids for m in heard) and skeletons and skeletons[-1].skeletons  # noqa: E731
    tracked = answers(peer, inputs, fitted, IdsList, "/humans/bodies/tracked", holds=somebody)
    (body_id,) = next(m.ids for m in reversed(tracked) if m.ids)
    number = skeletons[-1].skeletons[0].body_id.removeprefix("body_")
    assert body_id == f"a_b{number}", "frames are body_ID: not body_body_1"
    root = f"/humans/bodies/{body_id}"
    states = peer.listen(JointState, f"{root}/joint_states", RELIABLE)
    points = answers(peer, inputs, fitted, Skeleton2D, f"{root}/skeleton2d", holds=lambda _: states)
    (urdf,) = answers(peer, inputs, [], String, f"{root}/urdf", LATCHED)

    robot = ElementTree.fromstring(urdf.data)
    turning = {j.get("name") for j in robot.iter("joint") if j.get("type") == "revolute"}
    assert set(states[-1].name) == turning == {f"{n}_{body_id}" for n in JOINTS}
    assert np.isfinite(states[-1].position).all() and len(states[-1].position) == len(JOINTS)

    frames = by_child(next(m for m in reversed(tf) if m.transforms))
    assert set(frames) == {f"{n}_{body_id}" for n in LINKS}
    parents = {child: t.header.frame_id for child, t in frames.items()}
    assert parents.pop(f"body_{body_id}") == "optical" and set(parents.values()) == {f"body_{body_id}"}

    message = points[-1]
    stamp = message.header.stamp
    peer.until(lambda: any(m.header.stamp == stamp for m in skeletons), what="its skeletons")
    skeleton = next(m for m in skeletons if m.header.stamp == stamp).skeletons[0]
    neck = next(j.position for j in skeleton.joints if j.name == "neck")
    u, v = scene.CAMERA.project(np.array([neck.x, neck.y, neck.z]))
    got = message.skeleton[Skeleton2D.NECK]
    assert (
        abs(got.x * scene.CAMERA.width - 0.5 - u) < 0.01 and abs(got.y * scene.CAMERA.height - 0.5 - v) < 0.01
    )
    assert message.skeleton[Skeleton2D.LEFT_EYE].c == 0.0 < got.c

    people, _ = fitted[-1]
    peer.ask(
        lambda: inputs.play(fitted),
        lambda: stamp_to_ns(tracked[-1].header.stamp) == inputs.newest_ns,
        what="an answer to the last that was sent",
    )
    away = replace(people, stamp_ns=stamp_to_ns(tracked[-1].header.stamp) + 200_000_000, persons=())
    peer.ask(
        lambda: inputs.send(away, ()),
        lambda: stamp_to_ns(tracked[-1].header.stamp) == away.stamp_ns,
        what="a frame without them",
    )
    assert list(tracked[-1].ids) == [body_id], "who is gone for a moment stays in the list"
    peer.until(lambda: stamp_to_ns(skeletons[-1].header.stamp) == away.stamp_ns, what="its skeletons")
    assert not skeletons[-1].skeletons

    gone = replace(people, stamp_ns=away.stamp_ns + 5_000_000_000, persons=())
    peer.ask(lambda: inputs.send(gone, ()), lambda: not tracked[-1].ids, what="a frame without anybody")
    peer.until(lambda: not peer.node.count_publishers(f"{root}/joint_states"), what="the end of the topics")
    assert (tracked[-1].header.frame_id, stamp_to_ns(tracked[-1].header.stamp)) == ("optical", gone.stamp_ns)
    assert "Traceback" not in process.output


def test_people_as_messages_of_other_packages(start, bank_path, peer, fitted):
    """What arrives is the skeletons' boxes, centres and velocities."""
    where = "comes with ROS 2 from apt"
    vision = pytest.importorskip("vision_msgs.msg", reason=f"vision_msgs {where}")
    social = pytest.importorskip("people_msgs.msg", reason=f"people_msgs {where}")
    process = recovery(start, bank_path, "vision_msgs:=true", "people_msgs:=true")
    skeletons = peer.listen(SkeletonArray, "/depth_pose/skeletons", RELIABLE)
    people = peer.listen(social.People, "/people", RELIABLE)
    somebody = lambda heard: any(m.detections for m in heard) and any(m.people for m in people)  # noqa: E731
    topic = "/depth_pose/detections"
    found = answers(peer, Inputs(peer), fitted, vision.Detection3DArray, topic, holds=somebody)
    peer.spin(1.0)
    at = {stamp_to_ns(m.header.stamp): [msg_to_skeleton(s) for s in m.skeletons] for m in skeletons}
    for message in found:
        for box, person in zip(message.detections, at[stamp_to_ns(message.header.stamp)], strict=True):
            low, high = person.box
            np.testing.assert_allclose(xyz(box.bbox.center.position), 0.5 * (low + high), atol=1e-5)
            np.testing.assert_allclose(xyz(box.bbox.size), high - low, atol=1e-5)
            (result,) = box.results
            assert (box.id, result.hypothesis.class_id) == (person.body_id, "person")
            assert result.hypothesis.score == pytest.approx(person.confidence)
    for message in people:
        for one, person in zip(message.people, at[stamp_to_ns(message.header.stamp)], strict=True):
            assert (one.name, one.reliability) == (person.body_id, pytest.approx(person.confidence))
            np.testing.assert_allclose(xyz(one.position), person.centre, atol=1e-5)
            np.testing.assert_allclose(xyz(one.velocity), np.nan_to_num(person.velocity), atol=1e-4)
    assert "Traceback" not in process.output


def xyz(point):
    return [point.x, point.y, point.z]


def later(fitted, by_ns):
    """The same frames at later times."""
    out = []
    for people, bodies in fitted:
        stamp = people.stamp_ns + by_ns
        persons = tuple(replace(p, stamp_ns=stamp) for p in people.persons)
        moved = tuple(replace(f, stamp_ns=stamp) for f in bodies)
        out.append((replace(people, stamp_ns=stamp, persons=persons), moved))
    return out


def test_rep_155_refuses_a_prefix_that_is_no_name(start, bank_path):
    arguments = ("-p", "rep155:=true", "-p", "tf_prefix:=left/", "-p", f"bank:={bank_path}")
    process = start("-m", "depth_pose.ros.nodes.recovery_node", "--ros-args", *arguments)
    assert process.process.wait(LIMIT_S) == 2
    assert "letters, digits and _" in process.output


@pytest.mark.parametrize(
    ("parameter", "package"),
    [
        ("tf", "tf2-msgs"),
        ("rep155", "hri-msgs"),
        ("vision_msgs", "vision-msgs"),
        ("people_msgs", "people-msgs"),
    ],
)
def test_what_is_missing_is_said(start, bank_path, parameter, package):
    """As where ROS came from apt without the package: Python does not find it."""
    code = (
        f"import sys; sys.modules['{package.replace('-', '_')}'] = None; "
        "from depth_pose.ros.nodes.recovery_node import main; sys.exit(main())"
    )
    process = start("-c", code, "--ros-args", "-p", f"{parameter}:=true", "-p", f"bank:={bank_path}")
    assert process.process.wait(LIMIT_S) == 2
    assert f"ros-jazzy-{package}" in process.output and "Traceback" not in process.output


def camera_info():
    c = scene.CAMERA
    k = [c.fx, 0.0, c.cx, 0.0, c.fy, c.cy, 0.0, 0.0, 1.0]
    return CameraInfo(width=c.width, height=c.height, k=k, distortion_model="plumb_bob", d=[0.0] * 5)


def image_of(frame, depth):
    height, width = depth.shape
    return Image(
        header=make_header(frame.stamp_ns, "optical"),
        height=height,
        width=width,
        encoding="32FC1",
        step=4 * width,
        data=depth.astype("<f4").tobytes(),
    )


def on_a_floor(frame, height=0.9):
    """The same view with a level floor below the camera."""
    c = frame.camera
    slope = (np.arange(c.height) - c.cy) / c.fy
    with np.errstate(divide="ignore"):
        floor = np.where(slope > 0, height / slope, np.inf)[:, None]
    return np.minimum(frame.depth, floor).astype(np.float32)


def test_a_roll_that_one_node_alone_is_told_of(start, bank_path, peer, fitted):
    """Turning back what was never turned would be wrong; the frame is dropped, with what to do."""
    process = recovery(start, bank_path, "mount.roll:=180.0")
    skeletons = peer.listen(SkeletonArray, "/depth_pose/skeletons")
    inputs = Inputs(peer)
    peer.ask(
        lambda: inputs.send(*fitted[-1]), lambda: "set it for all nodes" in process.output, what="its word"
    )
    assert "dropped, bad input" in process.output and not skeletons


@pytest.mark.parametrize("roll", [0.0, 180.0])
def test_floor_and_labels(start, peer, roll):
    process = start(
        *("-m", "depth_pose.ros.nodes.denoise_node", "--ros-args"),
        *("-p", "tf:=true", "-p", f"mount.roll:={roll}"),
    )
    process.wait_for("is ready")
    images = peer.publisher(Image, "/camera/depth/image_raw")
    infos = peer.publisher(CameraInfo, "/camera/depth/camera_info")
    labels = peer.listen(Image, "/depth_pose/labels", RELIABLE)
    statics = peer.listen(TFMessage, "/tf_static", LATCHED)
    floors = peer.listen(PoseStamped, "/depth_pose/floor", LATCHED)
    peer.spin(0.5)
    frames = list(scene.frames(4))
    sent = []

    def show():
        infos.publish(camera_info())
        for frame in frames:  # a recording that goes on
            sent.append(replace(frame, stamp_ns=scene.START_NS + len(sent) * scene.STEP_NS))
            depth = on_a_floor(frame)
            images.publish(image_of(sent[-1], depth[::-1, ::-1] if roll else depth))
            peer.spin(0.2)

    wanted = {"floor", *(["optical_upright"] if roll else [])}
    peer.ask(
        show,
        lambda: labels and floors and statics and set(by_child(statics[-1])) == wanted,
        what=lambda: f"labels and floor: {process.output}",
        every_s=0.2,
    )

    frame = next(f for f in sent if f.stamp_ns == stamp_to_ns(labels[-1].header.stamp))
    assert (labels[-1].encoding, labels[-1].header.frame_id) == ("mono8", "optical")
    got = np.frombuffer(labels[-1].data, np.uint8).reshape(labels[-1].height, labels[-1].width)
    got = got[::-1, ::-1] if roll else got
    person = frame.depth < 4.0
    assert set(np.unique(got)) == {0, 1}  # body_1
    overlap = ((got == 1) & person).sum() / ((got == 1) | person).sum()
    assert overlap > 0.85

    known = by_child(statics[-1])
    T = matrix(known["floor"])
    up = -1.0 if not roll else 1.0
    assert known["floor"].header.frame_id == floors[-1].header.frame_id == "optical"
    assert np.allclose(T[:3, 2], [0, up, 0], atol=0.03)  # z is up
    assert np.allclose(T[:3, 3], [0, -0.9 * up, 0], atol=0.05)  # on the floor, below the sensor
    assert T[2, 0] > 0.99  # x is where the sensor looks
    place = floors[-1].pose.position
    assert np.allclose([place.x, place.y, place.z], T[:3, 3])
    if roll:
        assert np.allclose(matrix(known["optical_upright"])[:3, :3], np.diag([-1.0, -1.0, 1.0]))


@pytest.fixture
def ceiling(start, peer):
    """A denoise node that asks an IMU for up, and its sensor 2.4 m above a floor."""
    process = start(
        *("-m", "depth_pose.ros.nodes.denoise_node", "--ros-args", "-p", "tf:=true"),
        *("-p", "imu_topic:=/camera/imu"),
    )
    process.wait_for("is ready")
    images = peer.publisher(Image, "/camera/depth/image_raw")
    infos = peer.publisher(CameraInfo, "/camera/depth/camera_info")
    imu = peer.publisher(Imu, "/camera/imu")
    transforms = peer.publisher(TFMessage, "/tf_static", LATCHED)
    peer.spin(0.5)
    T = np.eye(4)
    T[:3, :3] = rotation_x(np.pi / 2)  # the IMU's y axis is the sensor's z axis
    transforms.publish(TFMessage(transforms=[stamped(1, "optical", "imu", T)]))
    sent = []

    def show(*push):
        infos.publish(camera_info())
        frame = next(iter(scene.frames(1)))
        sent.append(replace(frame, stamp_ns=scene.START_NS + len(sent) * scene.STEP_NS))
        images.publish(image_of(sent[-1], np.full_like(frame.depth, 2.4)))
        for _ in range(4):
            reading = Imu(header=make_header(sent[-1].stamp_ns, "imu"))
            a = reading.linear_acceleration
            a.x, a.y, a.z = push
            imu.publish(reading)
            peer.spin(0.05)

    return process, show


def test_an_imu_tells_the_floor_below_a_ceiling(ceiling, peer):
    process, show = ceiling
    floors = peer.listen(PoseStamped, "/depth_pose/floor", LATCHED)
    up = (0.0, -9.8, 0.0)  # towards the sensor
    peer.ask(lambda: show(*up), lambda: floors, what=lambda: f"a floor: {process.output}", every_s=0.05)
    assert np.allclose(floors[-1].pose.position.z, 2.4, atol=0.02)


def test_an_imu_tells_of_a_wrong_roll(ceiling, peer):
    process, show = ceiling
    hanging = (0.0, 0.0, -9.8)  # up is the sensor's y axis, the lower border of its images
    peer.ask(lambda: show(*hanging), lambda: "set mount.roll: 180" in process.output, what="its word")


def test_numbers_of_people():
    assert [person_number(f"body_{n}") for n in (1, 7, 254, 255)] == [1, 7, 254, 1]
