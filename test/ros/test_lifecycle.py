"""Managed nodes over real DDS: configured and active by themselves, paused, resumed, cleaned up."""

import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from peer import HEARING, RELIABLE, bring
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from depth_pose.core.errors import DepthPoseError
from depth_pose.ros.messages.basics import make_header
from depth_pose.ros.nodes import lifecycle
from depth_pose.ros.nodes.lifecycle import set_active

TRIAL = Path(__file__).with_name("trial_node.py")
A, ANSWER = "/depth_pose/a", "/depth_pose/answer"


def state(peer):
    return peer.call(GetState, "/depth_pose/trial/get_state", GetState.Request()).current_state.label


def change(peer, step):
    request = ChangeState.Request(transition=Transition(id=step))
    return peer.call(ChangeState, "/depth_pose/trial/change_state", request).success


class Sender:
    """Images, one after the other, until told otherwise."""

    def __init__(self, peer):
        self.peer, self.stamp = peer, 0
        self.out = peer.publisher(Image, A)

    def send(self, count=3):
        for _ in range(count):
            self.stamp += 1
            self.out.publish(Image(header=make_header(self.stamp, "optical"), height=1, width=2))
            self.peer.spin(0.05)


def test_pauses_and_resumes(start, peer):
    process = start(TRIAL)
    process.wait_for("is ready")
    assert state(peer) == "active"
    answers = peer.listen(Header, ANSWER, HEARING)
    sender = Sender(peer)
    peer.until(lambda: sender.send(1) or answers, what="an answer")

    assert bring(False, ["trial"]) == {"trial": "inactive"}
    paused = sender.stamp
    statuses = peer.listen(DiagnosticArray, "/diagnostics", RELIABLE)
    sender.send()
    peer.until(lambda: statuses and statuses[-1].status[0].message == "is paused", what="the diagnostics")
    assert all(m.stamp.nanosec <= paused for m in answers)  # some may have been under way

    assert bring(True, ["trial"]) == {"trial": "active"}
    answers.clear()
    peer.until(lambda: sender.send(1) or answers, what="an answer after the pause")
    assert answers[0].stamp.nanosec > paused + 3
    assert answers[0].frame_id.endswith(" 1")  # the pause made it forget what came before, once
    peer.until(lambda: process.output.count("is ready") == 2, what="its word that it is ready again")


def test_waits_for_a_manager_and_lets_go_when_cleaned_up(start, peer):
    process = start(TRIAL, "--ros-args", "-p", "autostart:=false")
    peer.until(lambda: peer.node.count_publishers("/diagnostics"), what="the node")
    assert state(peer) == "unconfigured"
    assert not peer.node.count_subscribers(A)
    assert change(peer, Transition.TRANSITION_CONFIGURE)
    assert state(peer) == "inactive"
    peer.until(lambda: peer.node.count_subscribers(A), what="its subscription")
    assert "is ready" not in process.output
    assert change(peer, Transition.TRANSITION_ACTIVATE)
    process.wait_for("is ready")
    assert change(peer, Transition.TRANSITION_DEACTIVATE)
    assert change(peer, Transition.TRANSITION_CLEANUP)
    peer.until(lambda: not peer.node.count_subscribers(A), what="the end of its subscription")
    peer.until(lambda: not peer.node.count_publishers(ANSWER), what="the end of its publisher")
    assert bring(True, ["trial"]) == {"trial": "active"}  # configures it first
    answers = peer.listen(Header, ANSWER, HEARING)
    sender = Sender(peer)
    peer.until(lambda: sender.send(1) or answers, what="an answer")
    assert change(peer, Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert state(peer) == "finalized"


def test_a_refused_configuration_leaves_the_node_there(start, peer, tmp_path):
    """Without autostart a missing bank is no end: it can be put there, and configured again."""
    bank = tmp_path / "bank.npz"
    process = start(
        "-m",
        "depth_pose.ros.nodes.matcher_node",
        "--ros-args",
        "-p",
        "autostart:=false",
        "-p",
        f"bank:={bank}",
    )  # fmt: skip
    peer.until(lambda: peer.node.count_publishers("/diagnostics"), what="the node")
    with pytest.raises(DepthPoseError, match="refused"):
        set_active(True, ["matcher"])
    process.wait_for(str(bank))
    assert process.process.poll() is None


def test_asks_again_where_an_answer_is_lost(peer, monkeypatch):
    """An answer to a client that the node has not met yet goes nowhere; the next client gets its own."""
    monkeypatch.setattr(lifecycle, "ANSWER_S", 1.0)
    asked = []

    def get_state(_, response):
        asked.append(True)
        if len(asked) == 1:
            time.sleep(3.0)  # nobody waits for it any more
        response.current_state.id, response.current_state.label = State.PRIMARY_STATE_ACTIVE, "active"
        return response

    peer.node.create_service(GetState, "/depth_pose/deaf/get_state", get_state)
    with ThreadPoolExecutor(1) as pool:
        done = pool.submit(bring, True, ["deaf"])
        peer.until(done.done, what="the answer")
    assert done.result() == {"deaf": "active"}
    assert len(asked) > 1


def test_says_so_where_nothing_runs(domain):
    with pytest.raises(DepthPoseError, match="is the node running"):
        set_active(False, ["nobody"], timeout_s=1.0)


_STATES = {
    ("unconfigured", Transition.TRANSITION_CONFIGURE): "inactive",
    ("inactive", Transition.TRANSITION_ACTIVATE): "active",
    ("inactive", Transition.TRANSITION_CLEANUP): "unconfigured",
    ("active", Transition.TRANSITION_DEACTIVATE): "inactive",
}
"""The transitions that are possible, but for those that end the node."""


def test_200_random_transitions_are_all_answered(start, peer):
    """Those that are not possible are refused with a line; the node works on."""
    process = start(TRIAL, "--ros-args", "-p", "autostart:=false")
    peer.until(lambda: peer.node.count_publishers("/diagnostics"), what="the node")
    rng, now, refused = np.random.default_rng(3), "unconfigured", 0
    steps = sorted({step for _, step in _STATES}) + [77]
    for _ in range(200):
        step = int(rng.choice(steps))
        after = _STATES.get((now, step))
        assert change(peer, step) is (after is not None), (now, step, process.output[-2000:])
        refused += after is None
        now = after or now
    assert state(peer) == now
    process.wait_for("is not possible from")
    assert process.output.count("is not possible from") >= refused - 1 and refused > 50
    assert "Traceback" not in process.output
    bring(True, ["trial"])
    answers, sender = peer.listen(Header, ANSWER, HEARING), Sender(peer)
    peer.until(lambda: sender.send(1) or answers, what="an answer")
