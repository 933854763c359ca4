"""Decoders of recordings, each file through the one reader, every message of every topic decoded."""

from __future__ import annotations

import io
import sqlite3
import tempfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

import numpy as np
from decoders_messages import CAMERA, images, infos, pixels, skeleton
from harness import Decoder, from_file
from mcap.writer import CompressionType, IndexType, Writer
from PIL import Image

from depth_pose.core.errors import InputError
from depth_pose.io import schemas
from depth_pose.io.image_options import ImageOptions
from depth_pose.io.mcap_read import DepthReader
from depth_pose.io.recording import Recording, read_metadata, read_span
from depth_pose.io.skeleton_cdr import write_people, write_skeleton
from depth_pose.io.skeleton_read import read_people, read_skeletons

IMAGE, INFO = "/d/image", "/d/camera_info"


def _messages() -> list[tuple[str, str, int, bytes]]:
    found = []
    for i in range(4):
        found += [(INFO, schemas.CAMERA_INFO, i, infos()[0]), (IMAGE, schemas.IMAGE, i, images()[i % 2])]
    return found


def _mcap(messages: Sequence[tuple[str, str, int, bytes]], **options: object) -> bytes:
    stream = io.BytesIO()
    writer = Writer(stream, **options)
    writer.start("ros2")
    numbers: dict[str, int] = {}
    for topic, kind, time, data in messages:
        if topic not in numbers:
            schema = writer.register_schema(kind, "ros2msg", schemas.schema_text(kind).encode())
            numbers[topic] = writer.register_channel(topic, "cdr", schema)
        writer.add_message(numbers[topic], time, data, time)
    writer.add_metadata("depth_pose", {"a": "b"})
    writer.finish()
    return stream.getvalue()


@cache
def mcaps() -> list[bytes]:
    """Recordings of depth: packed or not, with and without an index, chunks and checksums."""
    small = {"chunk_size": 2000}
    none = {"compression": CompressionType.NONE, "enable_crcs": False}
    return [
        _mcap(_messages(), **small),
        _mcap(_messages(), **small, compression=CompressionType.LZ4),
        _mcap(_messages(), **small, **none),
        _mcap(_messages(), **small, **none, index_types=IndexType.NONE, use_statistics=False),
        _mcap(_messages(), use_chunking=False),
    ]


def skeletons() -> list[bytes]:
    """Recordings of skeletons, without checksums, so that damage comes through."""
    people = write_people([skeleton(), skeleton(1)], 7, "optical")
    messages = [
        (schemas.PEOPLE_TOPIC, schemas.SKELETON_ARRAY, 7, people),
        (schemas.SKELETON_TOPIC, schemas.SKELETON, 7, write_skeleton(skeleton())),
    ]
    return [_mcap(messages, compression=CompressionType.NONE, enable_crcs=False)]


@cache
def databases() -> list[bytes]:
    """rosbag2's SQLite file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.db3"
        database = sqlite3.connect(path)
        database.execute(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
            "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)"
        )
        database.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
            "timestamp INTEGER NOT NULL, data BLOB NOT NULL)"
        )
        database.execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
        names = {INFO: schemas.CAMERA_INFO, IMAGE: schemas.IMAGE}
        for number, (name, kind) in enumerate(names.items()):
            database.execute("INSERT INTO topics VALUES(?, ?, ?, 'cdr', '')", (number, name, kind))
        for topic, _, time, data in _messages():
            values = (list(names).index(topic), time, data)
            database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", values)
        database.commit()
        database.close()
        return [path.read_bytes()]


@cache
def bags() -> list[bytes]:
    """ROS 1 bags, packed each way."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.typesys import Stores, get_typestore

    noetic, jazzy = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_JAZZY)
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for packed in (None, Writer1.CompressionFormat.BZ2, Writer1.CompressionFormat.LZ4):
            path = Path(folder) / f"{packed}.bag"
            writer = Writer1(path)
            if packed is not None:
                writer.set_compression(packed)
            with writer:
                connections = {}
                for topic, kind, time, data in _messages():
                    if topic not in connections:
                        connections[topic] = writer.add_connection(topic, kind, typestore=noetic)
                    raw = bytes(jazzy.cdr_to_ros1(data, kind))
                    writer.write(connections[topic], time, raw)
            found.append(path.read_bytes())
    return found


def metadata() -> list[bytes]:
    """``metadata.yaml`` of a folder of one recording."""
    text = """\
rosbag2_bagfile_information:
  version: 9
  storage_identifier: mcap
  duration: {nanoseconds: 3}
  starting_time: {nanoseconds_since_epoch: 0}
  message_count: 8
  topics_with_message_count:
    - topic_metadata: {name: /d/image, type: sensor_msgs/msg/Image, serialization_format: cdr}
      message_count: 4
    - topic_metadata: {name: /d/camera_info, type: sensor_msgs/msg/CameraInfo, serialization_format: cdr}
      message_count: 4
  compression_format: ""
  compression_mode: ""
  relative_file_paths: [a.mcap]
"""
    return [text.encode()]


def pngs() -> list[bytes]:
    """An image of 16 bits."""
    stream = io.BytesIO()
    Image.fromarray(pixels()).save(stream, "PNG")
    return [stream.getvalue()]


def arrays() -> list[bytes]:
    """Arrays of millimetres and of metres."""
    found = []
    for depth in (pixels(), pixels() / 1000):
        stream = io.BytesIO()
        np.save(stream, depth)
        found.append(stream.getvalue())
    return found


def read_everything(path: Path) -> None:
    """Read all raw messages, then the frames."""
    recording = Recording(path)
    size = sum(len(message.data) for message in recording.messages(*recording.topics))
    assert size < 1 << 30 and isinstance(recording.damage, list)
    list(DepthReader(path, tell=False))


def _mcap_extras(path: Path) -> None:
    read_metadata(path, "depth_pose")
    read_span(path)
    read_everything(path)


def _skeletons(path: Path) -> None:
    try:
        list(read_skeletons(path))
    finally:
        list(read_people(path))


def _folder(path: Path) -> None:
    recording = path.with_name("a.mcap")
    if not recording.exists():
        recording.write_bytes(_mcap(_messages()))
    if not any(DepthReader(path.parent, tell=False)):
        raise InputError("no frames")


def _images(path: Path) -> None:
    given = ImageOptions(CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)
    list(DepthReader(path.parent, images=given, tell=False))


def _in_folder(read: Callable[[Path], object], name: str, folder: str) -> Callable[[bytes], object]:
    return from_file(read, f"{folder}/{name}")


DECODERS = (
    Decoder("mcap", mcaps, from_file(_mcap_extras, "a.mcap")),
    Decoder("mcap_skeletons", skeletons, from_file(_skeletons, "a.mcap")),
    Decoder("db3", databases, from_file(read_everything, "a.db3")),
    Decoder("ros1_bag", bags, from_file(read_everything, "a.bag")),
    Decoder("rosbag2_metadata", metadata, _in_folder(_folder, "metadata.yaml", "bag")),
    Decoder("png_folder", pngs, _in_folder(_images, "1.png", "png")),
    Decoder("npy_folder", arrays, _in_folder(_images, "1.npy", "npy")),
)
