"""The denoise node as users run it: real frames, and everything that may be wrong with them."""

import io
import itertools
import re
import struct
import threading
from dataclasses import replace

import numpy as np
import pytest
import scene
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from peer import RELIABLE, SENSOR
from PIL import Image as PngImage
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2, PointField

from depth_pose.core.camera import Camera
from depth_pose.core.config import DenoiseConfig, SegmentConfig
from depth_pose.core.labels import PERSON
from depth_pose.detect.sample_frame import sample_frame
from depth_pose.perception import Perception
from depth_pose.ros.messages.basics import make_header, ns_to_stamp, stamp_to_ns
from depth_pose.ros.messages.frames import image_to_frame, msg_to_frame
from depth_pose.ros.messages.people import POINT_DTYPE
from depth_pose.ros.tools.bag import play

IMAGE, INFO, POINTS = "/camera/depth/image_raw", "/camera/depth/camera_info", "/depth_pose/points"


def image_msg(frame, encoding="16UC1"):
    height, width = frame.depth.shape
    pixels = np.round(frame.depth * 1000).astype("<u2") if encoding == "16UC1" else frame.depth
    return Image(
        header=make_header(frame.stamp_ns, frame.frame_id),
        height=height,
        width=width,
        encoding=encoding,
        step=width * pixels.itemsize,
        data=pixels.tobytes(),
    )


def info_msg(frame):
    c = frame.camera
    return CameraInfo(
        header=make_header(frame.stamp_ns, frame.frame_id),
        width=c.width,
        height=c.height,
        k=[c.fx, 0.0, c.cx, 0.0, c.fy, c.cy, 0.0, 0.0, 1.0],
        distortion_model="plumb_bob",
        d=[0.0] * 5,
    )


@pytest.fixture(scope="module")
def frames():
    return list(scene.frames(12))


def labels_of(msg):
    return np.frombuffer(msg.data, POINT_DTYPE)["label"].reshape(msg.height, msg.width)


def points_of(msg):
    packed = np.frombuffer(msg.data, POINT_DTYPE).reshape(msg.height, msg.width)
    return np.stack([packed[axis] for axis in "xyz"], axis=-1)


def assert_same_cloud(msg, people):
    assert (stamp_to_ns(msg.header.stamp), msg.header.frame_id) == (people.stamp_ns, people.frame_id)
    assert points_of(msg).tobytes() == people.points.tobytes()
    assert labels_of(msg).tobytes() == people.labels.tobytes()


def at(message, stamp_ns):
    """The same with another stamp."""
    message.header.stamp = ns_to_stamp(stamp_ns)
    return message


def answer_to(peer, answers, send, stamp_ns, process):
    """Send until there is an answer of a stamp; gives it."""

    def found():
        return [m for m in answers if stamp_to_ns(m.header.stamp) == stamp_ns]

    peer.ask(send, found, what=lambda: f"an answer to {stamp_ns}:\n{process.output}\nit")
    return found()[0]


def test_bad_frames_are_counted_and_good_ones_answered(start, peer, frames):
    process = start("-m", "depth_pose.ros.nodes.denoise_node")
    process.wait_for("is ready")
    answers = peer.listen(PointCloud2, POINTS)
    told = peer.listen(DiagnosticArray, "/diagnostics", RELIABLE)
    images = peer.publisher(Image, IMAGE)
    start_ns, sent = frames[0].stamp_ns, 0

    def bad_inputs():
        return int({v.key: v.value for v in told[-1].status[0].values}.get("dropped: bad input", 0))

    while "dropped, no CameraInfo" not in process.output:  # the last one waits for it
        assert sent < 1000, process.output
        images.publish(at(image_msg(frames[sent % 2]), start_ns + 40_000_000 * sent))
        peer.spin(0.1)
        sent += 1
    infos = peer.publisher(CameraInfo, INFO)
    peer.ask(lambda: infos.publish(info_msg(frames[1])), lambda: answers, what="the frame that waited")
    held_ns = stamp_to_ns(answers[0].header.stamp)
    held = (held_ns - start_ns) // 40_000_000
    perception = Perception(SegmentConfig(), DenoiseConfig())
    message = at(image_msg(frames[held % 2]), held_ns)
    expected = perception.perceive(image_to_frame(message, info_msg(frames[1])))
    assert np.count_nonzero(expected.labels == PERSON) > 300
    assert_same_cloud(answers[0], expected)

    def spoilt(i, **changes):
        msg = image_msg(frames[i])
        for name, value in changes.items():
            setattr(msg, name, value)
        return msg

    short = image_msg(frames[2])
    short.data = bytes(short.data)[:-10]
    stamps = itertools.count(start_ns + 40_000_000 * sent, 1_000_000)
    peer.until(lambda: told, what="diagnostics")
    for bad in (
        spoilt(2, encoding="bgr8"),
        spoilt(3, width=0, height=0, data=b""),
        short,
        spoilt(4, step=1),
        spoilt(5, height=7),
    ):
        before = bad_inputs()
        peer.ask(
            lambda bad=bad: images.publish(at(bad, next(stamps))),
            lambda before=before: bad_inputs() > before,
            what=lambda: f"the drop:\n{process.output}\nit",
            every_s=3.0,
        )
    process.wait_for("dropped, bad input")
    wrong = info_msg(frames[6])
    wrong.k = [np.nan] * 9

    def show_with_wrong_info():
        infos.publish(wrong)
        peer.spin(0.1)
        images.publish(at(image_msg(frames[6]), next(stamps)))

    before = bad_inputs()
    peer.ask(show_with_wrong_info, lambda: bad_inputs() > before, what="the drop for the wrong info")
    stamp_ns = next(stamps)
    nothing = at(image_msg(frames[7], "32FC1"), stamp_ns)
    nothing.data = np.full(frames[7].depth.shape, np.nan, "<f4").tobytes()

    def show_nothing():
        infos.publish(info_msg(frames[7]))
        peer.spin(0.1)
        images.publish(nothing)

    empty = answer_to(peer, answers, show_nothing, stamp_ns, process)
    assert not (labels_of(empty) == PERSON).any()
    stamp_ns = next(stamps)
    again = at(image_msg(frames[8], "32FC1"), stamp_ns)
    answer_to(peer, answers, lambda: images.publish(again), stamp_ns, process)
    answers.clear()
    first, older = image_msg(frames[0]), itertools.count(start_ns - 10_000_000_000, 40_000_000)
    peer.ask(lambda: images.publish(at(first, next(older))), lambda: answers, what="an answer back in time")
    back = at(first, stamp_to_ns(answers[0].header.stamp))
    assert stamp_to_ns(back.header.stamp) > start_ns - 10_000_000_000  # the first one is not believed yet
    perception = Perception(SegmentConfig(), DenoiseConfig())
    assert_same_cloud(answers[0], perception.perceive(image_to_frame(back, info_msg(frames[0]))))
    assert process.process.poll() is None


@pytest.mark.parametrize("organised", [True, False])
def test_clouds_are_taken(start, peer, frames, organised):
    process = start("-m", "depth_pose.ros.nodes.denoise_node", "--ros-args", "-p", "cloud_topic:=/cloud")
    process.wait_for("is ready")
    answers = peer.listen(PointCloud2, POINTS)
    clouds = peer.publisher(PointCloud2, "/cloud")
    peer.spin(0.2)
    frame = frames[0]
    c = frame.camera
    v, u = np.mgrid[: c.height, : c.width]
    z = frame.depth.astype(np.float64)
    points = np.stack([(u - c.cx) / c.fx * z, (v - c.cy) / c.fy * z, z], axis=-1).astype("<f4")
    if not organised:
        points = points[z > 0][None]
    height, width = points.shape[:2]
    msg = PointCloud2(
        header=make_header(frame.stamp_ns, "optical"),
        height=height,
        width=width,
        point_step=12,
        row_step=12 * width,
        fields=[
            PointField(name=n, offset=4 * i, datatype=PointField.FLOAT32, count=1)
            for i, n in enumerate("xyz")
        ],
        data=points.tobytes(),
    )
    peer.ask(lambda: clouds.publish(msg), lambda: answers, what="the answer")
    perception = Perception(SegmentConfig(), DenoiseConfig())
    assert_same_cloud(answers[0], perception.perceive(msg_to_frame(msg)))
    person = points_of(answers[0])
    assert np.nanmedian(person[..., 2]) == pytest.approx(3.2, abs=0.3)


@pytest.mark.parametrize("kept", [False, True], ids=["volatile", "kept"])
def test_camera_info_is_asked_for_with_a_qos_that_the_driver_has(start, peer, frames, kept):
    """One subscription, and none that is incompatible: neither the driver nor `ros2 doctor` complains.

    What a driver keeps it sends once, here before the node is there.
    """
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    qos = QoSProfile(
        depth=1,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if kept else DurabilityPolicy.VOLATILE,
        reliability=ReliabilityPolicy.RELIABLE if kept else ReliabilityPolicy.BEST_EFFORT,
    )
    infos = peer.node.create_publisher(CameraInfo, INFO, qos)
    infos.publish(info_msg(frames[0]))
    process = start("-m", "depth_pose.ros.nodes.denoise_node")
    process.wait_for("is ready")

    def asked():
        found = [s.qos_profile for s in peer.node.get_subscriptions_info_by_topic(INFO)]
        return [(q.durability, q.reliability) for q in found]

    # it asks anew once it knows what the driver has
    peer.until(lambda: asked() == [(qos.durability, qos.reliability)], what=lambda: f"{asked()}: the QoS")
    peer.spin(1.5)
    assert len(asked()) == 1
    answers = peer.listen(PointCloud2, POINTS)
    images = peer.publisher(Image, IMAGE, RELIABLE)

    def show():
        if not kept:
            infos.publish(info_msg(frames[0]))
        images.publish(image_msg(frames[0]))

    peer.ask(show, lambda: answers, what="the answer")


def test_mount_is_refused_for_one_node_alone(start, peer):
    process = start("-m", "depth_pose.ros.nodes.denoise_node")
    process.wait_for("is ready")
    result = peer.put("/depth_pose/denoise", "mount.roll", 90.0)
    assert not result.successful and "read-only" in result.reason


def test_latency_by_the_clock_of_a_recording(start, peer, frames, tmp_path):
    """Stamps of years ago give no latency, but with ``use_sim_time`` and ``/clock`` they do."""
    path = scene.write_recording(tmp_path / "small.mcap", 40)
    process = start("-m", "depth_pose.ros.nodes.denoise_node", "--ros-args", "-p", "use_sim_time:=true")
    process.wait_for("is ready")
    statuses = peer.listen(DiagnosticArray, "/diagnostics", RELIABLE)
    thread = threading.Thread(
        target=play, args=(path,), kwargs={"wait_for_subscribers": [IMAGE, INFO], "wait_s": 60.0}
    )
    thread.start()

    def known():
        values = {v.key: v.value for s in statuses for v in s.status[0].values}
        return values.get("latency_ms_p95", "unknown") != "unknown" and values

    peer.until(known, what="a latency")
    assert float(known()["latency_ms_p95"]) < 60_000.0
    thread.join(60.0)


@pytest.mark.parametrize(
    ("topic", "format", "header"),
    [
        (f"{IMAGE}/compressedDepth", "16UC1; compressedDepth png", struct.pack("<iff", 0, 0.0, 0.0)),
        ("/camera/packed", "16UC1; png compressed ", b""),
    ],
    ids=["usual", "renamed"],
)
def test_compressed_depth_gives_the_same_cloud(start, peer, frames, topic, format, header):
    """Of any name: what the publisher sends tells, even if it begins after the node."""
    process = start("-m", "depth_pose.ros.nodes.denoise_node", "--ros-args", "-p", f"image_topic:={topic}")
    process.wait_for("is ready")
    clouds = peer.listen(PointCloud2, POINTS)
    infos = peer.publisher(CameraInfo, INFO)
    images = peer.node.create_publisher(CompressedImage, topic, SENSOR)
    peer.until(lambda: peer.node.count_publishers(POINTS), what="the node's output")
    packed = io.BytesIO()
    PngImage.fromarray(np.round(frames[0].depth * 1000).astype(np.uint16)).save(packed, "PNG")
    image = CompressedImage(header=make_header(frames[0].stamp_ns, frames[0].frame_id), format=format)
    image.data = header + packed.getvalue()

    def show():
        infos.publish(info_msg(frames[0]))
        peer.spin(0.3)
        images.publish(image)

    peer.ask(show, lambda: clouds, what="the cloud")
    assert_same_cloud(clouds[0], Perception(SegmentConfig(), DenoiseConfig()).perceive(frames[0]))


def test_the_info_of_another_camera_is_not_used(start, peer, frames):
    process = start("-m", "depth_pose.ros.nodes.denoise_node")
    process.wait_for("is ready")
    answers = peer.listen(PointCloud2, POINTS)
    told = peer.listen(DiagnosticArray, "/diagnostics", RELIABLE)
    images, infos = peer.publisher(Image, IMAGE), peer.publisher(CameraInfo, INFO)
    frame = frames[0]
    other = info_msg(frame)
    other.header.frame_id = "colour"
    other.k = [1.3 * k if i in (0, 4) else k for i, k in enumerate(other.k)]
    stamps = itertools.count(frame.stamp_ns, 40_000_000)

    def send():
        infos.publish(info_msg(frame))
        infos.publish(other)
        peer.spin(0.1)
        images.publish(at(image_msg(frame), next(stamps)))

    peer.ask(send, lambda: len(answers) >= 3, what=lambda: f"answers:\n{process.output}\nthey")
    expected = Perception(SegmentConfig(), DenoiseConfig()).perceive(
        image_to_frame(image_msg(frame), info_msg(frame))
    )
    span = np.ptp(expected.points[expected.labels == PERSON], axis=0)[:2]
    for answer in answers:  # the other camera's would be 1.3 times smaller
        assert np.allclose(
            np.ptp(points_of(answer)[labels_of(answer) == PERSON], axis=0)[:2], span, atol=0.03
        )
    process.wait_for("of another camera ignored ('colour')")
    counts = {v.key: v.value for v in told[-1].status[0].values} if told else {}
    peer.until(
        lambda: (
            told
            and int(
                {v.key: v.value for v in told[-1].status[0].values}.get("CameraInfo of another camera", 0)
            )
            >= 3
        ),
        what=lambda: f"the count in diagnostics ({counts})",
    )
    assert process.output.count("of another camera ignored") == 1


def warning(told):
    """What diagnostics warn of now."""
    status = told[-1].status[0] if told else DiagnosticStatus()
    return status.message if status.level == DiagnosticStatus.WARN else ""


def test_images_that_are_upside_down_are_said(start, peer):
    process = start("-m", "depth_pose.ros.nodes.denoise_node")
    process.wait_for("is ready")
    told = peer.listen(DiagnosticArray, "/diagnostics", RELIABLE)
    images, infos = peer.publisher(Image, IMAGE), peer.publisher(CameraInfo, INFO)
    frame = sample_frame()
    frame = replace(frame, depth=np.ascontiguousarray(frame.depth[::-1, ::-1]))
    stamps = itertools.count(1, 1_100_000_000)

    def send():
        infos.publish(info_msg(frame))
        peer.spin(0.1)
        images.publish(at(image_msg(frame), next(stamps)))

    peer.ask(send, lambda: "upside down" in warning(told), what=lambda: process.output, every_s=0.2)
    process.wait_for("mount.roll: 180 is for a sensor that hangs so")
    assert process.output.count("upside down") == 1


def test_a_sparse_grid_is_said_and_its_person_found(start, peer):
    process = start("-m", "depth_pose.ros.nodes.denoise_node")
    process.wait_for("is ready")
    answers = peer.listen(PointCloud2, POINTS)
    told = peer.listen(DiagnosticArray, "/diagnostics", RELIABLE)
    images, infos = peer.publisher(Image, IMAGE), peer.publisher(CameraInfo, INFO)
    frame = sample_frame()
    c, depth = frame.camera, np.zeros((2 * frame.camera.height, 2 * frame.camera.width), np.float32)
    depth[::2, ::2] = frame.depth
    camera = Camera(2 * c.width, 2 * c.height, 2 * c.fx, 2 * c.fy, 2 * c.cx, 2 * c.cy)
    frame = replace(frame, depth=depth, camera=camera)
    stamps = itertools.count(1_100_000_000, 40_000_000)

    def send():
        infos.publish(info_msg(frame))
        peer.spin(0.1)
        images.publish(at(image_msg(frame), next(stamps)))

    peer.ask(send, lambda: "sparse grid" in warning(told), what=lambda: process.output, every_s=0.2)
    assert (labels_of(answers[-1]) == PERSON).any()
    assert process.output.count("fill_upsampling_holes: true") == 1


@pytest.mark.parametrize("unit", [None, 0.001])
def test_float_millimetres_are_said_and_the_parameter_sets_them(start, peer, frames, unit):
    given = [] if unit is None else ["--ros-args", "-p", f"depth_scale:={unit}"]
    process = start("-m", "depth_pose.ros.nodes.denoise_node", *given)
    process.wait_for("is ready")
    answers = peer.listen(PointCloud2, POINTS)
    told = peer.listen(DiagnosticArray, "/diagnostics", RELIABLE)
    images, infos = peer.publisher(Image, IMAGE), peer.publisher(CameraInfo, INFO)
    stamps = itertools.count(frames[0].stamp_ns, 40_000_000)
    message = image_msg(frames[0], "32FC1")
    message.data = (frames[0].depth * np.float32(1000.0)).astype("<f4").tobytes()

    def send():
        infos.publish(info_msg(frames[0]))
        peer.spin(0.1)
        images.publish(at(message, next(stamps)))

    peer.ask(send, lambda: len(answers) >= 12, what=lambda: f"answers:\n{process.output}\nthey", every_s=0.2)
    has_person = (labels_of(answers[0]) == PERSON).any()
    said = "the parameter depth_scale sets the metres per unit, here perhaps 0.001"
    if unit is None:
        process.wait_for(said)
        assert not has_person and process.output.count("look like another unit") == 1
        peer.until(lambda: said in warning(told), what="the warning on /diagnostics")
    else:
        assert has_person and "look like another unit" not in process.output


def test_an_info_of_another_name_is_used_where_nobody_sends_another(start, peer, frames):
    process = start("-m", "depth_pose.ros.nodes.denoise_node")
    process.wait_for("is ready")
    answers = peer.listen(PointCloud2, POINTS)
    images, infos = peer.publisher(Image, IMAGE), peer.publisher(CameraInfo, INFO)
    stamps = itertools.count(frames[0].stamp_ns, 40_000_000)
    info = info_msg(frames[0])
    info.header.frame_id = "other name\x1b[2J\n[up] all nodes are ready"

    def send():
        infos.publish(info)
        peer.spin(0.05)
        images.publish(at(image_msg(frames[0]), next(stamps)))

    peer.ask(send, lambda: answers, what=lambda: f"answers:\n{process.output}\nthey", every_s=0.1)
    process.wait_for("is it this camera's?")
    assert process.output.count("is it this camera's?") == 1
    assert "\x1b" not in process.output and not re.search(r"^\[up\]", process.output, re.MULTILINE)
