"""The four nodes over real DDS give what the pipeline gives in one process."""

import numpy as np
import pytest
import scene
from depth_pose_msgs.msg import Packed, Skeleton, SkeletonArray
from diagnostic_msgs.msg import DiagnosticArray
from peer import LIMIT_S

from depth_pose.bank import Bank
from depth_pose.core.config import DenoiseConfig, PipelineConfig, RecoverConfig, SegmentConfig
from depth_pose.core.pose_match import PoseMatch as Match
from depth_pose.core.skeleton import Source
from depth_pose.io.mcap_read import read_frames
from depth_pose.perception import Perception
from depth_pose.pipeline import PosePipeline
from depth_pose.ros.messages.basics import stamp_to_ns
from depth_pose.ros.messages.matches import matches_to_msg, msg_to_matches
from depth_pose.ros.messages.skeletons import msg_to_skeleton
from depth_pose.ros.process.supervisor import Suite
from depth_pose.ros.tools.bag import play

IMAGE, INFO = "/camera/depth/image_raw", "/camera/depth/camera_info"
FRAMES = 20


def assert_same(a, b):
    """Within 0.1 mm: some numbers travel as float32."""
    for name in ("stamp_ns", "frame_id", "body_id", "source"):
        assert getattr(a, name) == getattr(b, name), name
    for name in ("confidence", "residual", "scale", "positions", "quats_xyzw", "joint_confidence", "build"):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), atol=1e-4, err_msg=name)
    np.testing.assert_array_equal(a.joint_states, b.joint_states)


def listeners(told):
    """How many listen to each node's output, as it last said."""
    return {
        status.name.rpartition("/")[2]: int({v.key: v.value for v in status.values}["listeners"])
        for message in told
        for status in message.status
    }


def test_live_equals_offline(tmp_path, bank_path, peer):
    recording = scene.write_recording(tmp_path / "small.mcap", FRAMES)
    # so strict a limit that some frames are recovered
    pipeline = PosePipeline(Bank.load(bank_path), PipelineConfig(recover=RecoverConfig(min_confidence=1.0)))
    expected = [pipeline.process_frame(frame) for frame in read_frames(recording)]
    assert sum(not r.skeleton.is_lost for r in expected) >= FRAMES - 2
    assert sum(r.skeleton.source == Source.RECOVERED for r in expected) >= 3

    lines = []
    lossless = {"reliable": True, "queue": 200, "recover.min_confidence": 1.0}
    with Suite(bank=bank_path, parameters=lossless, sink=lines.append) as suite:
        told = peer.listen(DiagnosticArray, "/diagnostics", 200)
        skeletons = peer.listen(Skeleton, "/depth_pose/skeleton", 200)
        everybody = peer.listen(SkeletonArray, "/depth_pose/skeletons", 200)
        matches = peer.listen(Packed, "/depth_pose/match", 200)
        # a publisher finds its subscribers first: the nodes tell how many listen to them
        wanted = {"matcher": 2, "recovery": 1}
        peer.until(lambda: wanted.items() <= listeners(told).items(), what="this test as a listener")
        play(recording, rate=2.0, wait_for_subscribers=[IMAGE, INFO], wait_s=LIMIT_S)

        def said():
            came = {stamp_to_ns(s.header.stamp) for s in skeletons}
            missing = [k for k, r in enumerate(expected) if r.skeleton.stamp_ns not in came]
            return f"the skeletons of frames {missing}:\n" + "\n".join(lines)

        peer.until(lambda: min(map(len, (skeletons, everybody, matches))) >= FRAMES, what=said)
        assert suite.stop() == dict.fromkeys(("denoise", "matcher", "refine", "recovery"), 0)
    for message, want in zip(matches, expected, strict=True):
        for got, match in zip(msg_to_matches(message)[1], want.matches, strict=True):
            assert (got.body_id, got.bank_id) == (match.body_id, match.bank_id)
            assert got.scale == pytest.approx(match.scale, abs=1e-5)
            assert [c.exemplar for c in got.candidates] == [c.exemplar for c in match.candidates]
    for got, want in zip(map(msg_to_skeleton, skeletons), expected, strict=True):
        assert_same(got, want.skeleton)
    for message, want in zip(everybody, expected, strict=True):
        for got, skeleton in zip(map(msg_to_skeleton, message.skeletons), want.skeletons, strict=True):
            assert_same(got, skeleton)


def test_frames_matched_with_another_bank_are_dropped(start, bank_path, peer):
    process = start("-m", "depth_pose.ros.nodes.refine_node", "--ros-args", "-p", f"bank:={bank_path}")
    process.wait_for("is ready")
    matches = peer.publisher(Packed, "/depth_pose/match")
    people = Perception(SegmentConfig(), DenoiseConfig()).perceive(next(scene.frames(1)))
    foreign = matches_to_msg([Match(p.body_id, "foreign", 1.0, ()) for p in people.persons], people)
    peer.ask(
        lambda: matches.publish(foreign),
        lambda: "dropped, other bank" in process.output,
        what=lambda: f"the drop:\n{process.output}\nit",
    )


def test_a_damaged_bank_is_refused(start, tmp_path):
    bank = tmp_path / "bank.npz"
    bank.write_bytes(b"nonsense" * 100)
    process = start("-m", "depth_pose.ros.nodes.matcher_node", "--ros-args", "-p", f"bank:={bank}")
    assert process.process.wait(LIMIT_S) == 2
    assert str(bank) in process.output and "Traceback" not in process.output
