"""Messages with odd content into every subscription of every node: each is answered or counted, none ends it.

The nodes are real, in this process; what comes is a valid frame's messages with one to three fields replaced.
The seeds are fixed. `DEPTH_POSE_FUZZ` sets how many messages each node gets.
"""

import math
import os
import random
import re
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "ros"))
COUNT = int(os.environ.get("DEPTH_POSE_FUZZ", "120"))

NUMBERS = (0.0, -1.0, 1.0, 1e-310, 1e30, -1e300, math.inf, -math.inf, math.nan)
WHOLE = (0, 1, 2, 3, 7, 19, 127, 255, 256, 65535, 2**31 - 1, 2**32 - 1, -1, -(2**31))
TEXTS = ("", "16UC1", "32FC1", "mono8", "x", "body_1", "é" * 40, "16UC1; compressedDepth rvl", "plumb_bob")
LIMITS = {
    "float": (-3.4e38, 3.4e38),
    **{f"uint{n}": (0, 2**n - 1) for n in (8, 16, 32, 64)},
    **{f"int{n}": (-(2 ** (n - 1)), 2 ** (n - 1) - 1) for n in (8, 16, 32, 64)},
    "octet": (0, 255),
}


def odd_value(kind, value, rng):
    """Return another value of a field's type; sequences become shorter, longer, empty or of odd elements."""
    sequence = re.fullmatch(r"sequence<([\w/]+)(?:, \d+)?>|([\w/]+)\[(\d+)\]", kind)
    if sequence:
        inner, fixed = sequence.group(1) or sequence.group(2), sequence.group(3)
        items = list(value)
        if not fixed:
            size = rng.choice((0, 1, len(items) // 2, max(len(items) - 1, 0), len(items) + 1))
            items = (items + items[:1])[:size]
        if items and len(items) < 5000 and rng.random() < 0.5:
            k = rng.randrange(len(items))
            items[k] = odd_value(inner, items[k], rng)
        return items
    if "/" in kind:
        return mutate(value, rng)
    if kind == "string":
        return rng.choice(TEXTS)
    if kind == "boolean":
        return not value
    if kind in ("float", "double"):
        number = rng.choice(NUMBERS)
        low, high = LIMITS.get(kind, (-math.inf, math.inf))
        return number if not math.isfinite(number) else min(max(number, low), high)
    low, high = LIMITS[kind]
    return min(max(rng.choice(WHOLE), low), high)


def mutate(message, rng):
    """Replace one to three fields, however deep."""
    fields = list(message.get_fields_and_field_types().items())
    for name, kind in rng.sample(fields, min(len(fields), rng.randint(1, 3))):
        setattr(message, name, odd_value(kind, getattr(message, name), rng))
    return message


def copy_of(message):
    from rclpy.serialization import deserialize_message, serialize_message

    return deserialize_message(serialize_message(message), type(message))


@pytest.fixture(scope="module")
def valid(bank_path):
    """Build a frame's messages, by topic, as the stages make them."""
    import scene
    from test_denoise_node import image_msg, info_msg

    from depth_pose.bank import Bank

    frame, messages = scene.frame_messages(Bank.load(bank_path))
    return {"image": image_msg(frame), "info": info_msg(frame), **messages}


@pytest.fixture(scope="module")
def context(bank_path):
    """A domain of its own, on this machine alone, and the tests' bank as every node's."""
    import rclpy
    from peer import join_own_domain

    with pytest.MonkeyPatch.context() as patch:
        join_own_domain(patch)
        patch.setenv("DEPTH_POSE_BANK", str(bank_path))
        rclpy.init(args=[])
        yield
        rclpy.try_shutdown()


def node_of(name):
    """Make a node, as its process does."""
    import importlib

    module = importlib.import_module(f"depth_pose.ros.nodes.{name}_node")
    return getattr(module, f"{name.capitalize()}Node")()


INPUTS = {
    "denoise": ("image",),
    "matcher": ("people",),
    "refine": ("match",),
    "recovery": ("skeletons_refined",),
}


def deliver(node, number, messages):
    """Pass a frame's messages with equal stamps to the node's callbacks, and process what is pending."""
    from depth_pose.ros.messages.basics import ns_to_stamp

    for message in messages:
        message.header.stamp = ns_to_stamp(10**18 + number * 40_000_000)
        node.intake.take(message, {"publication_sequence_number": 0})
    whole = node.intake.take_pending()
    if whole is not None:
        node.process(whole)


@pytest.mark.parametrize("name", INPUTS)
def test_odd_messages_do_not_end_a_node(name, valid, context):
    rng = random.Random(7)
    node = node_of(name)
    try:
        for number in range(COUNT):
            messages = [copy_of(valid[topic]) for topic in INPUTS[name]]
            mutate(rng.choice(messages), rng)
            if name == "denoise":
                info = copy_of(valid["info"])
                node.guard("info", node.take_info, mutate(info, rng) if rng.random() < 0.3 else info)
            deliver(node, number, messages)
        told = node.statistics.answered + sum(node.statistics.drops.values())
        waiting = len(getattr(node, "held", ()))  # for the CameraInfo of their camera
        assert told + waiting >= COUNT, node.statistics.as_text()
        assert not node.statistics.drops["error"], node.statistics.as_text()
        assert sum(node.statistics.drops.values()), "not one odd message was refused"
        before = node.statistics.answered
        if name == "denoise":
            node.take_info(copy_of(valid["info"]))
        deliver(node, COUNT + 1, [copy_of(valid[topic]) for topic in INPUTS[name]])
        assert node.statistics.answered == before + 1, node.statistics.as_text()
    finally:
        node.destroy_node()
