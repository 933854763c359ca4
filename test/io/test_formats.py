"""Every format of recording gives the frames that MCAP gives, bit for bit; others are refused with a hint."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from damaged import CAMERA, IMAGE, INFO, STEP_NS, depth_mm, messages, write
from mcap.writer import Writer
from PIL import Image
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from depth_pose.archive.inputs import find_sources
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.frame import DepthFrame
from depth_pose.io import schemas
from depth_pose.io.image_options import ImageOptions
from depth_pose.io.mcap_read import DepthReader, read_frames
from depth_pose.io.recording import Recording
from depth_pose.io.skeleton_read import read_people, read_skeletons

FRAMES = 12
JAZZY, NOETIC = get_typestore(Stores.ROS2_JAZZY), get_typestore(Stores.ROS1_NOETIC)
GIVEN = ImageOptions(CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, fps=25.0)


def _rosbag2(
    path: Path,
    plugin: StoragePlugin = StoragePlugin.SQLITE3,
    mode: CompressionMode = CompressionMode.NONE,
    part: slice = slice(None),
) -> Path:
    writer = Writer2(path, version=9, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for topic, kind, ns, data in messages(FRAMES)[part]:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=JAZZY)
            writer.write(connections[topic], ns, data)
    return path


def _to_ros1(data: bytes, kind: str) -> bytes:
    """By hand, by way of the message: independent of what reads it."""
    return bytes(NOETIC.serialize_ros1(_noetic(JAZZY.deserialize_cdr(data, kind)), kind))


def _noetic(message: object) -> object:
    kind = message.__msgtype__
    fields = {
        (n.upper() if kind == schemas.CAMERA_INFO and len(n) == 1 else n): getattr(message, n)
        for n in message.__dataclass_fields__
        if n != "__msgtype__"
    }
    fields = {n: _noetic(v) if hasattr(v, "__msgtype__") else v for n, v in fields.items()}
    if kind == schemas.HEADER:
        fields["seq"] = 7
    return NOETIC.types[kind](**fields)


def _rosbag1(
    path: Path, packed: Writer1.CompressionFormat | None = None, topics: tuple[str, str] = (IMAGE, INFO)
) -> Path:
    writer = Writer1(path)
    if packed is not None:
        writer.set_compression(packed)
    with writer:
        connections = {}
        for topic, kind, ns, data in messages(FRAMES):
            name = topics[topic == INFO]
            if name not in connections:
                connections[name] = writer.add_connection(name, kind, typestore=NOETIC)
            writer.write(connections[name], ns, _to_ros1(data, kind))
    return path


def _mcap_of_ros1(path: Path) -> Path:
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros1")
        channels = {}
        for topic, kind, ns, data in messages(FRAMES):
            if topic not in channels:
                text, md5 = NOETIC.generate_msgdef(kind, ros_version=1)
                schema = writer.register_schema(kind.replace("/msg/", "/"), "ros1msg", text.encode())
                channels[topic] = writer.register_channel(topic, "ros1", schema, {"md5sum": md5})
            writer.add_message(channels[topic], ns, _to_ros1(data, kind), ns)
        writer.finish()
    return path


def _pngs(path: Path) -> Path:
    path.mkdir()
    for i in range(FRAMES):
        Image.fromarray(depth_mm(i)).save(path / f"{i}.png")
    return path


def _arrays(path: Path, kind: str = "<u2") -> Path:
    path.mkdir()
    for i in range(FRAMES):
        np.save(path / f"depth_{i}.npy", depth_mm(i).astype(kind))
    np.save(path / "colour_0.npy", np.zeros((48, 64, 3), np.uint8))
    return path


def _split(path: Path) -> Path:
    """A folder of two .db3 files with the metadata of both, as rosbag2 splits."""
    first, second = _rosbag2(path / "a", part=slice(0, 8)), _rosbag2(path / "b", part=slice(8, None))
    (path / "a_0.db3").write_bytes(next(first.glob("*.db3")).read_bytes())
    (path / "a_1.db3").write_bytes(next(second.glob("*.db3")).read_bytes())
    text = (first / "metadata.yaml").read_text()
    for old, new in (("- a.db3", "- a_0.db3\n  - a_1.db3"), (": 4\n", f": {FRAMES}\n")):
        assert old in text, text
        text = text.replace(old, new)
    (path / "metadata.yaml").write_text(text)
    return path


BZ2, LZ4 = Writer1.CompressionFormat.BZ2, Writer1.CompressionFormat.LZ4
FORMATS: dict[str, Callable[[Path], Path]] = {
    "db3 folder": _rosbag2,
    "db3 file alone": lambda p: next(_rosbag2(p).glob("*.db3")).rename(p.with_suffix(".db3")),
    "db3 split": _split,
    "db3, files packed": lambda p: _rosbag2(p, mode=CompressionMode.FILE),
    "db3, messages packed": lambda p: _rosbag2(p, mode=CompressionMode.MESSAGE),
    "mcap folder": lambda p: _rosbag2(p, StoragePlugin.MCAP),
    "mcap, files packed": lambda p: _rosbag2(p, StoragePlugin.MCAP, CompressionMode.FILE),
    "mcap, messages packed": lambda p: _rosbag2(p, StoragePlugin.MCAP, CompressionMode.MESSAGE),
    "mcap file, messages packed": lambda p: next(
        _rosbag2(p, StoragePlugin.MCAP, CompressionMode.MESSAGE).glob("*.mcap")
    ),
    "mcap of ROS 1": lambda p: _mcap_of_ros1(p.with_suffix(".mcap")),
    "ROS 1": lambda p: _rosbag1(p.with_suffix(".bag")),
    "ROS 1, bz2": lambda p: _rosbag1(p.with_suffix(".bag"), BZ2),
    "ROS 1, lz4": lambda p: _rosbag1(p.with_suffix(".bag"), LZ4),
    "RealSense": lambda p: _rosbag1(
        p.with_suffix(".bag"),
        LZ4,
        (
            "/device_0/sensor_0/Depth_0/image/data",
            "/device_0/sensor_0/Depth_0/info/camera_info",
        ),
    ),
    "PNG": _pngs,
    "NPY": _arrays,
    "NPY, 32 bit": lambda p: _arrays(p, ">i4"),
}


def _wanted(tmp_path: Path) -> Iterator[DepthFrame]:
    return read_frames(write(tmp_path / "wanted.mcap", FRAMES))


@pytest.mark.parametrize("name", FORMATS)
def test_frames_are_those_of_mcap(tmp_path: Path, name: str) -> None:
    reader = DepthReader(FORMATS[name](tmp_path / "bag"), images=GIVEN)
    frames = list(reader)
    assert len(reader) == len(frames) == FRAMES
    assert reader.warnings == []
    for got, wanted in zip(frames, _wanted(tmp_path), strict=True):
        assert (got.stamp_ns, got.camera) == (wanted.stamp_ns, wanted.camera)
        assert got.depth.dtype == np.float32
        if name == "NPY, 32 bit":  # metres by way of float64, not whole millimetres
            np.testing.assert_allclose(got.depth, wanted.depth, rtol=1e-6)
        else:
            assert got.depth.tobytes() == wanted.depth.tobytes()


def test_messages_of_ros1_are_those_that_ros2_writes(tmp_path: Path) -> None:
    wanted = [(topic, ns, data) for topic, _, ns, data in messages(FRAMES)]
    recording = Recording(_rosbag1(tmp_path / "a.bag"))
    got = [(m.topic, m.log_time_ns, m.data) for m in recording.messages(IMAGE, INFO)]
    assert got == wanted


def test_the_unit_of_realsense_is_taken_from_its_recording(tmp_path: Path) -> None:
    depth, info = "/device_0/sensor_0/Depth_0/image/data", "/device_0/sensor_0/Depth_0/info/camera_info"
    path = tmp_path / "a.bag"
    with Writer1(path) as writer:
        kind = "std_msgs/msg/Float32"
        unit = writer.add_connection("/device_0/sensor_0/option/Depth_Units/value", kind, typestore=NOETIC)
        writer.write(unit, 1, bytes(NOETIC.serialize_ros1(NOETIC.types[kind](np.float32(0.00025)), kind)))
        for topic, kind, ns, data in messages(1):
            name = info if topic == INFO else depth
            connection = writer.add_connection(name, kind, typestore=NOETIC)
            writer.write(connection, ns, _to_ros1(data, kind))
    (frame,) = read_frames(path)
    np.testing.assert_allclose(frame.depth, depth_mm(0) * 0.00025, rtol=1e-6)


@pytest.mark.parametrize("is_packed", [False, True])
def test_a_calibration_that_realsense_writes_as_text_is_named_with_the_cure(
    tmp_path: Path, is_packed: bool
) -> None:
    """As its SDK records .db3 files since 2026; each message may be packed, without metadata.yaml."""
    names = {IMAGE: "/device_0/sensor_0/Depth_0/image/data", INFO: "/device_0/sensor_0/Depth_0/camera_info"}
    text = "std_msgs/msg/String"
    mode = CompressionMode.MESSAGE if is_packed else CompressionMode.NONE
    writer = Writer2(tmp_path / "a", version=9, storage_plugin=StoragePlugin.SQLITE3)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        topics = {
            IMAGE: writer.add_connection(names[IMAGE], schemas.IMAGE, typestore=JAZZY),
            INFO: writer.add_connection(names[INFO], text, typestore=JAZZY),
        }
        for topic, _, ns, data in messages(2):
            if topic == INFO:
                data = JAZZY.serialize_cdr(JAZZY.types[text]("width=64;height=48;fx=60;ppx=31.5"), text)
            writer.write(topics[topic], ns, data)
    path = next((tmp_path / "a").glob("*.db3")).rename(tmp_path / "a.db3")
    with pytest.raises(InputError, match=f"^{path}: {names[INFO]} is a {text}.*realsense2_camera"):
        DepthReader(path)


def test_a_ros1_bag_that_was_not_closed_says_what_to_do(tmp_path: Path) -> None:
    path = _rosbag1(tmp_path / "a.bag")
    data = bytearray(path.read_bytes())
    at = data.index(b"index_pos=") + 10
    data[at : at + 8] = bytes(8)
    for end in (len(data), len(data) - 700):  # the connections at its end are gone
        path.write_bytes(data[:end])
        with pytest.raises(InputError, match=f"^{path} .*not indexed.*'rosbag reindex FILE'"):
            DepthReader(path)


@pytest.mark.parametrize("packed", [BZ2, LZ4])
def test_a_damaged_chunk_of_ros1_ends_what_is_read(
    tmp_path: Path, packed: Writer1.CompressionFormat, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Writer1, "__init__", _small_chunks(Writer1.__init__))
    path = _rosbag1(tmp_path / "a.bag", packed)
    data = bytearray(path.read_bytes())
    # lz4's frames have no checksum here: the beginning of one
    data[len(data) // 2 if packed == BZ2 else data.rindex(b'\x04"M\x18')] ^= 8
    path.write_bytes(data)
    reader = DepthReader(path)
    assert 0 < len(list(reader)) < FRAMES
    assert "the rest is not read" in reader.damage[0]


def _small_chunks(init: Callable[..., None]) -> Callable[..., None]:
    def made(self: Writer1, path: Path) -> None:
        init(self, path)
        self.chunk_threshold = 10_000

    return made


def test_a_damaged_database_says_what_saves_it(tmp_path: Path) -> None:
    path = next(_rosbag2(tmp_path / "a").glob("*.db3"))
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 2 // 3])
    with pytest.raises(InputError, match=f"^{path} is damaged, or ends too early: .* .recover"):
        DepthReader(path.parent)
    page = int.from_bytes(whole[16:18], "big")
    at = whole.index(messages(FRAMES)[15][3][-200:-100]) // page * page  # a page of the eighth image
    path.write_bytes(whole[: at - page * 2] + bytes(page * 3) + whole[at + page :])
    with pytest.raises(InputError, match=r"is damaged, or ends too early: .* \.recover"):
        DepthReader(path.parent)


def test_a_database_of_any_name(tmp_path: Path) -> None:
    """rosbags takes names apart as URIs."""
    path = next(_rosbag2(tmp_path / "a").glob("*.db3"))
    for name in ("100%25?mode=rw#1.db3", "recording"):
        path = path.rename(tmp_path / name)
        assert len(list(DepthReader(path))) == FRAMES


def test_messages_in_the_write_ahead_log_are_read(tmp_path: Path) -> None:
    """As a recorder that was killed leaves them."""
    path = next(_rosbag2(tmp_path / "a").glob("*.db3"))
    with closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("PRAGMA wal_autocheckpoint = 0")
        database.execute(
            "INSERT INTO messages(topic_id, timestamp, data) "
            "SELECT topic_id, timestamp + 1000000000, data FROM messages WHERE data NOT NULL"
        )
        database.commit()
        left = {name: path.with_name(name).read_bytes() for name in ("a.db3", "a.db3-wal")}
    (tmp_path / "b").mkdir()
    for name, data in left.items():
        (tmp_path / "b" / name).write_bytes(data)
    assert len(list(DepthReader(tmp_path / "b" / "a.db3"))) == 2 * FRAMES
    assert (tmp_path / "b" / "a.db3").read_bytes() == left["a.db3"]


def test_definitions_that_rosbag2_did_not_find_do_no_harm(tmp_path: Path) -> None:
    path = next(_rosbag2(tmp_path / "a").glob("*.db3"))
    with closing(sqlite3.connect(path)) as database:
        database.execute("UPDATE message_definitions SET encoding = 'unknown'")
        database.commit()
    assert len(list(DepthReader(path))) == FRAMES


def test_counts_are_held_against_the_metadata(tmp_path: Path) -> None:
    folder = _rosbag2(tmp_path / "a")
    with sqlite3.connect(next(folder.glob("*.db3"))) as database:
        database.execute("DELETE FROM messages WHERE id IN (3, 4)")
    reader = DepthReader(folder)
    assert len(list(reader)) == FRAMES - 1
    assert f"{FRAMES - 1} of {FRAMES} on {IMAGE}" in reader.damage[0]


def test_a_part_that_is_gone_is_told(tmp_path: Path) -> None:
    folder = _split(tmp_path / "a")
    (folder / "a_1.db3").unlink()
    reader = DepthReader(folder)
    assert len(list(reader)) == 4
    assert "a_1.db3 does not exist" in reader.damage[0]


# Images


def test_metres_in_arrays_and_a_scale(tmp_path: Path) -> None:
    path = tmp_path / "metres"
    path.mkdir()
    depth = depth_mm(0).astype(np.float64) / 1000
    np.save(path / "1.npy", depth)
    np.save(path / "2.npy", (depth * 5000).astype(np.uint16))
    np.testing.assert_array_equal(next(read_frames(path, images=GIVEN)).depth, depth.astype(np.float32))
    (path / "1.npy").unlink()
    scaled = ImageOptions(60, 61, 31.5, 23.5, depth_scale=1 / 5000)
    np.testing.assert_allclose(next(read_frames(path, images=scaled)).depth, depth, atol=2e-4)


def test_stamps_from_names_that_are_seconds(tmp_path: Path) -> None:
    path = tmp_path / "tum" / "depth"
    path.mkdir(parents=True)
    (tmp_path / "tum/rgb").mkdir()
    for name in ("1305031453.374112", "1305031453.40"):
        Image.fromarray(depth_mm(0)).save(path / f"{name}.png")
    (tmp_path / "tum/camera.json").write_text(json.dumps({"fx": 60, "fy": 61, "cx": 31.5, "cy": 23.5}))
    frames = list(read_frames(tmp_path / "tum"))
    assert [f.stamp_ns for f in frames] == [1305031453374112000, 1305031453400000000]
    assert frames[0].camera == CAMERA
    frames = list(read_frames(tmp_path / "tum", images=ImageOptions(fps=10.0)))
    assert frames[1].stamp_ns - frames[0].stamp_ns == 100_000_000


def test_bad_images_are_left_out_and_told(tmp_path: Path) -> None:
    path = _pngs(tmp_path / "a")
    (path / "3.png").write_bytes(b"\x89PNG no image")
    Image.fromarray(np.zeros((48, 64, 3), np.uint8)).save(path / "5.png")
    np.save(path / "6.npy", np.array([{}], dtype=object), allow_pickle=True)
    with (path / "7.npy").open("wb") as stream:  # says that it holds two terabytes
        header = {"descr": "<u2", "fortran_order": False, "shape": (9_999_999, 99_999)}
        np.lib.format.write_array_header_1_0(stream, header)
        stream.write(bytes(100))
    reader = DepthReader(path, images=GIVEN)
    frames = list(reader)
    assert [round((f.stamp_ns - 1_000_000_000) / STEP_NS) for f in frames] == [0, 1, 2, 4, 7, *range(9, 14)]
    assert "4 damaged images, left out" in reader.damage[0]


def test_a_folder_of_images_needs_a_camera(tmp_path: Path) -> None:
    path = _pngs(tmp_path / "a")
    with pytest.raises(InputError, match="--intrinsics"):
        DepthReader(path)
    (path / "camera.json").write_text('{"fx": "many"}')
    with pytest.raises(InputError, match="json cannot be read"):
        DepthReader(path)
    for text in ("1,2,3", "a,b,c,d", "1,2,3,inf"):
        with pytest.raises(ConfigError, match="FX,FY,CX,CY"):
            ImageOptions.parse(text, None, None)
    with pytest.raises(ConfigError, match="fps"):
        ImageOptions.parse(None, None, 0.0)
    assert ImageOptions.parse("1,2,3,4", None, 5.0) == ImageOptions(1.0, 2.0, 3.0, 4.0, None, 5.0)


# What is not read


@pytest.mark.parametrize(
    ("name", "head", "says"),
    [
        ("a.oni", b"NI10", "OpenNI's .oni; .*16-bit PNG"),
        ("a.mkv", b"\x1a\x45\xdf\xa3", "azure_kinect_ros_driver"),
        ("a.bag", b"#ROSBAG V1.2\n", "rosbag fix"),
        ("a.mcap.gz", b"\x1f\x8b\x08", "gunzip"),
        ("a.mp4", b"\0\0\0\x20ftypisom", "colour video"),
        ("a.svo2", b"SVO", "ZED"),
        ("a.png", b"\x89PNG\r\n", "folder of all images"),
        ("a.txt", b"hello", "is not a supported recording; supported formats are MCAP"),
    ],
)
def test_other_formats_are_refused_with_what_to_do(tmp_path: Path, name: str, head: bytes, says: str) -> None:
    (tmp_path / name).write_bytes(head + bytes(100))
    with pytest.raises(InputError, match=says):
        Recording(tmp_path / name)


def test_a_folder_without_recordings_says_what_can_be_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no recording in it; supported formats are MCAP"):
        Recording(tmp_path)
    (tmp_path / "metadata.yaml").write_text("a: [&a 1, *a")
    with pytest.raises(InputError, match="ros2 bag reindex"):
        Recording(tmp_path)


def _channel(path: Path, encoding: str, kind: str, data: bytes, topic: str = IMAGE) -> Path:
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema(kind, "x", b"")
        writer.add_message(writer.register_channel(topic, encoding, schema), 1, data, 1)
        writer.finish()
    return path


@pytest.mark.parametrize(
    ("encoding", "kind", "data", "says"),
    [
        ("json", "foxglove.RawImage", b"{}", "in JSON, not ROS 2's CDR"),
        ("protobuf", "foxglove.RawImage", b"", "in protobuf"),
        ("ros1", "custom_msgs/Depth", b"", "ROS 1's custom_msgs/msg/Depth, which is not one of"),
        ("cdr", schemas.IMAGE, b"\x28\xb5\x2f\xfd....", "individually compressed"),
        ("cdr", schemas.IMAGE, b"\0\1\0\0", "cannot be read"),
        ("cdr", schemas.COMPRESSED, b"\0\1\0\0", "holds colour images; depth is mostly on topics"),
        ("cdr", "sensor_msgs/msg/Imu", b"\0\1\0\0", "sensor_msgs/msg/Imu"),
    ],
)
def test_why_a_topic_is_no_depth(tmp_path: Path, encoding: str, kind: str, data: bytes, says: str) -> None:
    path = _channel(tmp_path / "a.mcap", encoding, kind, data)
    with pytest.raises(InputError, match=f"no depth image.*{IMAGE} .*{says}"):
        DepthReader(path)


def test_colours_are_said_to_be_no_depth(tmp_path: Path) -> None:
    data = messages(1)[1][3].replace(b"16UC1", b"bgr8 ")
    with pytest.raises(InputError, match="Image of bgr8 , which is not depth"):
        DepthReader(_channel(tmp_path / "a.mcap", "cdr", schemas.IMAGE, data))


def test_a_topic_that_was_asked_for_and_cannot_be_read(tmp_path: Path) -> None:
    path = _channel(tmp_path / "a.mcap", "json", "foxglove.RawImage", b"{}")
    with pytest.raises(InputError, match=f"{IMAGE} cannot be read: in JSON"):
        DepthReader(path, IMAGE)


@pytest.mark.parametrize("has_definitions", [True, False])
def test_skeletons_of_a_database(tmp_path: Path, has_definitions: bool) -> None:
    """Also of one by a ROS before definitions were written with the messages."""
    from test_mcap import _skeleton

    from depth_pose.io.skeleton_cdr import write_people, write_skeleton

    with Writer2(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        for topic, kind, data in (
            (schemas.PEOPLE_TOPIC, schemas.SKELETON_ARRAY, write_people([_skeleton(1)], 1, "optical")),
            (schemas.SKELETON_TOPIC, schemas.SKELETON, write_skeleton(_skeleton(1))),
        ):
            text = schemas.schema_text(kind)
            connection = writer.add_connection(topic, kind, msgdef=text, rihs01="RIHS01_" + "0" * 64)
            writer.write(connection, 1, data)
    if not has_definitions:
        with sqlite3.connect(next((tmp_path / "bag").glob("*.db3"))) as database:
            database.execute("DROP TABLE message_definitions")
            database.execute("UPDATE schema SET schema_version = 3")
    (people,) = read_people(tmp_path / "bag")
    (followed,) = read_skeletons(tmp_path / "bag")
    for got in (*people.skeletons, followed):
        np.testing.assert_array_equal(got.positions, _skeleton(1).positions)
        np.testing.assert_array_equal(got.build, _skeleton(1).build)


def test_a_bad_camera_is_said_with_its_file(tmp_path: Path) -> None:
    path = _pngs(tmp_path / "a")
    camera = {"fx": 60, "fy": 61, "cx": 31.5, "cy": 23.5}
    (path / "camera.json").write_text(json.dumps(camera | {"fps": 0}))
    with pytest.raises(InputError, match=r"camera\.json.*fps"):
        DepthReader(path)
    (path / "camera.json").write_text("\ufeff" + json.dumps(camera))
    assert next(iter(DepthReader(path))).camera == CAMERA


def test_names_and_archives_that_are_no_images_times(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.mkdir()
    for name in ("4000000000.25", "4000000000.75"):  # more seconds than a stamp holds
        np.save(path / f"{name}.npy", np.full((48, 64), 2.0, np.float32))
    with (path / "5000000000.5.npy").open("wb") as stream:
        np.savez(stream, depth=np.ones((48, 64)))
    (path / "6000000000.5.npy").write_bytes(b"PK\x03\x04 no archive")
    reader = DepthReader(path, images=GIVEN)
    assert [f.stamp_ns for f in reader] == [1_000_000_000, 1_000_000_000 + STEP_NS]
    assert "2 damaged images, left out" in reader.damage[0]


S = 1_000_000_000
TIMES = {
    "1305031453.374112": 1_305_031_453 * S + 374_112_000,
    "1700000000123": 1_700_000_000 * S + 123_000_000,
    "1700000000123456": 1_700_000_000 * S + 123_456_000,
    "1700000000123456789": 1_700_000_000 * S + 123_456_789,
    "depth_1700000000123": 1_700_000_000 * S + 123_000_000,
    "2023-11-14_22-13-20.250": 1_700_000_000 * S + 250_000_000,
    "20231114T221320": 1_700_000_000 * S,
    "000001": None,
    "frame-000000.depth": None,
    "2023-13-14_22-13-20": None,
    "9999999999123": None,
}


@pytest.mark.parametrize("name", TIMES)
def test_names_that_are_times_are_stamps_and_others_are_reported(tmp_path, name):
    np.save(tmp_path / f"{name}.npy", np.full((48, 64), 2.0, np.float32))
    reader = DepthReader(tmp_path, images=replace(GIVEN, fps=None))
    (frame,) = reader
    noted = [line for line in reader.warnings if "30 a second are assumed" in line]
    assert frame.stamp_ns == (TIMES[name] or S) and len(noted) == (TIMES[name] is None)
    assert not any("are no times" in line for line in DepthReader(tmp_path, images=GIVEN).warnings)


@pytest.mark.parametrize("rest", [b"", bytes(1 << 16), b"\x89MCAP0\r\n"], ids=["empty", "zeros", "cut"])
@pytest.mark.parametrize("metadata", [True, False])
@pytest.mark.parametrize("bad", [0, 1])
def test_intact_parts_of_a_split_bag_are_used(tmp_path: Path, rest: bytes, metadata: bool, bad: int) -> None:
    whole = _rosbag2(tmp_path / "whole", StoragePlugin.MCAP)
    (data,) = whole.glob("*.mcap")
    folder = tmp_path / "split"
    folder.mkdir()
    for part in (0, 1):
        (folder / f"bag_{part}.mcap").write_bytes(rest if part == bad else data.read_bytes())
    if metadata:
        values = yaml.safe_load((whole / "metadata.yaml").read_text())
        values["rosbag2_bagfile_information"]["relative_file_paths"] = ["bag_0.mcap", "bag_1.mcap"]
        (folder / "metadata.yaml").write_text(yaml.safe_dump(values))
    reader = DepthReader(folder)
    assert len(list(reader)) == FRAMES
    assert any(f"bag_{bad}.mcap" in line for line in reader.damage)
    with pytest.raises(InputError, match="bag_0"):
        (folder / f"bag_{1 - bad}.mcap").write_bytes(rest)
        list(DepthReader(folder))


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_packed_files_without_metadata_are_read(tmp_path: Path, plugin: StoragePlugin) -> None:
    folder = _rosbag2(tmp_path / "a", plugin, CompressionMode.FILE)
    (folder / "metadata.yaml").unlink()
    assert len(list(DepthReader(folder))) == FRAMES
    (source,) = find_sources([folder])
    assert len(list(DepthReader(source.path))) == FRAMES and not source.name.endswith(".mcap")


@pytest.mark.parametrize("ending", [".tiff", ".PGM", ".exr"])
def test_images_of_other_formats_are_named_with_what_to_do(tmp_path: Path, ending: str) -> None:
    (tmp_path / f"1{ending}").write_bytes(b"II*\0")
    says = f"its {ending.lower()} images are not read: convert them to 16-bit PNG"
    with pytest.raises(InputError, match=says):
        Recording(tmp_path, GIVEN)
    with pytest.raises(InputError, match=says):
        find_sources([tmp_path])


def test_a_second_name_of_a_recording_is_mentioned(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    write(tmp_path / "a.mcap")
    (tmp_path / "b.mcap").symlink_to(tmp_path / "a.mcap")
    (source,) = find_sources([tmp_path])
    assert source.name == "a"
    assert [r.message for r in caplog.records] == [
        f"{tmp_path / 'b.mcap'} is the same recording as {tmp_path / 'a.mcap'}: it is run once"
    ]
