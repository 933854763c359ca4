"""Frames on their way through the nodes: the next one waits for an answer, but not for ever."""

from __future__ import annotations

import struct

import pytest
import scene
from depth_pose_msgs.msg import SkeletonArray
from peer import RELIABLE
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from test_denoise_node import IMAGE, INFO, POINTS, image_msg, info_msg

from depth_pose.core.errors import InputError
from depth_pose.ros.messages.basics import first_stamp_ns, make_header, stamp_to_ns
from depth_pose.ros.transport.frames_in_flight import LONGEST_S, MOST, QUIET_S, FramesInFlight


@pytest.fixture
def full():
    """As many frames on their way as may be, at 0 s; the one before them was answered."""
    frames = FramesInFlight()
    frames.begin(0, -0.1)
    frames.arrive(0, 0.0)
    for stamp_ns in range(1, MOST + 1):
        assert not frames.is_full(0.0)
        frames.begin(stamp_ns, 0.0)
    assert frames.is_full(0.0)
    return frames


def test_an_answer_makes_room(full) -> None:
    full.arrive(1, 0.1)
    assert not full.is_full(0.1)
    full.begin(MOST + 1, 0.1)
    assert full.is_full(0.1)


def test_frames_before_the_one_that_arrived_are_not_waited_for(full) -> None:
    full.arrive(MOST, 0.1)
    for stamp_ns in range(MOST + 1, 2 * MOST + 1):
        assert not full.is_full(0.1)
        full.begin(stamp_ns, 0.1)
    assert full.is_full(0.1)


def test_an_answer_to_older_frames_makes_no_room(full) -> None:
    full.arrive(0, 0.1)
    assert full.is_full(0.1)


def test_nothing_waits_for_long(full) -> None:
    assert full.is_full(LONGEST_S - 0.01) and not full.is_full(LONGEST_S + 0.01)
    full.begin(MOST + 1, LONGEST_S + 0.01)
    assert full.is_full(LONGEST_S + 0.02)


def test_without_answers_nothing_waits() -> None:
    frames = FramesInFlight()
    for stamp_ns in range(2 * MOST):
        assert not frames.is_full(0.0)
        frames.begin(stamp_ns, 0.0)


def test_nor_where_they_have_stopped(full) -> None:
    full.begin(MOST + 1, QUIET_S)
    assert not full.is_full(QUIET_S + 0.01)


def test_a_newer_frame_takes_the_place_of_one_that_waits(full) -> None:
    assert not full.offer("older", 0.1) and not full.offer("newer", 0.1)
    assert full.release(0.1) is None and full.has_waiting
    full.arrive(1, 0.1)
    assert full.release(0.1) == "newer"
    assert full.release(0.1) is None and not full.has_waiting


def test_one_that_waited_is_not_begun_after_a_newer_one(full) -> None:
    assert not full.offer("older", 0.1)
    late_s = LONGEST_S + 0.01
    assert full.offer("newer", late_s)
    assert full.release(late_s) is None


def test_what_is_forgotten_is_not_begun(full) -> None:
    assert not full.offer("older", 0.1)
    full.forget()
    assert full.release(0.1) is None and full.offer("newer", 0.1)


def test_a_clock_that_goes_back_holds_nothing_up(full) -> None:
    full.begin(-10, 0.1)
    assert not full.is_full(0.1)


def test_a_header_s_stamp_is_read_from_the_bytes() -> None:
    stamp_ns = 1_700_000_000_123_456_789
    message = SkeletonArray(header=make_header(stamp_ns, "optical"))
    assert first_stamp_ns(bytes(serialize_message(message))) == stamp_ns


@pytest.mark.parametrize("raw", [b"", b"\0\1\0\0\0\0\0", struct.pack(">xB2xiI", 0, 1, 2)])
def test_bytes_that_hold_none_are_refused(raw: bytes) -> None:
    with pytest.raises(InputError):
        first_stamp_ns(raw)


@pytest.mark.slow
def test_the_denoise_node_begins_a_frame_for_each_that_arrives(start, peer) -> None:
    """Twelve frames, each sent once the one before is there, with answers that lag by two."""
    frames = list(scene.frames(12))
    process = start("-m", "depth_pose.ros.nodes.denoise_node")
    process.wait_for("is ready")
    seen = peer.listen(PointCloud2, POINTS)
    answers = peer.publisher(SkeletonArray, "/depth_pose/skeletons", RELIABLE)
    infos, images = peer.publisher(CameraInfo, INFO), peer.publisher(Image, IMAGE)

    def has(frame):
        return any(stamp_to_ns(m.header.stamp) == frame.stamp_ns for m in seen)

    for before, frame in zip([None, None, *frames], frames, strict=False):
        infos.publish(info_msg(frame))
        peer.ask(
            lambda frame=frame: images.publish(image_msg(frame)),
            lambda frame=frame: has(frame),
            what="points",
        )
        if before is not None:
            answers.publish(SkeletonArray(header=make_header(before.stamp_ns, "optical")))
    assert "Traceback" not in process.output
