"""People, matches and skeletons as no node of ours makes them, over real DDS: counted, said, and survived."""

import math
from functools import partial

import numpy as np
import pytest
import scene
from depth_pose_msgs.msg import (
    FittedArray,
    JointMeasurement,
    People,
    PoseMatchArray,
    Skeleton,
    SkeletonArray,
    TrackedPerson,
)
from diagnostic_msgs.msg import DiagnosticArray
from hri_msgs.msg import IdsList
from peer import HEARING, RELIABLE, SENSOR
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2

from depth_pose.body.build import BuildSpace
from depth_pose.core.errors import InputError
from depth_pose.ros.messages.basics import make_header, stamp_to_ns
from depth_pose.ros.messages.matches import msg_to_matches
from depth_pose.ros.messages.people import msgs_to_people
from depth_pose.ros.messages.skeletons import msg_to_fitted

START_NS = scene.START_NS + 10**12
KINDS = {
    "points": PointCloud2,
    "people": People,
    "match": PoseMatchArray,
    "skeletons_refined": FittedArray,
    "skeletons": SkeletonArray,
}
INPUTS = {
    "matcher": ("points", "people"),
    "refine": ("points", "people", "match"),
    "recovery": ("points", "people", "skeletons_refined"),
}
OUTPUTS = {"matcher": "match", "refine": "skeletons_refined", "recovery": "skeletons"}


@pytest.fixture(scope="module")
def valid(bank):
    """One frame's messages, by topic."""
    return scene.frame_messages(bank)[1]


def first(messages, topic):
    return next(getattr(messages[topic], n)[0] for n in ("people", "matches", "skeletons") if hasattr(
        messages[topic], n))  # fmt: skip


def named(topic, body_id):
    def change(messages):
        first(messages, topic).body_id = body_id

    return change


def twice(topic, name):
    def change(messages):
        setattr(messages[topic], name, 2 * list(getattr(messages[topic], name)))

    return change


def crowd(messages):
    messages["people"].people = [TrackedPerson(label=i % 256, body_id=f"body_{i}") for i in range(10_000)]


def crowd_of_skeletons(messages):
    messages["skeletons_refined"].skeletons = [Skeleton(body_id=f"body_{i}") for i in range(10_000)]
    messages["skeletons_refined"].scores = 10_000 * [0.5]


def set_first(topic, **values):
    def change(messages):
        for name, value in values.items():
            setattr(first(messages, topic), name, value)

    return change


def measured(**values):
    def change(messages):
        first(messages, "people").measured = [JointMeasurement(**values)]

    return change


def odd_joint(messages):
    first(messages, "skeletons_refined").joints[3].position.x = math.nan


def odd_turn(messages):
    candidate = first(messages, "match").candidates[0]
    candidate.transform.rotation.x = candidate.transform.rotation.w = 0.0
    candidate.transform.rotation.y = candidate.transform.rotation.z = 0.0


def odd_fields(messages):
    messages["points"].fields[3].name = "intensity"


def cut_points(messages):
    messages["points"].data = messages["points"].data[:-16]


def odd_grid(messages):
    messages["people"].fx = math.nan


PEOPLE = {
    "a/b": (named("people", "a/b"), "have the id 'a/b'; an id is of letters"),
    "a b": (named("people", "a b"), "have the id 'a b'"),
    "no id": (named("people", ""), "have the id ''"),
    "ümläut": (named("people", "ümläut"), "have the id 'ümläut'"),
    "long": (named("people", "x" * 100_000), "have the id 'xxx"),
    "twice": (twice("people", "people"), "the people have 'body_1' twice"),
    "crowd": (crowd, "of 10000 people; at most 255"),
    "nan": (measured(places=np.full(57, math.nan, "f4")), "a measured joint of body_1 has the number nan"),
    "heels": (measured(heels=[0.0] * 7), "has 7 numbers of heels"),
    "sides": (measured(sides=math.nan), "the sides of body_1 is nan"),
    "grid": (odd_grid, "focal lengths nan"),
    "fields": (odd_fields, "intensity at 12"),
    "cut": (cut_points, "bytes of data, not"),
}
MATCHES = {
    "match a/b": (named("match", "a/b"), "the matches have the id 'a/b'"),
    "match twice": (twice("match", "matches"), "the matches have 'body_1' twice"),
    "match nan": (set_first("match", scale=math.nan), "the scale of body_1 is nan"),
    "match turn": (odd_turn, "no quaternion"),
}
FITTED = {
    "fitted a/b": (named("skeletons_refined", "a/b"), "the skeletons have the id 'a/b'"),
    "fitted joint": (odd_joint, "a joint of body_1 has the number nan"),
    "fitted source": (set_first("skeletons_refined", source=99), "the skeleton's source is 99"),
    "fitted twice": (twice("skeletons_refined", "skeletons"), "2 skeletons"),
    "fitted crowd": (crowd_of_skeletons, "of 10000 people; at most 255"),
}
CASES = {"matcher": PEOPLE, "refine": PEOPLE | MATCHES, "recovery": PEOPLE | FITTED}


def changed(valid, topics, change, stamp_ns):
    """Copies of a frame's messages, changed, of another stamp."""
    messages = {t: deserialize_message(serialize_message(valid[t]), KINDS[t]) for t in topics}
    for message in messages.values():
        for part in (message, *getattr(message, "skeletons", ())):
            part.header.stamp = make_header(stamp_ns, "").stamp
    if change is not None:
        change(messages)
    return messages


@pytest.fixture(scope="module")
def space(body):
    return BuildSpace(body)


@pytest.mark.parametrize("name", PEOPLE | MATCHES | FITTED)
def test_each_is_refused_with_a_clear_message(valid, space, name):
    change, says = (PEOPLE | MATCHES | FITTED)[name]
    messages = changed(valid, KINDS, change, START_NS)
    with pytest.raises(InputError) as refused:
        msgs_to_people(messages["points"], messages["people"])
        msg_to_matches(messages["match"])
        msg_to_fitted(messages["skeletons_refined"], space)
    assert says in str(refused.value) and len(str(refused.value)) < 300


class Node:
    """One node, live, its publishers, and what it tells."""

    def __init__(self, name, start, peer, bank_path):
        self.name, self.peer, self.number = name, peer, 0
        given = ["-p", f"bank:={bank_path}"]
        given += ["-p", "rep155:=true", "-p", "tf:=true"] if name == "recovery" else []
        self.process = start("-m", f"depth_pose.ros.nodes.{name}_node", "--ros-args", *given)
        self.process.wait_for("is ready", 240.0)
        self.answers = peer.listen(KINDS[OUTPUTS[name]], f"/depth_pose/{OUTPUTS[name]}", HEARING)
        self.told = peer.listen(DiagnosticArray, "/diagnostics", RELIABLE)
        self.out = {t: peer.publisher(KINDS[t], f"/depth_pose/{t}", SENSOR) for t in INPUTS[name]}
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
        for topic, message in changed(valid, INPUTS[self.name], change, stamp_ns).items():
            self.out[topic].publish(message)
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
    node, cases = Node(name, start, peer, bank_path), CASES[name]
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

    def both(messages):
        for topic in ("people", "skeletons_refined"):
            named(topic, "a/../b c")(messages)

    peer.ask(partial(node.send, valid, both), lambda: node.dropped("bad input") > 0, what="the drop")
    assert {i for m in tracked for i in m.ids} == {"b1"}
    assert not [n for n, _ in peer.node.get_topic_names_and_types() if "b c" in n]
