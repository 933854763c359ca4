"""People, matches and skeletons as no node of ours makes them, over real DDS: counted, said, and survived."""

import math
from functools import partial

import numpy as np
import pytest
import scene
from depth_pose_msgs.msg import Packed, SkeletonArray
from diagnostic_msgs.msg import DiagnosticArray
from hri_msgs.msg import IdsList
from peer import HEARING, RELIABLE, SENSOR
from rclpy.serialization import deserialize_message, serialize_message

from depth_pose.core.errors import InputError
from depth_pose.core.packing import pack, unpack
from depth_pose.ros.messages.basics import make_header, stamp_to_ns
from depth_pose.ros.messages.fits import FIT_KINDS, msg_to_fitted
from depth_pose.ros.messages.matches import MATCH_KINDS, msg_to_matches
from depth_pose.ros.messages.people import msg_to_people
from depth_pose.track.packed_people import PEOPLE_KINDS

START_NS = scene.START_NS + 10**12
INPUTS = {"matcher": "people", "refine": "match", "recovery": "skeletons_refined"}
OUTPUTS = {"matcher": "match", "refine": "skeletons_refined", "recovery": "skeletons"}
KINDS = {
    "people": PEOPLE_KINDS,
    "match": (*PEOPLE_KINDS, *MATCH_KINDS),
    "skeletons_refined": (*PEOPLE_KINDS, *FIT_KINDS),
}
FRAME, RECORDS, DEPTHS, LABELS, MORE, DATA = range(6)
"""The arrays of a message; the last two are matches and their candidates, or fits and their vertices."""


@pytest.fixture(scope="module")
def valid(bank):
    """One frame's messages, by topic."""
    return scene.frame_messages(bank)[1]


def of_first(array, **values):
    """Change fields of an array's first record."""

    def change(arrays):
        for name, value in values.items():
            arrays[array][name][0] = value

    return change


def twice(array):
    def change(arrays):
        arrays[array] = np.repeat(arrays[array], 2)

    return change


def crowd(array):
    def change(arrays):
        arrays[array] = np.repeat(arrays[array], 10_000)
        arrays[array]["body_id"] = [f"body_{i}".encode() for i in range(len(arrays[array]))]

    return change


def at_first(array, value):
    def change(arrays):
        arrays[array][0] = value

    return change


def odd_depth(arrays):
    arrays[DEPTHS][np.flatnonzero(arrays[LABELS] == 1)[0]] = math.nan


def moved_window(arrays):
    arrays[RECORDS]["box"][0, :2] = -1


def cut(array):
    def change(arrays):
        arrays[array] = arrays[array][:-9]

    return change


PEOPLE = {
    "a/b": (of_first(RECORDS, body_id="a/b"), "have the id 'a/b'; an id is of letters"),
    "a b": (of_first(RECORDS, body_id="a b"), "have the id 'a b'"),
    "no id": (of_first(RECORDS, body_id=""), "have the id ''"),
    "ümläut": (of_first(RECORDS, body_id="ümläut".encode()), "have the id 'ümläut'"),
    "no text": (of_first(RECORDS, body_id=b"\xff"), "have the id"),
    "twice": (twice(RECORDS), "the people have 'body_1' twice"),
    "crowd": (crowd(RECORDS), "of 10000 people; at most 255"),
    "nan": (of_first(RECORDS, places=math.nan), "a measured joint has the number nan"),
    "heels": (of_first(RECORDS, heel_count=7), "has 7 heels"),
    "sides": (of_first(RECORDS, sides=math.nan), "the sides of a measurement has the confidence nan"),
    "grid": (of_first(FRAME, grid=math.nan), "the camera has the number nan"),
    "window": (of_first(RECORDS, box=(0, 0, 999, 10)), "the windows have"),
    "moved window": (moved_window, "a window of"),
    "empty window": (of_first(RECORDS, box=(0, 0, 0, 0)), "the windows have"),
    "depth": (odd_depth, "points within 1000 m"),
    "label": (at_first(LABELS, 99), "points within 1000 m"),
    "cut": (cut(LABELS), "the windows have"),
}
MATCHES = {
    "match a/b": (of_first(MORE, body_id="a/b"), "the matches have the id 'a/b'"),
    "match twice": (twice(MORE), "the matches have 'body_1' twice"),
    "match nan": (of_first(MORE, scale=math.nan), "the scale of body_1 is nan"),
    "match count": (of_first(MORE, count=77), "candidates, not 77"),
    "match turn": (of_first(DATA, rotation=0.0), "no rotation"),
}
FITTED = {
    "fitted a/b": (of_first(MORE, body_id="a/b"), "the fits have the id 'a/b'"),
    "fitted joint": (of_first(MORE, nodes=math.nan), "nodes of a fit has the number nan"),
    "fitted source": (of_first(MORE, source=99), "the source of a fit is 99"),
    "fitted twice": (twice(MORE), "the fits have 'body_1' twice"),
    "fitted crowd": (crowd(MORE), "of 10000 people; at most 255"),
    "fitted skin": (at_first(DATA, math.inf), "a vertex has the number inf"),
}
CASES = {
    "matcher": ("people", PEOPLE),
    "refine": ("match", PEOPLE | MATCHES),
    "recovery": ("skeletons_refined", PEOPLE | FITTED),
}


def changed(valid, topic, change, stamp_ns):
    """Copy of a frame's message, changed, of another stamp."""
    message = deserialize_message(serialize_message(valid[topic]), Packed)
    message.header.stamp = make_header(stamp_ns, "").stamp
    if change is not None:
        arrays = unpack(bytes(message.data), KINDS[topic])
        change(arrays)
        message.data = pack(arrays)
    return message


def refused(name):
    """Every case of one node."""
    return [(CASES[name][0], what) for what in CASES[name][1]]


@pytest.mark.parametrize(("topic", "name"), [case for node in CASES for case in refused(node)])
def test_each_is_refused_with_a_clear_message(valid, body, topic, name):
    change, says = (PEOPLE | MATCHES | FITTED)[name]
    read = {"people": msg_to_people, "match": msg_to_matches}
    message = changed(valid, topic, change, START_NS)
    with pytest.raises(InputError) as refusal:
        read.get(topic, partial(msg_to_fitted, vertices=len(body.vertices)))(message)
    assert says in str(refusal.value) and len(str(refusal.value)) < 300


class Node:
    """One node, live, its publishers, and what it tells."""

    def __init__(self, name, start, peer, bank_path):
        self.name, self.peer, self.number = name, peer, 0
        given = ["-p", f"bank:={bank_path}"]
        given += ["-p", "rep155:=true", "-p", "tf:=true"] if name == "recovery" else []
        self.process = start("-m", f"depth_pose.ros.nodes.{name}_node", "--ros-args", *given)
        self.process.wait_for("is ready", 240.0)
        kind = SkeletonArray if name == "recovery" else Packed
        self.answers = peer.listen(kind, f"/depth_pose/{OUTPUTS[name]}", HEARING)
        self.told = peer.listen(DiagnosticArray, "/diagnostics", RELIABLE)
        self.out = peer.publisher(Packed, f"/depth_pose/{INPUTS[name]}", SENSOR)
        peer.until(lambda: self.told_of("listeners") > 0, what="its word that this test listens")

    def told_of(self, what):
        """A count of its last diagnostics."""
        return int({v.key: v.value for s in self.told[-1:] for v in s.status[0].values}.get(what, 0))

    def dropped(self, reason):
        return self.told_of(f"dropped: {reason}")

    def send(self, valid, change=None):
        """Send a frame of the next stamp; gives it."""
        self.number += 1
        stamp_ns = START_NS + 40_000_000 * self.number
        self.out.publish(changed(valid, INPUTS[self.name], change, stamp_ns))
        return stamp_ns

    def is_answered(self, stamp_ns):
        return any(stamp_to_ns(m.header.stamp) >= stamp_ns for m in self.answers)

    def answer(self, valid):
        """Have a frame answered that is as it should be; gives its stamp."""
        since = START_NS + 40_000_000 * (self.number + 1)
        self.peer.ask(
            partial(self.send, valid),
            lambda: self.is_answered(since),
            what=lambda: f"an answer of the {self.name} node:\n{self.process.output}",
        )
        return stamp_to_ns(self.answers[-1].header.stamp)


@pytest.mark.parametrize("name", INPUTS)
def test_a_live_node_counts_and_survives_them(name, valid, start, peer, bank_path):
    node, cases = Node(name, start, peer, bank_path), CASES[name][1]
    node.answer(valid)
    peer.spin(1.0)  # what was sent twice
    node.answers.clear()

    def send_all():
        for change, _ in cases.values():
            node.send(valid, change)
            peer.spin(0.1)

    peer.ask(
        send_all,
        lambda: node.dropped("bad input") >= len(cases),
        what=lambda: f"the drops: {node.dropped('bad input')}\n{node.process.output}",
        every_s=1.5,
    )
    assert not node.answers and node.dropped("error") == 0
    assert "dropped, bad input" in node.process.output and "Traceback" not in node.process.output
    node.answer(valid)
    assert node.process.process.poll() is None


def test_only_names_that_topics_can_have_are_tracked(valid, start, peer, bank_path):
    """With rep155 topics are named by the ids: no odd one gets that far."""
    node = Node("recovery", start, peer, bank_path)
    tracked = peer.listen(IdsList, "/humans/bodies/tracked", RELIABLE)
    node.answer(valid)
    peer.ask(partial(node.send, valid), lambda: any(m.ids for m in tracked), what="somebody tracked")

    def both(arrays):
        for array in (RECORDS, MORE):
            arrays[array]["body_id"][0] = "a/../b c"

    peer.ask(partial(node.send, valid, both), lambda: node.dropped("bad input") > 0, what="the drop")
    assert {i for m in tracked for i in m.ids} == {"b1"}
    assert not [n for n, _ in peer.node.get_topic_names_and_types() if "b c" in n]
