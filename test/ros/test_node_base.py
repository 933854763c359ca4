"""The base of the nodes, over real DDS, with a stage of the tests' own (`trial_node`)."""

import itertools
import signal
import time
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from peer import HEARING, LIMIT_S, RELIABLE, SENSOR, within
from rcl_interfaces.srv import DescribeParameters, SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Header

from depth_pose.ros.messages.basics import make_header

TRIAL = Path(__file__).with_name("trial_node.py")
A, ANSWER = "/depth_pose/a", "/depth_pose/answer"


def image(stamp_ns, width=2):
    return Image(header=make_header(stamp_ns, "optical"), height=1, width=width)


@pytest.fixture
def trial(start, peer):
    """Start the node with parameters; give process, answers and the publisher.

    All have met by then: frames of the stamps 1 and 2 were answered.
    """

    def make(qos=None, **parameters):
        given = [x for k, v in parameters.items() for x in ("-p", f"{k}:={v}")]
        process = start(TRIAL, *(["--ros-args", *given] if given else []))
        process.wait_for("is ready")
        more = {"qos": qos} if qos else {}
        answers = peer.listen(Header, ANSWER, RELIABLE if qos else HEARING)
        images = peer.publisher(Image, A, **more)
        for stamp in (1, 2):  # the second only once, after which nothing of the first is under way
            peer.ask(
                lambda stamp=stamp: images.publish(image(stamp)),
                lambda stamp=stamp: answers and answers[-1].stamp.nanosec == stamp,
                what=lambda: f"an answer:\n{process.output}",
                every_s=1.0 if stamp == 1 else LIMIT_S,
            )
        answers.clear()
        return process, answers, images

    return make


def figure(peer, statuses, name):
    peer.until(lambda: statuses, what="diagnostics")
    return {v.key: v.value for v in statuses[-1].status[0].values}.get(name)


def test_answers_and_lives_through_errors(trial, peer):
    process, answers, images = trial(qos=RELIABLE, reliable="true", queue=100)
    statuses = peer.listen(DiagnosticArray, "/diagnostics", RELIABLE)
    peer.until(lambda: len(statuses) > 1, what="diagnostics")
    before = {name: int(figure(peer, statuses, name) or 0) for name in ("answered", "dropped: same stamp")}

    def counted(name):
        return int(figure(peer, statuses, name) or 0) - before.get(name, 0)

    for stamp in (5, 6):
        images.publish(image(stamp))
        peer.until(lambda stamp=stamp: answers and answers[-1].stamp.nanosec == stamp, what="the answer")
    images.publish(image(7, width=13))
    process.wait_for("RuntimeError: thirteen")
    for stamp in (8, 8, 3):  # one stamp twice, then one from the past
        twice = answers[-1].stamp.nanosec == stamp
        images.publish(image(stamp))
        if twice:
            statuses.clear()
            peer.until(lambda: counted("dropped: same stamp") == 1, what="the count")
        else:
            peer.until(lambda stamp=stamp: answers[-1].stamp.nanosec == stamp, what="the answer")
    assert [m.stamp.nanosec for m in answers] == [5, 6, 8, 3]
    assert answers[-1].frame_id.endswith(" 1")  # the stage was reset after the error
    statuses.clear()
    peer.until(lambda: counted("answered") == 4, what="the count of answers")
    assert counted("dropped: error") == 1
    assert counted("dropped: same stamp") == 1
    assert counted("stamps going back") == 1
    assert "Traceback" in process.output and "went back" in process.output
    code, _ = process.end(signal.SIGTERM)
    assert code == 0


def test_newest_frame_wins_and_every_drop_is_counted(trial, peer):
    _, answers, images = trial(bank="'0.2'")
    statuses = peer.listen(DiagnosticArray, "/diagnostics", RELIABLE)
    peer.until(lambda: len(statuses) > 1, what="diagnostics")
    names = ("answered", "dropped: overtaken", "dropped: missed", "dropped: lost in transport")
    before = {name: int(figure(peer, statuses, name) or 0) for name in names}

    def counted(name):
        return int(figure(peer, statuses, name) or 0) - before[name]

    sent, newest = 40, 1000
    for stamp in range(newest - sent + 1, newest):
        images.publish(image(stamp))
        peer.spin(0.02)
    again = 0

    def send_again():  # the newest may have been lost
        nonlocal again
        images.publish(image(newest))
        again += 1

    is_there = lambda: answers and answers[-1].stamp.nanosec == newest  # noqa: E731
    peer.ask(send_again, is_there, what="the newest frame's answer", every_s=5.0)
    stamps = [m.stamp.nanosec for m in answers]
    assert stamps == sorted(stamps) and len(set(stamps)) == len(stamps)
    assert len(stamps) < sent
    peer.spin(0.2)
    statuses.clear()
    peer.until(lambda: counted("answered") == len(stamps), what="the count of answers")
    dropped = sum(counted(name) for name in names[1:])
    assert sent - len(stamps) <= dropped <= sent - 1 + again - len(stamps)


def test_lossless_mode_answers_every_frame_in_order(trial, peer):
    _, answers, images = trial(qos=RELIABLE, reliable="true", queue=100, bank="'0.02'")
    for stamp in range(11, 61):
        images.publish(image(stamp))
    peer.until(lambda: len(answers) == 50, what="all 50 answers")
    assert [m.stamp.nanosec for m in answers] == list(range(11, 61))


def test_parameters_have_ranges_and_can_be_set(trial, peer):
    _, answers, images = trial(**{"segment.near": 1})  # a whole number is a number
    request = DescribeParameters.Request(names=["segment.near", "queue"])
    near, queue = peer.call(DescribeParameters, "/depth_pose/trial/describe_parameters", request).descriptors
    assert near.floating_point_range[0].to_value == 20.0 and "[m]" in near.description
    assert queue.read_only

    def put(name, value):
        return peer.put("/depth_pose/trial", name, value)

    assert put("segment.working_height", 100).successful
    refused = put("segment.working_height", 5)
    assert not refused.successful and refused.reason
    assert not put("queue", 3).successful
    assert put("zone", "1:4.5").successful  # one of the names without a section
    assert not put("zone", "near").successful
    beyond = put("segment.near", 9.0)  # farther than segment.far
    assert not beyond.successful and "nothing lies between" in beyond.reason
    peer.ask(lambda: images.publish(image(3)), lambda: answers, what="the answer")
    assert answers[0].frame_id == "100 0"


def test_frames_that_come_while_settings_are_taken_are_missed(trial, peer):
    process, answers, images = trial()
    wanted = Parameter("segment.working_height", value=900).to_parameter_msg()
    client = peer.node.create_client(SetParameters, "/depth_pose/trial/set_parameters")
    peer.until(client.service_is_ready, what="the service")
    future, stamps = client.call_async(SetParameters.Request(parameters=[wanted])), itertools.count(10)
    while not future.done():
        images.publish(image(next(stamps)))
        peer.spin(0.02)
    peer.ask(
        lambda: images.publish(image(next(stamps))), lambda: len(answers) > 3, what="answers", every_s=0.1
    )
    process.wait_for("this node was busy")  # and not lost in transport


def test_bytes_that_are_no_message_do_not_end_it(trial, peer):
    """What decodes to no message of the type, as another program may send, is survived and counted."""
    process, answers, images = trial()
    for rubbish in (b"", b"\x00\x01\x00\x00", b"\x00\x01\x00\x00" + b"\xff" * 40, bytes(range(64))):
        images.publish(rubbish)
        peer.spin(0.05)
    assert process.process.poll() is None, process.output
    peer.ask(
        lambda: images.publish(image(3)),
        lambda: answers,
        what=lambda: "the answer:\n" + process.output,
    )


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("segment.nearest:=1.0", "segment.nearest"),
        ("segment.near:=-1.0", "segment.near"),
        ("segment.near:=close", "segment.near"),
        ("zone:=near", "zone is 'near'"),
        ("bogus:=1", "bogus"),
    ],
)
def test_bad_parameters_end_the_start(start, given, said):
    process = start(TRIAL, "--ros-args", "-p", given)
    assert process.process.wait(LIMIT_S) == 2
    assert said in process.output and "Traceback" not in process.output


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        (Image, f"{A} has 1 publisher(s) but nothing came"),
        (PointCloud2, "it carries sensor_msgs/msg/PointCloud2"),
    ],
)
def test_silence_is_told_within_three_seconds(start, peer, kind, said):
    def attempt():
        process = start(TRIAL)
        process.wait_for("is ready")
        publisher = peer.node.create_publisher(kind, A, 1)
        began = time.monotonic()
        process.wait_for(said)
        took = time.monotonic() - began
        peer.node.destroy_publisher(publisher)
        process.end(signal.SIGTERM)
        return took

    within(3.2, attempt)


def test_incompatible_qos_is_told_within_three_seconds(start, peer):
    """A best-effort publisher never reaches a reliable subscriber; DDS itself says nothing."""

    def attempt():
        process = start(TRIAL, "--ros-args", "-p", "reliable:=true")
        process.wait_for("is ready")
        out = peer.node.create_publisher(Image, A, SENSOR)
        began = time.monotonic()
        while f"{A} has 1 publisher(s) but nothing came" not in process.output:
            out.publish(image(time.monotonic_ns() % 10**9))
            peer.spin(0.05)
            assert time.monotonic() - began < LIMIT_S, process.output
        took = time.monotonic() - began
        process.wait_for("asks for reliable")
        peer.node.destroy_publisher(out)
        process.end(signal.SIGTERM)
        return took

    within(3.2, attempt)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_it_cleanly(start, number):
    def early():
        process = start(TRIAL)
        process.wait_for("imports done")  # an interrupt before is Python's, and may become any error
        code, seconds = process.end(number)
        # what is imported later: an extension makes an ImportError of the interrupt, and a class that is
        # being made (before Python 3.12) a RuntimeError
        last = process.output.rpartition("KeyboardInterrupt")[2]
        made_of_it = ("ImportError: initialization failed", "RuntimeError: Error calling __set_name__")
        is_interrupted = last != process.output and any(text in last for text in made_of_it)
        assert code in (0, -number) or (number == signal.SIGINT and is_interrupted), process.output
        return seconds

    def late():
        process = start(TRIAL)
        process.wait_for("is ready")
        code, seconds = process.end(number)
        assert code == 0, process.output
        return seconds

    within(1.0, early)
    within(1.0, late)
