"""Second answers over real DDS, for people whose left and right cannot be told."""

from dataclasses import replace
from itertools import count

import numpy as np
from builtin_interfaces.msg import Time
from depth_pose_msgs.msg import FittedArray, People, SkeletonArray
from diagnostic_msgs.msg import DiagnosticArray
from peer import RELIABLE
from sensor_msgs.msg import PointCloud2

from acted import the_bank
from depth_pose.core.skeleton import MIRROR_JOINTS
from depth_pose.ros.messages.people import people_to_msgs
from depth_pose.ros.messages.skeletons import fitted_to_msg, msg_to_skeleton
from doubtful import doubted, see


def unlikely(people):
    """The same people, each with a probability of 0.01."""
    return replace(
        people, persons=tuple(replace(p, found=replace(p.found, probability=0.01)) for p in people.persons)
    )


def test_the_recovery_node_publishes_second_answers(start, tmp_path, peer):
    bank = tmp_path / "bank.npz"
    the_bank().save(bank)
    process = start("-m", "depth_pose.ros.nodes.recovery_node", "--ros-args", "-p", f"bank:={bank}")
    process.wait_for("is ready")
    first = peer.listen(SkeletonArray, "/depth_pose/skeletons")
    second = peer.listen(SkeletonArray, "/depth_pose/alternatives")
    clouds = peer.publisher(PointCloud2, "/depth_pose/points")
    found = peer.publisher(People, "/depth_pose/people")
    bodies = peer.publisher(FittedArray, "/depth_pose/skeletons_refined")
    seen, sent = see(), count(1)

    def sender(people):
        messages = (*people_to_msgs(people), fitted_to_msg(seen.refined, people))

        def send():
            stamp = Time(sec=next(sent))
            for publisher, message in zip((clouds, found, bodies), messages, strict=True):
                message.header.stamp = stamp
                publisher.publish(message)

        return send

    told = peer.listen(DiagnosticArray, "/diagnostics", RELIABLE)
    nobody = "nobody is found: people are seen, but no pose fits them"
    doubtful = sender(unlikely(doubted(seen, 0.6)))
    peer.ask(doubtful, lambda: nobody in process.output, what="why nobody is answered", every_s=0.1)
    peer.until(lambda: any(nobody in s.message for m in told for s in m.status), what="the diagnostics")
    assert not any(m.skeletons for m in first) and process.output.count(nobody) == 1
    for sides in (0.6, 0.99):
        send = sender(doubted(seen, sides))
        first.clear(), second.clear()
        peer.ask(send, lambda: first and second, what=lambda: f"the answers:\n{process.output}\nthey")
        (answer,) = first[-1].skeletons
        others = second[-1].skeletons
        assert len(others) == (sides < 0.9)
        for other in others:
            assert (other.body_id, other.header.stamp) == (answer.body_id, answer.header.stamp)
            exchanged = msg_to_skeleton(other).positions[MIRROR_JOINTS]
            assert np.linalg.norm(exchanged - msg_to_skeleton(answer).positions, axis=1).mean() < 0.08
