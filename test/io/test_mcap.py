"""Recordings: written, read back, found, cut short, and checked by an independent decoder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer
from mcap_ros2.reader import read_ros2_messages
from mcap_ros2.writer import Writer as Ros2Writer

from depth_pose.core.camera import Camera
from depth_pose.core.errors import InputError
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import JOINTS, Source, Tracking
from depth_pose.io import schemas
from depth_pose.io.depth_topics import depth_topics
from depth_pose.io.mcap_read import DepthReader, read_frames
from depth_pose.io.mcap_write import DepthWriter, PartlyWritten, SkeletonWriter
from depth_pose.io.messages import read_people as read_people_message
from depth_pose.io.messages import read_skeleton as read_skeleton_message
from depth_pose.io.messages import write_camera_info, write_image
from depth_pose.io.recording import Recording
from depth_pose.io.skeleton_read import read_people, read_skeletons
from skeletons import random_skeleton

CAMERA = Camera(64, 48, 60.0, 61.0, 31.5, 23.5)
START = 1_700_000_000_123_456_789
ROOT = Path(__file__).parents[2]
POINT_FIELD = "string name\nuint32 offset\nuint8 datatype\nuint32 count"
CLOUD_SCHEMA = ("\n" + "=" * 80 + "\n").join(
    [
        "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\n"
        "bool is_bigendian\nuint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense",
        "MSG: sensor_msgs/PointField\n" + POINT_FIELD,
        "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id",
        "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec",
    ]
)


def _depths(count: int, seed: int = 0) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [(rng.integers(0, 5000, (48, 64)) / np.float32(1000)).astype(np.float32) for _ in range(count)]


def _write(path: Path, depths: list[np.ndarray], topic: str = "/camera/depth/image_raw") -> Path:
    with DepthWriter(path, CAMERA, "optical", topic) as writer:
        for i, depth in enumerate(depths):
            writer.write(START + i * 40_000_000, depth)
    return path


def _skeleton(i: int) -> Skeleton:
    return random_skeleton(np.random.default_rng(i), stamp_ns=START + i, body_id="b1")


def test_depth_is_read_as_written(tmp_path: Path) -> None:
    depths = _depths(5)
    reader = DepthReader(_write(tmp_path / "a.mcap", depths))
    frames = list(reader)
    assert len(reader) == len(frames) == 5
    assert reader.warnings == []
    for i, frame in enumerate(frames):
        assert frame.stamp_ns == START + i * 40_000_000
        assert frame.frame_id == "optical"
        assert frame.camera == CAMERA
        np.testing.assert_array_equal(frame.depth, depths[i])


def test_metres_are_kept_exactly(tmp_path: Path) -> None:
    depth = np.random.default_rng(0).random((48, 64)).astype(np.float32) + 1
    with DepthWriter(tmp_path / "a.mcap", CAMERA, "optical", encoding="32FC1") as writer:
        writer.write(START, depth)
    np.testing.assert_array_equal(next(read_frames(tmp_path / "a.mcap")).depth, depth)


def test_what_millimetres_cannot_hold_is_no_return(tmp_path: Path) -> None:
    depth = np.full((48, 64), 2.0, np.float32)
    depth[0, :4] = [np.nan, np.inf, -1.0, 70.0]
    read = next(read_frames(_write(tmp_path / "a.mcap", [depth]))).depth
    assert (read[0, :4] == 0).all()
    assert (read[1:] == 2.0).all()


def test_independent_decoder_reads_our_depth(tmp_path: Path) -> None:
    depths = _depths(1)
    messages = {
        m.channel.topic: m.ros_msg for m in read_ros2_messages(str(_write(tmp_path / "a.mcap", depths)))
    }
    image = messages["/camera/depth/image_raw"]
    info = messages["/camera/depth/camera_info"]
    assert (image.height, image.width, image.step, image.encoding) == (48, 64, 128, "16UC1")
    mm = np.frombuffer(image.data, "<u2").reshape(48, 64)
    np.testing.assert_allclose(mm / 1000, depths[0], atol=1e-6)
    assert list(info.k) == [60.0, 0, 31.5, 0, 61.0, 23.5, 0, 0, 1]
    assert (info.p[0], info.p[2], info.p[5], info.p[6], info.p[10]) == (60.0, 31.5, 61.0, 23.5, 1.0)
    assert info.distortion_model == "plumb_bob"
    assert info.header.stamp.sec * 10**9 + info.header.stamp.nanosec == START


def test_skeletons_are_read_as_written(tmp_path: Path) -> None:
    written = [_skeleton(0), Skeleton.lost(START + 1, "optical"), _skeleton(2)]
    with SkeletonWriter(tmp_path / "s.mcap") as writer:
        for skeleton in written:
            writer.write(skeleton)
    for a, b in zip(written, read_skeletons(tmp_path / "s.mcap"), strict=True):
        assert a == b


def test_independent_decoder_reads_our_skeletons(tmp_path: Path) -> None:
    skeleton = _skeleton(3)
    with SkeletonWriter(tmp_path / "s.mcap") as writer:
        writer.write(skeleton)
    (message,) = read_ros2_messages(str(tmp_path / "s.mcap"))
    ros = message.ros_msg
    assert message.schema.name == "depth_pose_msgs/msg/Skeleton"
    assert message.channel.topic == "/depth_pose/skeleton"
    assert ros.header.stamp.sec * 10**9 + ros.header.stamp.nanosec == skeleton.stamp_ns
    assert (ros.source, ros.body_id) == (Source.RECOVERED, "b1")
    assert [j.name for j in ros.joints] == list(JOINTS)
    for i, joint in enumerate(ros.joints):
        assert [joint.position.x, joint.position.y, joint.position.z] == skeleton.positions[i].tolist()
        q = joint.orientation
        assert [q.x, q.y, q.z, q.w] == skeleton.quats_xyzw[i].tolist()
        assert joint.confidence == skeleton.joint_confidence[i]
        assert joint.state == skeleton.joint_states[i]
    np.testing.assert_array_equal(np.array(ros.build, np.float32), skeleton.build)
    assert ros.tracking == Tracking.TRACKED
    for told, known in (
        (ros.centre, skeleton.centre),
        (ros.velocity, skeleton.velocity),
        (ros.box_min, skeleton.box[0]),
        (ros.box_max, skeleton.box[1]),
    ):
        assert [told.x, told.y, told.z] == known.tolist()
    np.testing.assert_array_equal(np.reshape(ros.joint_velocities, (19, 3)), skeleton.velocities)
    six = np.reshape(ros.joint_covariances, (19, 6))
    rows, columns = [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]
    np.testing.assert_array_equal(six, skeleton.covariances[:, rows, columns])


def _old_message(skeleton: Skeleton, has_build: bool) -> dict[str, object]:
    """A Skeleton message of before there were motion and boxes, or before there were builds."""
    sec, nanosec = divmod(skeleton.stamp_ns, 10**9)
    joints = [
        {
            "name": name,
            "position": dict(zip("xyz", skeleton.positions[i].tolist(), strict=True)),
            "orientation": dict(zip("xyzw", skeleton.quats_xyzw[i].tolist(), strict=True)),
            "confidence": float(skeleton.joint_confidence[i]),
            "state": int(skeleton.joint_states[i]),
        }
        for i, name in enumerate(JOINTS)
    ]
    return {
        "header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": skeleton.frame_id},
        **{name: getattr(skeleton, name) for name in ("body_id", "confidence", "residual", "scale")},
        "source": int(skeleton.source),
        "joints": joints,
        **({"build": skeleton.build.tolist()} if has_build else {}),
    }


@pytest.mark.parametrize("lacking", [schemas.MOTION_LINES, schemas.BUILD_LINE + schemas.MOTION_LINES])
@pytest.mark.parametrize("has_definition", [True, False])
def test_recordings_of_older_versions_are_read(tmp_path: Path, lacking: str, has_definition: bool) -> None:
    """With the definition of then, or with none; two people, so that nothing is read past the end of one."""
    has_build = lacking == schemas.MOTION_LINES
    people = tuple(_skeleton(i) for i in (3, 4))
    messages = [_old_message(s, has_build) for s in people]
    array = {"header": messages[0]["header"], "skeletons": messages}
    with (tmp_path / "s.mcap").open("wb") as stream:
        writer = Ros2Writer(stream)
        for topic, kind, message in (
            (schemas.PEOPLE_TOPIC, schemas.SKELETON_ARRAY, array),
            (schemas.SKELETON_TOPIC, schemas.SKELETON, messages[0]),
        ):
            text = schemas.schema_text(kind)
            before = writer.register_msgdef(kind, text.replace(lacking, ""))
            assert lacking in text
            writer.write_message(topic, before, message, log_time=START, publish_time=START)
        writer.finish()
    if has_definition:
        (frame,) = read_people(tmp_path / "s.mcap")
        (followed,) = read_skeletons(tmp_path / "s.mcap")
    else:
        topics = (schemas.PEOPLE_TOPIC, schemas.SKELETON_TOPIC)
        data = {m.topic: bytes(m.data) for m in Recording(tmp_path / "s.mcap").messages(*topics)}
        frame, followed = read_people_message(data[topics[0]]), read_skeleton_message(data[topics[1]])
    for got, wanted in (
        (frame.skeletons[0], people[0]),
        (frame.skeletons[1], people[1]),
        (followed, people[0]),
    ):
        np.testing.assert_array_equal(got.positions, wanted.positions)
        np.testing.assert_array_equal(got.build, wanted.build if has_build else [])
        assert len(got.velocities) == len(got.covariances) == 0 and got.tracking is Tracking.UNKNOWN


def test_same_input_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        with SkeletonWriter(tmp_path / name) as writer:
            for i in range(50):
                writer.write(_skeleton(i))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_failed_writing_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "s.mcap"
    path.write_bytes(b"old")
    with pytest.raises(ZeroDivisionError), SkeletonWriter(path) as writer:
        writer.write(_skeleton(0))
        raise ZeroDivisionError
    assert [p.name for p in tmp_path.iterdir()] == ["s.mcap"]
    assert path.read_bytes() == b"old"
    with pytest.raises(PartlyWritten) as stopped, SkeletonWriter(path) as writer:
        writer.write(_skeleton(0))
        raise KeyboardInterrupt
    assert path.read_bytes() == b"old"
    assert stopped.value.path == tmp_path / "s.partial.mcap"
    assert len(list(read_skeletons(stopped.value.path))) == 1
    with pytest.raises(KeyboardInterrupt), SkeletonWriter(path, only_whole=True) as writer:
        writer.write(_skeleton(0))
        raise KeyboardInterrupt
    assert sorted(p.name for p in tmp_path.iterdir()) == ["s.mcap", "s.partial.mcap"]


def test_schemas_say_what_the_message_files_say() -> None:
    folder = ROOT / "ros_ws" / "src" / "depth_pose_msgs" / "msg"
    for name in ("Skeleton", "Joint"):
        lines = [line.partition("#")[0].split() for line in (folder / f"{name}.msg").read_text().splitlines()]
        ours = [line.split() for line in schemas.definition(f"depth_pose_msgs/msg/{name}").splitlines()]
        assert [line for line in lines if line] == ours, name


def _raw(path: Path, messages: list[tuple[str, str, int, bytes]], **options: object) -> Path:
    """Write raw messages (topic, kind, log time, data)."""
    with path.open("wb") as stream:
        writer = Writer(stream, **options)
        writer.start()
        channels = {}
        for topic, kind, time, data in messages:
            if topic not in channels:
                text = schemas.schema_text(kind).encode()
                channels[topic] = writer.register_channel(
                    topic, "cdr", writer.register_schema(kind, "ros2msg", text)
                )
            writer.add_message(channels[topic], time, data, time)
        writer.finish()
    return path


def _image(stamp: int, encoding: str = "16UC1", topic: str = "/d/image") -> tuple[str, str, int, bytes]:
    data = write_image(stamp, "optical", np.full((48, 64), 2000, np.uint16))
    return topic, schemas.IMAGE, stamp, data.replace(b"16UC1", encoding.encode())


def _info(stamp: int, camera: Camera = CAMERA, topic: str = "/d/camera_info") -> tuple[str, str, int, bytes]:
    return topic, schemas.CAMERA_INFO, stamp, write_camera_info(stamp, "optical", camera)


def test_calibration_after_the_first_image_and_again_later(tmp_path: Path) -> None:
    other = Camera(64, 48, 80.0, 80.0, 31.5, 23.5)
    path = _raw(tmp_path / "a.mcap", [_image(1), _image(2), _info(3), _image(4), _info(5, other), _image(6)])
    assert [f.camera.fx for f in read_frames(path)] == [60.0, 60.0, 60.0, 80.0]


def test_file_without_index(tmp_path: Path) -> None:
    messages = [_info(1), *(_image(i) for i in range(2, 9))]
    path = _raw(
        tmp_path / "a.mcap", messages, use_chunking=False, use_statistics=False, repeat_channels=False
    )
    reader = DepthReader(path)
    assert len(reader) == len(list(reader)) == 7
    assert reader.warnings == []


def test_the_only_depth_topic_is_found_among_others(tmp_path: Path) -> None:
    colour = _image(1, "bgr8 ", "/camera/color/image_raw")
    infrared = _image(1, "mono8", "/camera/ir/image_raw")
    path = _raw(
        tmp_path / "a.mcap",
        [colour, infrared, _info(1, topic="/camera/color/camera_info"), _info(1), _image(2)],
    )
    (topic,) = depth_topics(Recording(path))
    assert (topic.name, topic.info_topic, topic.frames) == ("/d/image", "/d/camera_info", 1)


def test_several_depth_topics_are_listed(tmp_path: Path) -> None:
    a, b = "/a/depth/image", "/b/depth/image"
    path = _raw(
        tmp_path / "a.mcap",
        [
            _image(1, topic=a),
            _image(2, topic=b),
            _info(1, topic="/a/depth/camera_info"),
            _info(1, topic="/b/camera_info"),
        ],
    )
    with pytest.raises(InputError, match=f"2 depth topics: {a}, {b}; choose one with --depth-topic"):
        read_frames(path)
    assert next(read_frames(path, b)).stamp_ns == 2
    assert DepthReader(path, b).topic.info_topic == "/b/camera_info"
    with pytest.raises(InputError, match="no messages on /c"):
        read_frames(path, "/c")
    with pytest.raises(InputError, match="CameraInfo; depth is an Image"):
        read_frames(path, "/b/camera_info")


def test_of_several_the_one_called_depth(tmp_path: Path) -> None:
    path = _raw(
        tmp_path / "a.mcap",
        [
            _image(1, topic="/k/ir/image"),
            _image(2, topic="/k/depth/image"),
            _info(1, topic="/k/depth/camera_info"),
        ],
    )
    assert next(read_frames(path)).stamp_ns == 2


@pytest.mark.parametrize(
    ("messages", "says"),
    [
        ([_image(1)], "record /d/camera_info"),
        ([_info(1)], "no depth image"),
        ([_image(1, "rgb8 "), _info(1)], "no depth image"),
        ([_image(1), _info(1, Camera(64, 48, 0.0, 0.0, 0.0, 0.0))], "not calibrated"),
        ([_image(1), _info(1, Camera(32, 48, 60.0, 60.0, 15.0, 23.0))], "camera_info says 32 x 48"),
    ],
)
def test_unusable_recording_is_refused(
    tmp_path: Path, messages: list[tuple[str, str, int, bytes]], says: str
) -> None:
    path = _raw(tmp_path / "a.mcap", messages)
    with pytest.raises(InputError, match=says):
        list(read_frames(path))


def test_bad_frames_are_dropped_and_counted(tmp_path: Path) -> None:
    topic, kind, _, data = _image(2)
    cut = (topic, kind, 2, data[:1000])
    path = _raw(
        tmp_path / "a.mcap", [_info(1), _image(1), cut, _image(3, "rgb8 "), _image(4, "rgb8 "), _image(5)]
    )
    reader = DepthReader(path)
    assert [f.stamp_ns for f in reader] == [1, 5]
    assert reader.dropped == 3
    assert any("2 frames were dropped" in line and "rgb8" in line for line in reader.warnings)
    damaged = "Image: the message is damaged"
    assert any("1 frame was dropped" in line and damaged in line for line in reader.warnings)


def test_recording_cut_short_gives_what_it_has(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    depths = _depths(400)
    whole = _write(tmp_path / "a.mcap", depths).read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: int(len(whole) * 0.8)])
    reader = DepthReader(cut)
    frames = list(reader)
    assert 100 < len(frames) == len(reader) < 400
    np.testing.assert_array_equal(frames[-1].depth, depths[len(frames) - 1])
    assert len(reader.warnings) == 1
    assert "ends too early" in reader.warnings[0]
    assert len(list(read_frames(cut))) == len(frames)
    assert "ends too early" in caplog.text
    cut.write_bytes(whole[:200])
    with pytest.raises(InputError, match="no depth image"):
        read_frames(cut)


def test_damage_in_the_middle_is_noticed(tmp_path: Path) -> None:
    path = _write(tmp_path / "a.mcap", _depths(400))
    data = bytearray(path.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 64] = bytes(64)
    path.write_bytes(data)
    reader = DepthReader(path)
    frames = list(reader)
    assert 0 < len(frames) < 400
    assert "damaged" in reader.warnings[0]


def test_no_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_frames(tmp_path / "none.mcap")
    (tmp_path / "a.db3").write_bytes(b"SQLite format 3\x00")
    with pytest.raises(InputError, match="not a database"):
        read_frames(tmp_path / "a.db3")
    (tmp_path / "empty.mcap").write_bytes(b"")
    with pytest.raises(InputError, match="it is empty"):
        read_frames(tmp_path / "empty.mcap")
    with pytest.raises(InputError, match="no skeletons"):
        read_skeletons(_write(tmp_path / "d.mcap", _depths(1)))


def test_folder_of_a_split_recording(tmp_path: Path) -> None:
    for number in (10, 2, 1):
        with DepthWriter(tmp_path / f"bag_{number}.mcap", CAMERA, "optical") as writer:
            writer.write(number, np.ones((48, 64), np.float32))
    reader = DepthReader(tmp_path)
    assert [f.stamp_ns for f in reader] == [1, 2, 10]
    assert len(reader) == 3


def test_a_folder_of_several_recordings_is_not_one(tmp_path: Path) -> None:
    """Two days' skeletons would be taken for one person's."""
    for name, stamps in (("monday", (1, 5)), ("tuesday", (2, 6))):
        with DepthWriter(tmp_path / f"{name}.mcap", CAMERA, "optical") as writer:
            for stamp in stamps:
                writer.write(stamp, np.ones((48, 64), np.float32))
    with pytest.raises(InputError, match="several recordings"):
        Recording(tmp_path)
    (tmp_path / "tuesday.mcap").rename(tmp_path / "monday_2.mcap")
    (tmp_path / "monday.mcap").rename(tmp_path / "monday_1.mcap")
    with pytest.raises(InputError, match="several recordings"):  # the second begins before the first ends
        Recording(tmp_path)


def test_rectified_images_are_not_rectified_again(tmp_path: Path) -> None:
    """By their topics' names; K and D are the lens', P is what they were made with."""
    depth = np.linspace(1.0, 3.0, 48 * 64, dtype=np.float32).reshape(48, 64)
    frames = {}
    for topic in ("/kinect2/sd/image_depth", "/kinect2/sd/image_depth_rect"):
        path = tmp_path / f"{topic.rpartition('/')[2]}.mcap"
        with path.open("wb") as stream:
            writer = Ros2Writer(stream)
            image = writer.register_msgdef(schemas.IMAGE, schemas.schema_text(schemas.IMAGE))
            info = writer.register_msgdef(schemas.CAMERA_INFO, schemas.schema_text(schemas.CAMERA_INFO))
            header = {"stamp": {"sec": 1, "nanosec": 0}, "frame_id": "optical"}
            size = {"height": 48, "width": 64}
            k, p = [60.0, 0, 31.5, 0, 61.0, 23.5, 0, 0, 1], [55.0, 0, 31.0, 0, 0, 56.0, 23.0, 0, 0, 0, 1, 0]
            told = {"d": [0.3, 0.1, 0, 0, 0.0], "k": k, "p": p, "distortion_model": "plumb_bob"}
            writer.write_message("/kinect2/sd/camera_info", info, {"header": header, **size, **told}, 0, 0)
            pixels = {"encoding": "32FC1", "step": 256, "data": depth.tobytes()}
            writer.write_message(topic, image, {"header": header, **size, **pixels}, 1, 1)
            writer.finish()
        (frames[topic],) = DepthReader(path)
    raw, rectified = frames.values()
    np.testing.assert_array_equal(rectified.depth, depth)
    assert rectified.camera == Camera(64, 48, 55.0, 56.0, 31.0, 23.0)
    assert raw.camera.fx == CAMERA.fx and raw.camera.width < CAMERA.width  # the whole view is narrower
    assert raw.depth.max() > 0


def test_point_clouds_are_read(tmp_path: Path) -> None:
    v, u = np.mgrid[:48, :64].astype(np.float32)
    points = np.stack([(u - 31.5) / 60 * 2, (v - 23.5) / 61 * 2, np.full_like(u, 2)], axis=-1)
    fields = [{"name": n, "offset": 4 * i, "datatype": 7, "count": 1} for i, n in enumerate("xyz")]
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        writer = Ros2Writer(stream)
        schema = writer.register_msgdef(schemas.POINT_CLOUD, CLOUD_SCHEMA)
        for i, (height, width) in enumerate([(48, 64), (1, 48 * 64)]):
            message = {
                "header": {"stamp": {"sec": i, "nanosec": 7}, "frame_id": "optical"},
                "height": height,
                "width": width,
                "fields": fields,
                "is_bigendian": False,
                "point_step": 12,
                "row_step": 12 * width,
                "data": points.astype("<f4").tobytes(),
                "is_dense": True,
            }
            writer.write_message("/lidar/points", schema, message, i, i)
        writer.finish()
    organised, other = read_frames(path)
    assert (organised.stamp_ns, other.stamp_ns) == (7, 1_000_000_007)
    assert organised.camera.fx == pytest.approx(60, abs=1e-3)
    np.testing.assert_array_equal(organised.depth, np.full((48, 64), 2, np.float32))
    assert other.depth[other.depth > 0].mean() == pytest.approx(2)
    assert (other.depth > 0).mean() > 0.8
