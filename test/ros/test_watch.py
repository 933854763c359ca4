"""What the viewer hears over real DDS: depth with its skeletons, diagnostics, and parameters it sets."""

import threading

import numpy as np
import pytest
import scene
from depth_pose_msgs.msg import SkeletonArray
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from peer import RELIABLE, SENSOR
from rcl_interfaces.srv import SetParameters
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, Image

from depth_pose.io.skeleton_cdr import write_people
from depth_pose.ros.messages.basics import make_header
from depth_pose.ros.tools.watch import Watch
from skeletons import make_skeleton

IMAGE, INFO = "/camera/depth/image_raw", "/camera/depth/camera_info"
STAMP = 5_000_000_000


def skeleton(stamp_ns, body_id="body_1"):
    rng = np.random.default_rng(0)
    return make_skeleton(
        rng.normal(size=(19, 3)), stamp_ns=stamp_ns, body_id=body_id, confidence=0.75,
        joint_confidence=np.full(19, 0.5, np.float32),
    )  # fmt: skip


def image(stamp_ns, depth):
    mm = np.rint(depth * 1000).astype(np.uint16)
    height, width = mm.shape
    return Image(
        header=make_header(stamp_ns, "optical"), height=height, width=width, encoding="16UC1",
        step=2 * width, data=mm.tobytes(),
    )  # fmt: skip


def info(stamp_ns, camera):
    k = [camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0]
    size = {"height": camera.height, "width": camera.width}
    return CameraInfo(header=make_header(stamp_ns, "optical"), k=k, **size)


@pytest.fixture
def watch(domain):
    watch = Watch(IMAGE)
    watch.start()
    yield watch
    watch.stop()


def test_depth_is_shown_with_the_skeletons_of_its_stamp(watch, peer):
    images = peer.node.create_publisher(Image, IMAGE, SENSOR)
    infos = peer.publisher(CameraInfo, INFO)
    people = peer.publisher(SkeletonArray, "/depth_pose/skeletons", RELIABLE)
    peer.until(lambda: images.get_subscription_count() > 0)
    peer.spin(0.3)
    heard = []

    def ask(*send):
        """Send until there is something to show; gives it."""
        peer.ask(
            lambda: [call() for call in send],
            lambda: heard.append(watch.newest()) or heard[-1] is not None,
            what="something to show",
        )
        return heard[-1]

    for i in range(3):
        stamp = STAMP + i * 40_000_000
        depth = np.full((scene.CAMERA.height, scene.CAMERA.width), 2.0 + i, np.float32)
        message, here = image(stamp, depth), info(STAMP, scene.CAMERA)
        if i == 0:
            bare = ask(lambda here=here: infos.publish(here), lambda message=message: images.publish(message))
            assert bare.skeletons is None
        else:
            images.publish(message)
            peer.spin(0.1)
            assert watch.newest() is None, "once there are skeletons, depth waits for them"
        answer = write_people([skeleton(stamp)], stamp, "optical")
        # (the image again, for it may have been lost)
        shown = ask(
            lambda message=message: images.publish(message), lambda answer=answer: people.publish(answer)
        )
        assert shown.frame.stamp_ns == stamp
        assert shown.frame.depth[3, 4] == pytest.approx(2.0 + i)
        (found,) = shown.skeletons
        np.testing.assert_array_equal(found.positions, skeleton(stamp).positions)
    late = STAMP + 3_000_000_000
    message = image(late, depth)
    bare = ask(lambda: images.publish(message))
    assert bare.skeletons is None, "depth that nobody answers is shown bare"


@pytest.mark.parametrize("qos", [RELIABLE, SENSOR], ids=["reliable", "best effort"])
def test_it_listens_as_the_driver_sends(watch, peer, qos):
    """A reliable driver sends again what a best-effort subscriber would lose."""
    images = peer.node.create_publisher(Image, IMAGE, qos)
    infos = peer.node.create_publisher(CameraInfo, INFO, qos)
    people = peer.node.create_publisher(SkeletonArray, "/depth_pose/skeletons", qos)

    def asked(topic):
        return [s.qos_profile.reliability for s in peer.node.get_subscriptions_info_by_topic(topic)]

    for publisher in (images, infos, people):
        topic = publisher.topic_name
        peer.until(lambda t=topic: asked(t) == [qos.reliability], what=lambda t=topic: f"{t}: {asked(t)}")


def test_what_nodes_tell_is_kept(watch, peer):
    told = peer.publisher(DiagnosticArray, "/diagnostics", RELIABLE)
    values = [KeyValue(key="rate_hz", value="24.0"), KeyValue(key="dropped: queue", value="2")]
    ours = DiagnosticStatus(name="/depth_pose/refine", hardware_id="depth_pose", message="ok", values=values)
    others = DiagnosticStatus(name="/camera", hardware_id="camera")
    states = []
    peer.ask(
        lambda: told.publish(DiagnosticArray(status=[ours, others])),
        lambda: states.extend(watch.nodes()) or states,
    )
    (state,) = states
    assert (state.name, state.values["dropped: queue"]) == ("/depth_pose/refine", "2")


def test_choices_become_parameters(watch, peer):
    asked = []

    def answer(request, response):
        (parameter,) = request.parameters
        value = parameter.value.string_value or parameter.value.integer_value
        if not asked or asked[-1] != (parameter.name, value):  # again, where the answer was too late
            asked.append((parameter.name, value))
        from rcl_interfaces.msg import SetParametersResult

        good = parameter.name != "zone"
        response.results = [SetParametersResult(successful=good, reason="" if good else "zone is wrong")]
        return response

    for node in ("denoise", "recovery"):
        peer.node.create_service(SetParameters, f"/depth_pose/{node}/set_parameters", answer)
    said = []

    def choose(name, value):
        for _ in range(10):
            if not (answer := watch.set(name, value)).endswith("does not answer"):
                break
        said.append(answer)

    for name, value in (("follow", "nearest"), ("people", 2), ("zone", "x")):
        thread = threading.Thread(target=choose, args=(name, value))
        thread.start()
        peer.until(lambda t=thread: not t.is_alive())
    assert asked == [("follow", "nearest"), ("segment.most_people", 2), ("zone", "x")]
    assert said == ["", "", "zone is wrong"]


def test_bytes_that_hold_no_stamp_are_left_out():
    watch = Watch(IMAGE)
    watch.take_info(serialize_message(CameraInfo(width=4, height=3, k=[9.0, 0, 2, 0, 9, 1, 0, 0, 1])))
    for data in (b"", b"\x00\x01\x00\x00", b"\x00\x01\x00\x00" + bytes(7)):
        watch.take_depth(data)
        watch.take_skeletons(data)
    assert watch.held == 0
    image = Image(height=3, width=4, encoding="16UC1", step=8, data=bytes(24))
    watch.take_depth(serialize_message(image))
    assert watch.held == 1
