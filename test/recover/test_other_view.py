"""Second answers, for people whose left and right cannot be told."""

from __future__ import annotations

import numpy as np
import pytest

from acted import posed, the_bank
from depth_pose.core.config import MountConfig
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.mount import rotate_to_sensor
from depth_pose.core.skeleton import JOINT_INDEX, JOINTS, MIRROR_JOINTS, NODE_INDEX
from depth_pose.core.types import Skeleton, alternatives_of
from depth_pose.io.mcap_write import SkeletonWriter
from depth_pose.io.schemas import ALTERNATIVES_TOPIC, PEOPLE_TOPIC
from depth_pose.io.skeleton_read import read_people
from depth_pose.pipeline import FrameResult
from depth_pose.recover.other_view import renew_sides
from depth_pose.track.state import Sides
from doubtful import CONFIG, doubted, see
from stages import make_recoverer

STEP_NS = 100_000_000


@pytest.fixture(scope="module")
def seen() -> FrameResult:
    return see()


def answer(seen: FrameResult, sides: float) -> Skeleton:
    """The skeleton where the joint net names left and right with a probability."""
    stage = make_recoverer(the_bank(), smooth=CONFIG.smooth)
    (skeleton,) = stage.recover(doubted(seen, sides), seen.refined)
    return skeleton


def found(joints: np.ndarray, sides: float) -> JointMeasurement:
    sure, sigma = np.ones(len(JOINTS), np.float32), np.full((len(JOINTS), 2), 0.05, np.float32)
    return JointMeasurement(joints.astype(np.float32), sigma, sure, sides=sides)


def test_a_doubtful_view_has_a_second_answer(seen) -> None:
    skeleton = answer(seen, 0.6)
    other = skeleton.alternative
    exchanged = other.positions[MIRROR_JOINTS] - skeleton.positions
    assert np.linalg.norm(exchanged, axis=1).mean() < 0.08
    across = [s["left_shoulder"].position[0] - s["right_shoulder"].position[0] for s in (skeleton, other)]
    assert across[0] > 0.25 and across[1] < -0.25  # facing the camera, and away from it
    toes = [s["left_foot"].position[2] - s["left_ankle"].position[2] for s in (skeleton, other)]
    assert toes[0] < -0.1 and toes[1] > toes[0] + 0.09  # turned, as far as the noise hides where they point
    assert other.confidence < 0.41 and other.joint_confidence.max() < 0.41
    assert (other.body_id, other.stamp_ns) == (skeleton.body_id, skeleton.stamp_ns)
    assert answer(seen, 0.95).alternative is None


def test_a_view_that_the_depth_contradicts_has_none() -> None:
    """Without noise the depth tells a chest from a back, whatever the joint net says."""
    assert answer(see(0.0), 0.6).alternative is None


class Belief:
    """Keeps the belief from frame to frame."""

    def __init__(self) -> None:
        self.sides = Sides()

    def renew(self, *given) -> float:
        self.sides, probability = renew_sides(self.sides, *given)
        return probability


def test_what_was_seen_surely_is_remembered_for_a_moment() -> None:
    joints, belief = posed(0).nodes[[NODE_INDEX[name] for name in JOINTS]], Belief()
    assert belief.renew(joints, found(joints, 0.99), 0) == pytest.approx(0.99)
    assert belief.renew(joints, found(joints, 0.6), STEP_NS) == pytest.approx(0.982, abs=0.002)
    assert belief.renew(joints, found(joints, 0.6), 20 * STEP_NS) == pytest.approx(0.6)
    assert belief.renew(joints, found(joints, 0.99), 21 * STEP_NS) == pytest.approx(0.99)
    exchanged = joints[MIRROR_JOINTS]  # the answer changes its mind, the proposals do not
    assert belief.renew(exchanged, found(joints, 0.7), 22 * STEP_NS) == pytest.approx(0.3)
    belief = Belief()
    assert belief.renew(joints, found(joints, 0.6), 23 * STEP_NS) == pytest.approx(0.6)
    assert belief.renew(joints, None, 24 * STEP_NS) == 1.0


def test_second_answers_are_recorded_on_a_topic_of_their_own(seen, tmp_path) -> None:
    doubtful, sure = answer(seen, 0.6), answer(seen, 0.95).at(STEP_NS)
    with SkeletonWriter(tmp_path / "out.mcap") as writer:
        for skeleton in (doubtful, sure):
            writer.write_people([skeleton], skeleton.stamp_ns, skeleton.frame_id)
    (frame,) = read_people(tmp_path / "out.mcap", ALTERNATIVES_TOPIC)
    (other,) = frame.skeletons
    np.testing.assert_allclose(other.positions, doubtful.alternative.positions)
    assert other.confidence == pytest.approx(doubtful.alternative.confidence)
    assert [len(frame.skeletons) for frame in read_people(tmp_path / "out.mcap", PEOPLE_TOPIC)] == [1, 1]


def test_second_answers_go_where_the_first_go(seen) -> None:
    doubtful = answer(seen, 0.6)
    assert alternatives_of([doubtful, answer(seen, 0.95)]) == (doubtful.alternative,)
    assert doubtful.at(7).alternative.stamp_ns == 7
    assert doubtful.to_dict()["alternative"] == doubtful.alternative.to_dict()
    assert "alternative" not in doubtful.alternative.to_dict()
    turned = rotate_to_sensor(doubtful, MountConfig(roll=180.0)).alternative
    row = JOINT_INDEX["head"]
    expected = doubtful.alternative.positions[row] * (-1.0, -1.0, 1.0)
    np.testing.assert_allclose(turned.positions[row], expected, atol=1e-9)
