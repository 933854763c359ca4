"""What the viewer hears over real DDS: depth with its skeletons, diagnostics, and parameters it sets."""

import threading

import numpy as np
import pytest
import scene
from depth_pose_msgs.msg import SkeletonArray
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from peer import RELIABLE, SENSOR
from rcl_interfaces.srv import SetParameters
from sensor_msgs.msg import CameraInfo, Image

from depth_pose.core.skeleton import Source
from depth_pose.core.types import Skeleton
from depth_pose.ros.transport.conversions import make_header, skeletons_to_msg
from depth_pose.ros.watch import Watch

IMAGE, INFO = "/camera/depth/image_raw", "/camera/depth/camera_info"
STAMP = 5_000_000_000


def skeleton(stamp_ns, body_id="body_1"):
    rng = np.random.default_rng(0)
    quats = np.tile([0.0, 0, 0, 1], (19, 1))
    sure, states = np.full(19, 0.5, np.float32), np.zeros(19, np.uint8)
    found = (Source.REFINED, 0.75, 0.01, 1.0, rng.normal(size=(19, 3)), quats, sure, states)
    return Skeleton(stamp_ns, "optical", body_id, *found)


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
    infos.publish(info(STAMP, scene.CAMERA))
    peer.spin(0.2)
    heard = []
    for i in range(3):
        stamp = STAMP + i * 40_000_000
        depth = np.full((scene.CAMERA.height, scene.CAMERA.width), 2.0 + i, np.float32)
        images.publish(image(stamp, depth))
        peer.spin(0.1)
        bare = watch.newest()
        assert bare is None if i else bare.skeletons is None, "once there are skeletons, depth waits for them"
        people.publish(skeletons_to_msg([skeleton(stamp)], stamp, "optical"))
        peer.until(lambda: heard.append(watch.newest()) or heard[-1] is not None)
        shown = heard[-1]
        assert shown.frame.stamp_ns == stamp
        assert shown.frame.depth[3, 4] == pytest.approx(2.0 + i)
        (found,) = shown.skeletons
        np.testing.assert_array_equal(found.positions, skeleton(stamp).positions)
    late = STAMP + 3_000_000_000
    images.publish(image(late, depth))
    peer.until(lambda: heard.append(watch.newest()) or heard[-1] is not None)
    assert heard[-1].skeletons is None, "depth that nobody answers is shown bare"


def test_what_nodes_tell_is_kept(watch, peer):
    told = peer.publisher(DiagnosticArray, "/diagnostics", RELIABLE)
    values = [KeyValue(key="rate_hz", value="24.0"), KeyValue(key="dropped: queue", value="2")]
    ours = DiagnosticStatus(name="/depth_pose/refine", hardware_id="depth_pose", message="ok", values=values)
    others = DiagnosticStatus(name="/camera", hardware_id="camera")
    told.publish(DiagnosticArray(status=[ours, others]))
    peer.until(watch.nodes)
    (state,) = watch.nodes()
    assert (state.name, state.values["dropped: queue"]) == ("/depth_pose/refine", "2")


def test_choices_become_parameters(watch, peer):
    asked = []

    def answer(request, response):
        (parameter,) = request.parameters
        asked.append((parameter.name, parameter.value.string_value or parameter.value.integer_value))
        from rcl_interfaces.msg import SetParametersResult

        good = parameter.name != "zone"
        response.results = [SetParametersResult(successful=good, reason="" if good else "zone is wrong")]
        return response

    for node in ("denoise", "recovery"):
        peer.node.create_service(SetParameters, f"/depth_pose/{node}/set_parameters", answer)
    said = []
    for name, value in (("follow", "nearest"), ("people", 2), ("zone", "x")):
        thread = threading.Thread(target=lambda n=name, v=value: said.append(watch.set(n, v)))
        thread.start()
        peer.until(lambda t=thread: not t.is_alive())
    assert asked == [("follow", "nearest"), ("segment.most_people", 2), ("zone", "x")]
    assert said == ["", "", "zone is wrong"]
