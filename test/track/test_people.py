"""What comes out while people come, go, cross and are hidden: simulated clips, the whole pipeline."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from crowd import person, seen
from depth_pose.bank import Bank
from depth_pose.body.body import PosedBody
from depth_pose.core.frame import DepthFrame
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import JOINT_NODES, JointState
from depth_pose.pipeline import PosePipeline


@pytest.fixture
def run(bank: Bank) -> Callable[..., list[Skeleton]]:
    def process(frames: list[DepthFrame]) -> list[Skeleton]:
        pipeline = PosePipeline(bank)
        return [pipeline.process_frame(frame).skeleton for frame in frames]

    return process


def error(skeleton: Skeleton, truth: PosedBody) -> float:
    return float(np.linalg.norm(skeleton.positions - truth.nodes[JOINT_NODES], axis=1).mean())


def ids(skeletons: list[Skeleton]) -> set[str]:
    return {s.body_id for s in skeletons}


def test_nobody_then_somebody_walks_through(run) -> None:
    """LOST without joints; then one body id from the first limb in view to the last."""
    at = {k: person(k, 2.9 - 0.06 * k, 3.2) for k in range(95)}
    skeletons = run([seen(k, [p]) for k, p in at.items()])
    empty = [s for s in skeletons[:5] + skeletons[92:]]
    assert all(s.is_lost and len(s.positions) == 0 and s.body_id == "" for s in empty)
    assert ids(skeletons[20:78]) == {"body_1"}
    assert np.median([error(skeletons[k], at[k]) for k in range(36, 64)]) < 0.05
    assert max(error(skeletons[k], at[k]) for k in range(36, 64)) < 0.12  # its size is right again


def test_half_out_of_the_image(run) -> None:
    """Joints beyond the border are given, as OUTSIDE_IMAGE; those in view stay right."""
    at = [person(k, min(0.06 * k, 1.62), 3.2) for k in range(40)]
    skeletons = run([seen(k, [p]) for k, p in enumerate(at)])
    last = skeletons[-1]
    outside = last.joint_states == JointState.OUTSIDE_IMAGE
    assert 2 <= outside.sum() <= 12
    assert (last.joint_confidence[outside] < 0.5).all()
    apart = np.linalg.norm(last.positions - at[-1].nodes[JOINT_NODES], axis=1)
    assert np.median(apart[~outside]) < 0.12
    assert ids(skeletons) == {"body_1"}


def test_the_one_who_is_followed_stays_the_one(run) -> None:
    """Another person comes in, nearer and larger, and stays beside."""
    at = [person(k, -0.5, 3.2) for k in range(45)]
    other = [person(k, max(0.75, 2.4 - 0.06 * k), 2.8, phase=1.0) for k in range(45)]
    skeletons = run([seen(k, [at[k], other[k]]) for k in range(45)])
    assert ids(skeletons) == {"body_1"}
    assert max(error(s, p) for s, p in zip(skeletons[5:], at[5:], strict=True)) < 0.08


def test_another_person_is_another_body(run) -> None:
    """One leaves; the other, who has come in, is taken then and has another id, and right joints."""
    leaving = [person(k, -0.3 - 0.06 * k, 3.2) for k in range(55)]
    coming = [person(k, max(0.4, 2.8 - 0.06 * k), 3.2, phase=1.0) for k in range(55)]
    skeletons = run([seen(k, [leaving[k], coming[k]]) for k in range(55)])
    assert ids(skeletons[:10]) == {"body_1"}
    (other,) = ids(skeletons[-15:])
    assert other not in ("body_1", "")
    assert max(error(s, p) for s, p in zip(skeletons[-12:], coming[-12:], strict=True)) < 0.08
    assert ids(skeletons) <= {"body_1", other, ""}


def test_hidden_for_a_second(run) -> None:
    """Nothing of the person is seen for a second: LOST, no board taken for them, then the same id."""
    at = [person(k, 0.0, 3.2) for k in range(50)]
    board = (50, 125, 10, 144, 2.0)
    skeletons = run([seen(k, [p], board if 15 <= k < 40 else None) for k, p in enumerate(at)])
    assert all(s.is_lost for s in skeletons[15:40])
    assert ids(skeletons[:15]) == ids(skeletons[40:]) == {"body_1"}
    assert max(error(s, p) for s, p in zip(skeletons[41:], at[41:], strict=True)) < 0.06


def test_legs_behind_a_table_for_a_second(run) -> None:
    """The upper body stays right, the hidden legs are given as OCCLUDED or unsure, the id is kept."""
    at = [person(k, 0.0, 3.2) for k in range(50)]
    table = (30, 150, 90, 144, 2.0)
    skeletons = run([seen(k, [p], table if 15 <= k < 40 else None) for k, p in enumerate(at)])
    assert ids(skeletons) == {"body_1"}
    for k in range(17, 40):
        upper = np.linalg.norm(skeletons[k].positions - at[k].nodes[JOINT_NODES], axis=1)[:11]
        assert np.median(upper) < 0.1
    assert error(skeletons[45], at[45]) < 0.06
