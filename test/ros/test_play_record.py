"""Playing what others recorded, as it was offered; recording so that nothing is lost that was there."""

import os
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import scene
from geometry_msgs.msg import TransformStamped
from mcap.reader import make_reader
from mcap.writer import Writer
from peer import LIMIT_S, RELIABLE
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Reader as Rosbags2Reader
from rosbags.rosbag2 import Writer as Rosbags2Writer
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from depth_pose.core.errors import InputError
from depth_pose.io.image_options import ImageOptions
from depth_pose.io.messages import write_image
from depth_pose.io.recording import Recording
from depth_pose.ros.messages.basics import make_header, stamp_to_ns
from depth_pose.ros.tools.bag import Player, Recorder
from depth_pose.ros.tools.recorded_qos import is_latched
from little_memory import little_memory, yaml_bombs

IMAGE, INFO = "/camera/depth/image_raw", "/camera/depth/camera_info"
FRAMES = 20
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return scene.write_recording(tmp_path_factory.mktemp("bag") / "small.mcap", FRAMES)


@pytest.fixture(params=["mcap", "sqlite3, messages packed"])
def folder(request, recording, tmp_path):
    """The same as a folder of rosbag2."""
    plugin = StoragePlugin.MCAP if request.param == "mcap" else StoragePlugin.SQLITE3
    writer = Rosbags2Writer(tmp_path / "bag", version=9, storage_plugin=plugin)
    if plugin == StoragePlugin.SQLITE3:
        writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    whole = Recording(recording)
    store = get_typestore(Stores.ROS2_JAZZY)
    with writer:
        made = {n: writer.add_connection(n, t.kind, typestore=store) for n, t in whole.topics.items()}
        for message in whole.messages(*whole.topics):
            writer.write(made[message.topic], message.log_time_ns, message.data)
    return tmp_path / "bag"


def test_folders_are_played_and_topics_renamed(folder, peer):
    images = peer.listen(Image, "/left/depth", RELIABLE)
    player = Player(folder, rate=10.0, remap={IMAGE: "/left/depth"}, wait_for=1, wait_s=LIMIT_S)
    thread = threading.Thread(target=lambda: setattr(player, "result", player.run()))
    thread.start()
    peer.until(lambda: len(images) == FRAMES, what="all images")
    thread.join(LIMIT_S)
    assert player.result.messages == {IMAGE: FRAMES, INFO: FRAMES} and not player.result.damage
    wanted = [frame.stamp_ns for frame in scene.frames(FRAMES)]
    assert [stamp_to_ns(m.header.stamp) for m in images] == wanted


def test_images_of_a_folder_are_played(tmp_path, peer):
    for i in range(3):
        np.save(tmp_path / f"{i}.npy", np.full((48, 64), 1000 + i, np.uint16))
    images = peer.listen(Image, IMAGE, RELIABLE)
    player = Player(
        tmp_path, wait_for_subscribers=[IMAGE], wait_s=LIMIT_S, images=ImageOptions(60, 60, 31.5, 23.5)
    )
    thread = threading.Thread(target=player.run)
    thread.start()
    peer.until(lambda: len(images) == 3, what="all images")
    thread.join(LIMIT_S)
    assert [np.frombuffer(m.data, "<u2")[0] for m in images] == [1000, 1001, 1002]


def test_nothing_is_lost_to_nodes_that_run_already(recording, peer):
    """Without being told to wait for anybody."""
    images, infos = peer.listen(Image, IMAGE, RELIABLE), peer.listen(CameraInfo, INFO, RELIABLE)
    peer.spin(0.5)
    thread = threading.Thread(target=lambda: play_here(recording))
    thread.start()
    peer.until(lambda: len(images) == len(infos) == FRAMES, what=lambda: f"{len(images)} images, all")
    thread.join(LIMIT_S)


def play_here(recording):
    return Player(recording, rate=2.0).run()


def test_waiting_for_a_number_of_subscribers(recording, peer):
    peer.listen(Image, IMAGE, RELIABLE)
    said = ""
    for wait_s in (1.0, 4.0, 16.0):  # where that is long enough for the first one
        with pytest.raises(InputError, match="of 2") as refused:
            Player(recording, wait_for=2, wait_s=wait_s).run()
        said = str(refused.value)
        if "1 of 2" in said:
            break
    assert "1 of 2" in said
    with pytest.raises(InputError, match="no topic /nothing that could be renamed"):
        Player(recording, remap={"/nothing": "/a"}).run()
    with pytest.raises(InputError, match="cannot be a topic"):
        Player(recording, remap={IMAGE: "/a b"}).run()


def test_the_delay_is_kept(recording, domain):
    started, first = time.monotonic(), []
    player = Player(recording, rate=50.0, delay_s=0.5, on_message=lambda *_: first.append(time.monotonic()))
    player.run()
    assert first[0] - started >= 0.5


def _static_transforms(path, qos):
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        schema = writer.register_schema("geometry_msgs/msg/TransformStamped", "ros2msg", b"")
        offered = {"offered_qos_profiles": qos} if qos else {}
        for topic in ("/latched", "/tf_static", "/fleeting"):
            metadata = offered if topic == "/latched" else {}
            channel = writer.register_channel(topic, "cdr", schema, metadata)
            message = TransformStamped(child_frame_id=topic)
            writer.add_message(channel, 0, serialize_message(message), 0)
        writer.add_message(channel, 600_000_000_000, serialize_message(message), 0)
        writer.finish()
    return path


@pytest.mark.parametrize("durability", ["transient_local", "1"])
def test_what_was_latched_is_so_again(tmp_path, peer, durability):
    """Who comes after the only message has it."""
    path = _static_transforms(tmp_path / "a.mcap", f"- history: 1\n  durability: {durability}\n")
    began = threading.Event()
    player = Player(path, on_message=lambda *_: began.set())
    thread = threading.Thread(target=player.run)
    thread.start()
    assert began.wait(LIMIT_S)
    heard = [peer.listen(TransformStamped, topic, LATCHED) for topic in ("/latched", "/tf_static")]
    peer.until(lambda: all(heard), what="both transforms")
    player.stop()
    thread.join(LIMIT_S)
    assert [h[0].child_frame_id for h in heard] == ["/latched", "/tf_static"]


def test_texts_of_profiles():
    assert is_latched("/tf_static", "") and not is_latched("/a", "")
    assert is_latched("/a", "- durability: 1") and not is_latched("/tf_static", "- durability: 2")
    assert not is_latched("/a", "- durability: 1\n- durability: volatile")
    for text in ("[", "a: b", "- 1", "&a [*a", "- {durability: [1]}", "\0"):
        assert not is_latched("/a", text)
    for bomb in yaml_bombs():
        with little_memory():
            assert is_latched("/tf_static", bomb) and not is_latched("/a", bomb)


def test_what_is_recorded_says_what_was_offered(tmp_path, peer):
    path = tmp_path / "out.mcap"
    latched = peer.node.create_publisher(Header, "/latched", LATCHED)
    best_effort = QoSProfile(depth=3, reliability=ReliabilityPolicy.BEST_EFFORT)
    fast = peer.node.create_publisher(Header, "/fast", best_effort)
    with Recorder(path, ["/latched", "/fast"]) as recorder:
        assert recorder.wait_subscribed(timeout_s=LIMIT_S)
        latched.publish(Header(stamp=make_header(1, "").stamp))
        assert recorder.wait_for("/latched", 1, LIMIT_S)
        for _ in range(int(LIMIT_S)):  # best effort
            fast.publish(Header(stamp=make_header(1, "").stamp))
            if recorder.wait_for("/fast", 1, 1.0):
                break
    topics = Recording(path).topics
    assert is_latched("/latched", topics["/latched"].qos)
    assert not is_latched("/fast", topics["/fast"].qos)
    with Rosbags2Reader(path) as reader:  # somebody else's reader
        offered = {c.topic: c.ext.offered_qos_profiles[0] for c in reader.connections}
    assert offered["/latched"].durability.name == "TRANSIENT_LOCAL"
    assert offered["/fast"].reliability.name == "BEST_EFFORT"
    assert offered["/fast"].durability.name == "VOLATILE"


def test_an_existing_file_stays_until_there_is_something_to_write(tmp_path, peer):
    path = tmp_path / "out.mcap"
    path.write_bytes(b"old")
    with Recorder(path, ["/numbers"]):
        assert path.read_bytes() == b"old"
    assert path.read_bytes() == b"old" and list(tmp_path.iterdir()) == [path]
    numbers = peer.node.create_publisher(Header, "/numbers", RELIABLE)
    with Recorder(path, ["/numbers"]) as recorder:
        assert recorder.wait_subscribed(timeout_s=LIMIT_S)
        assert path.read_bytes() == b"old"
        peer.until(numbers.get_subscription_count, what="the recorder")
        numbers.publish(Header())
        assert recorder.wait_for("/numbers", 1, LIMIT_S)
        assert path.read_bytes() == b"old"
    assert path.read_bytes() != b"old"
    assert list(tmp_path.iterdir()) == [path]
    with path.open("rb") as stream:
        assert len(list(make_reader(stream).iter_messages())) == 1
    with pytest.raises(InputError, match="device"):
        Recorder("/dev/null").start()


_ON_A_SMALL_DISK = """
import resource, sys
from depth_pose.cli import main
from depth_pose.core import outputs
outputs.TRIAL_BYTES = 1
resource.setrlimit(resource.RLIMIT_FSIZE, (3_000_000, 3_000_000))
sys.argv = ["depth-pose", "record", "-o", sys.argv[1], "--seconds", "60", "/noise"]
main()
"""


def test_a_disk_that_fills_up_ends_a_recording_and_what_came_before_is_there(tmp_path, peer, start):
    path, partial = tmp_path / "out.mcap", tmp_path / "out.partial.mcap"
    path.write_bytes(b"old")
    rng = np.random.default_rng(1)
    noise = peer.node.create_publisher(Image, "/noise", RELIABLE)
    recording = start("-c", _ON_A_SMALL_DISK, path)
    began = time.monotonic()
    while recording.process.poll() is None:
        data = rng.integers(0, 256, 200_000, np.uint8).tobytes()  # which does not pack
        noise.publish(Image(height=400, width=500, step=500, encoding="mono8", data=data))
        peer.spin(0.02)
        assert time.monotonic() - began < LIMIT_S, recording.output
    assert recording.process.returncode == 1
    (line,) = [x for x in recording.output.splitlines() if x.startswith("error:")]
    assert "out.mcap cannot be written: File too large; what was recorded before that is in" in line
    assert "Traceback" not in recording.output
    assert path.read_bytes() == b"old" and sorted(tmp_path.glob("*.mcap")) == [path, partial]
    assert "ends too early" in read_damaged(partial)


def read_damaged(path):
    recording = Recording(path)
    assert list(recording.messages("/noise")), "not one message can be read"
    return " ".join(recording.damage)


def hostile(path, topics, gap_ns=0):
    """Write a recording of good images, the last one after a gap, and of other topics, one message each."""
    frames = list(scene.frames(3))
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        made = {}
        for topic, kind in {IMAGE: "sensor_msgs/msg/Image", **topics}.items():
            schema = writer.register_schema(kind, "ros2msg", b"string data")
            made[topic] = writer.register_channel(topic, "cdr", schema)
        for topic in topics:
            writer.add_message(made[topic], 1, bytes(16), 1)
        for i, frame in enumerate(frames):
            data = write_image(frame.stamp_ns, "optical", np.full((4, 4), 1000 + i, np.uint16))
            at = 1 + i * 1_000_000 + (gap_ns if i == 2 else 0)
            writer.add_message(made[IMAGE], at, data, at)
        writer.finish()
    return path


NAMES_OF_MODULES = [
    "antigravity/msg/Flight",
    "this/msg/S",
    ".x/msg/Y",
    "sensor_msgs/msg/__doc__",
    "sensor_msgs/msg/Nothing",
    "../sensor_msgs/msg/Image",
    "os/msg/Path",
    "sensor_msgs.msg/msg/Image",
]


def test_modules_that_a_recording_names_are_not_imported(tmp_path):
    """In a process of its own: what is imported once stays."""
    path = hostile(tmp_path / "a.mcap", {f"/t{i}": kind for i, kind in enumerate(NAMES_OF_MODULES)})
    code = (
        "import sys\nfrom depth_pose.ros.tools.player import Player\n"
        f"played = Player({str(path)!r}, rate=100.0).run()\n"
        "assert not {'antigravity', 'this'} & set(sys.modules)\n"
        "print(played.messages.total(), len(played.skipped), *played.skipped.values(), sep='\\n')"
    )
    environment = os.environ | {"BROWSER": f"touch {tmp_path / 'opened'}"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=LIMIT_S, env=environment
    )
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[:2] == ["3", str(len(NAMES_OF_MODULES))] and len(lines) == 2 + len(NAMES_OF_MODULES)
    assert "Traceback" not in done.stderr and not (tmp_path / "opened").exists()


def test_a_bad_topic_name_skips_that_topic(tmp_path, domain):
    path = hostile(tmp_path / "a.mcap", {"/a b": "std_msgs/msg/String", "": "std_msgs/msg/String"})
    played = Player(path, rate=100.0).run()
    assert played.messages == {IMAGE: 3}
    assert set(played.skipped) == {"/a b", ""}
    assert all("cannot be a topic" in why and "\n" not in why for why in played.skipped.values())


@pytest.mark.parametrize("years", [3, 200])
def test_a_message_years_later_is_not_waited_for(tmp_path, peer, years):
    path = hostile(tmp_path / "a.mcap", {}, gap_ns=years * 31_536_000_000_000_000)
    images = peer.listen(Image, IMAGE, RELIABLE)
    player = Player(path, wait_for=1, wait_s=LIMIT_S)
    thread = threading.Thread(target=lambda: setattr(player, "result", player.run()))
    thread.start()
    peer.until(lambda: len(images) == 3, what="all images")
    thread.join(LIMIT_S)
    assert player.result.wall_s < LIMIT_S  # and not years
    (line,) = player.result.gaps
    assert "hours later than the one before; not waited for" in line
