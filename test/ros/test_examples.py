"""The examples run as they stand, in a process of their own."""

import ast
import signal
from pathlib import Path

from depth_pose_msgs.msg import Joint, Skeleton
from geometry_msgs.msg import Point
from peer import RELIABLE

from depth_pose.ros.transport.conversions import make_header

EXAMPLE = Path(__file__).parents[2] / "examples" / "subscribe_skeleton.py"


def skeleton(source, confidence=0.9, state=Joint.SEEN):
    hand = Joint(
        name="right_wrist", position=Point(x=0.5, y=-0.25, z=2.0), confidence=confidence, state=state
    )
    return Skeleton(header=make_header(1, "optical"), body_id="body_7", source=source, joints=[hand])


def test_minimal_subscriber(start, peer):
    process = start(EXAMPLE)
    out = peer.publisher(Skeleton, "/depth_pose/skeleton", RELIABLE)
    for message, words in (
        (skeleton(Skeleton.REFINED), "body_7: right hand at 0.50 -0.25 2.00"),
        (skeleton(Skeleton.RECOVERED, confidence=0.2), "body_7: right hand not seen"),
        (skeleton(Skeleton.LOST), "nobody"),
    ):
        out.publish(message)
        process.wait_for(words)
    code, _ = process.end(signal.SIGINT)
    assert code == 0, process.output


def test_it_needs_only_the_messages():
    tree = ast.parse(EXAMPLE.read_text())
    names = {alias.name for n in ast.walk(tree) if isinstance(n, ast.Import) for alias in n.names}
    names |= {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    assert {name.partition(".")[0] for name in names} == {"rclpy", "depth_pose_msgs"}
