"""The examples run as they stand, in a process of their own."""

import ast
import signal
from pathlib import Path

from depth_pose_msgs.msg import Joint, Skeleton, SkeletonArray
from geometry_msgs.msg import Point
from peer import RELIABLE

from depth_pose.ros.transport.conversions import make_header

EXAMPLE = Path(__file__).parents[2] / "examples" / "subscribe_skeleton.py"


def skeleton(body_id, confidence=0.9, state=Joint.SEEN):
    hand = Joint(
        name="right_wrist", position=Point(x=0.5, y=-0.25, z=2.0), confidence=confidence, state=state
    )
    header = make_header(1, "optical")
    return Skeleton(header=header, body_id=body_id, source=Skeleton.REFINED, joints=[hand])


def test_minimal_subscriber(start, peer):
    process = start(EXAMPLE)
    out = peer.publisher(SkeletonArray, "/depth_pose/skeletons", RELIABLE)
    both = [skeleton("body_7"), skeleton("body_8", confidence=0.2)]
    for skeletons, words in (
        (both, "body_7: right hand at 0.50 -0.25 2.00\nbody_8: right hand not seen\n"),
        ([skeleton("body_9", state=Joint.OUTSIDE_IMAGE)], "body_9: right hand not seen\n"),
        ([], "nobody\n"),
    ):
        out.publish(SkeletonArray(header=make_header(1, "optical"), skeletons=skeletons))
        process.wait_for(words)
    code, _ = process.end(signal.SIGINT)
    assert code == 0, process.output


def test_it_needs_only_the_messages():
    tree = ast.parse(EXAMPLE.read_text())
    names = {alias.name for n in ast.walk(tree) if isinstance(n, ast.Import) for alias in n.names}
    names |= {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    assert {name.partition(".")[0] for name in names} == {"rclpy", "depth_pose_msgs"}
