"""Playing and recording over real DDS; recordings of the tests' own."""

import signal
import threading
import time
from collections import defaultdict

import pytest
import scene
from mcap.reader import make_reader
from mcap_ros2.reader import read_ros2_messages
from peer import LIMIT_S, RELIABLE, patient
from rclpy.duration import Duration
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from depth_pose.core.errors import InputError
from depth_pose.io.mcap_read import read_frames
from depth_pose.ros.messages.basics import make_header, stamp_to_ns
from depth_pose.ros.tools.bag import Player, Recorder, header_stamp_ns, play
from depth_pose.ros.tools.message_text import message_text

IMAGE, INFO = "/camera/depth/image_raw", "/camera/depth/camera_info"
FRAMES = 30


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return scene.write_recording(tmp_path_factory.mktemp("bag") / "small.mcap", FRAMES)


def recorded_bytes(path):
    out = defaultdict(list)
    with path.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages():
            out[channel.topic].append(message.data)
    return out


def test_what_is_played_and_recorded_again_is_the_same(recording, tmp_path, domain):
    again = tmp_path / "again.mcap"
    with Recorder(again, [IMAGE, INFO]) as recorder:
        played = play(recording, rate=4.0, wait_for_subscribers=[IMAGE, INFO], wait_s=LIMIT_S)
        assert recorder.wait_for(IMAGE, FRAMES, LIMIT_S) and recorder.wait_for(INFO, FRAMES, LIMIT_S)
    assert played.messages == {IMAGE: FRAMES, INFO: FRAMES} and not played.damage
    assert recorded_bytes(again) == recorded_bytes(recording)
    names = {m.channel.topic: m.schema.name for m in read_ros2_messages(again)}
    assert names == {IMAGE: "sensor_msgs/msg/Image", INFO: "sensor_msgs/msg/CameraInfo"}
    for a, b in zip(read_frames(again), scene.frames(FRAMES), strict=True):
        assert a.stamp_ns == b.stamp_ns and (a.depth == b.depth).all()


def test_timing_and_clock(recording, peer):
    arrivals, clock = [], peer.listen(Clock, "/clock", RELIABLE)
    peer.node.create_subscription(Image, IMAGE, lambda m: arrivals.append(time.monotonic()), RELIABLE)
    length = (FRAMES - 1) * scene.STEP_NS / 1e9

    def attempt():
        """Play; gives the times on ``/clock``, and whether a machine that did not stand still would."""
        arrivals.clear()
        clock.clear()
        player = Player(recording, rate=1.0, wait_for_subscribers=[IMAGE], wait_s=LIMIT_S, topics=[IMAGE])
        thread = threading.Thread(target=lambda: setattr(player, "result", player.run()))
        thread.start()
        peer.until(lambda: len(arrivals) == FRAMES, what="all images")
        thread.join(LIMIT_S)
        peer.spin(0.3)
        took_s = (arrivals[-1] - arrivals[0], player.result.wall_s)
        times = [stamp_to_ns(c.clock) for c in clock]
        assert times == sorted(times) and player.result.wall_s > length - 0.05
        is_whole = len(times) > FRAMES and times[0] <= scene.START_NS + scene.STEP_NS and times[-1] == last_ns
        return is_whole and took_s == pytest.approx((length, length), abs=patient(0.05))

    last_ns = scene.START_NS + (FRAMES - 1) * scene.STEP_NS
    assert any(attempt() for _ in range(10))


def test_loop_starts_again(recording, peer):
    images = peer.listen(Image, IMAGE, RELIABLE)

    def stamps():
        return [stamp_to_ns(m.header.stamp) for m in images]

    player = Player(
        recording, rate=20.0, loop=True, clock=False, wait_for_subscribers=[IMAGE], wait_s=LIMIT_S
    )
    thread = threading.Thread(target=player.run)
    thread.start()
    # at this rate more may come than waits for a subscriber that stands still for seconds
    peer.until(
        lambda: scene.turns(stamps()) > 2 and len(set(stamps())) == FRAMES, what="a third round, all frames"
    )
    player.stop()
    thread.join(LIMIT_S)
    assert not thread.is_alive()
    assert stamps()[0] == min(stamps())


def test_truncated_recording_plays_to_its_last_whole_chunk(tmp_path, domain, peer):
    path, cut = tmp_path / "whole.mcap", tmp_path / "cut.mcap"
    with Recorder(path, ["/numbers"]) as recorder:
        numbers = peer.node.create_publisher(Header, "/numbers", RELIABLE)
        peer.until(numbers.get_subscription_count, what="the recorder")
        for i in range(3000):  # more than one chunk
            numbers.publish(Header(stamp=make_header(i, "").stamp, frame_id=f"{i:06d}" * 100))
            if i % 200 == 199:
                assert recorder.wait_for("/numbers", i + 1, LIMIT_S)
    whole = path.read_bytes()
    cut.write_bytes(whole[: int(len(whole) * 0.8)])
    peer.listen(Header, "/numbers", RELIABLE)
    sent = []
    result = Player(
        cut,
        rate=1e3,
        clock=False,
        wait_for_subscribers=["/numbers"],
        wait_s=LIMIT_S,
        on_message=lambda message, wall_ns: sent.append(message.data),
    ).run()
    assert "ends too early" in result.damage[0]
    assert 100 < len(sent) == result.messages["/numbers"] < 3000
    assert sent == recorded_bytes(path)["/numbers"][: len(sent)]


def test_what_cannot_be_played_is_said(recording, tmp_path, domain):
    with pytest.raises(InputError, match="cannot be read"):
        play(tmp_path / "none.mcap")
    text = tmp_path / "text.mcap"
    text.write_text("this is no recording" * 10)
    with pytest.raises(InputError, match="not a supported recording"):
        play(text)
    with pytest.raises(InputError, match="/camera/depth/image_raw"):
        play(recording, topics=["/nothing"])
    with pytest.raises(InputError, match="nobody subscribed"):
        play(recording, wait_for_subscribers=[IMAGE], wait_s=0.2)
    with pytest.raises(InputError, match="rate"):
        play(recording, rate=0.0)


def test_schema_text_is_whole():
    text = message_text("sensor_msgs/msg/CameraInfo")
    parts = text.split("=" * 80 + "\n")
    assert [p.splitlines()[0] for p in parts[1:]] == [
        "MSG: std_msgs/Header",
        "MSG: sensor_msgs/RegionOfInterest",
        "MSG: builtin_interfaces/Time",
    ]
    assert "float64[9]" in parts[0]
    with pytest.raises(InputError):
        message_text("nonsense")


def test_stamp_of_serialised_messages(recording):
    expected = [frame.stamp_ns for frame in scene.frames(FRAMES)]
    assert [header_stamp_ns(data) for data in recorded_bytes(recording)[IMAGE]] == expected


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_record_ends_with_a_whole_file(start, tmp_path, peer, number):
    path = tmp_path / "out.mcap"
    code = f"from depth_pose.ros.tools.bag import record; print(record({str(path)!r}), flush=True)"
    process = start("-c", code)
    infos = peer.publisher(CameraInfo, INFO, RELIABLE)
    for i in range(5):
        infos.publish(CameraInfo(header=make_header(i, "optical")))
    assert infos.wait_for_all_acked(Duration(seconds=LIMIT_S))  # it has them; whether it took them or not
    exit_code, _ = process.end(number)
    assert exit_code == 0, process.output
    assert len(recorded_bytes(path)[INFO]) == 5
