"""Who is followed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from depth_pose.core.config import FollowConfig
from depth_pose.core.errors import ConfigError
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import Source
from depth_pose.track.follow import Follower
from depth_pose.track.state import MEMORY_NS

STEP_NS = 40_000_000


def somebody(number: int, x: float, z: float) -> Skeleton:
    lost = Skeleton.lost(0, "camera", f"body_{number}")
    return replace(lost, source=Source.REFINED, positions=np.tile([x, 0.0, z], (19, 1)))


PEOPLE = [somebody(10, -1.5, 2.0), somebody(9, 1.6, 3.0), somebody(11, 0.1, 5.0)]
"""The nearest, the one who came first, and the one in the middle."""


@pytest.mark.parametrize(
    ("whom", "name"), [("first", "body_9"), ("nearest", "body_10"), ("centre", "body_11")]
)
def test_whom(whom, name) -> None:
    for people in (PEOPLE, PEOPLE[::-1]):
        assert Follower(FollowConfig(whom=whom)).choose(people, 0, "camera").body_id == name


@pytest.mark.parametrize("whom", ["first", "nearest", "centre"])
def test_whom_you_have_you_keep(whom) -> None:
    """Whatever the others do, who is followed is followed on, until gone."""
    follower = Follower(FollowConfig(whom=whom))
    mine = somebody(20, 3.0, 6.0)
    assert follower.choose([mine], 0, "camera") is mine
    for k in range(1, 20):
        assert follower.choose([*PEOPLE, mine], k * STEP_NS, "camera") is mine
    assert follower.choose(PEOPLE, 20 * STEP_NS, "camera") in PEOPLE
    assert follower.choose([*PEOPLE, mine], 21 * STEP_NS, "camera") is not mine


def test_people_without_a_number_come_last() -> None:
    others = [replace(PEOPLE[0], body_id=name) for name in ("b0", "ann", "a\x1b[31m\n_x", "")]
    assert Follower(FollowConfig()).choose([*others, *PEOPLE], 0, "camera").body_id == "body_9"
    assert Follower(FollowConfig()).choose(others, 0, "camera").body_id == "b0"


def test_lost_where_there_is_nobody() -> None:
    follower = Follower(FollowConfig())
    for k in range(2):
        lost = follower.choose([], 7 + k, "camera")
        assert lost.is_lost
        assert (lost.stamp_ns, lost.frame_id, lost.body_id) == (7 + k, "camera", "")
    assert follower.choose(PEOPLE, 9, "camera").body_id == "body_9"
    assert follower.choose([], 10, "camera").is_lost


@pytest.mark.parametrize("patient", [False, True])
def test_who_waits_takes_nobody_else_for_two_seconds(patient) -> None:
    follower = Follower(FollowConfig(patient=patient))
    mine, other = somebody(1, 0.0, 3.0), somebody(2, 1.0, 3.0)
    follower.choose([mine, other], 0, "camera")
    assert follower.choose([other], STEP_NS, "camera").is_lost == patient
    if patient:
        assert follower.choose([other, mine], MEMORY_NS, "camera") is mine
        assert follower.choose([other], 2 * MEMORY_NS, "camera").is_lost
    assert follower.choose([other], 2 * MEMORY_NS + 1, "camera") is other


def test_reset_and_a_stamp_that_jumps_back_end_the_wait() -> None:
    mine, other = somebody(1, 0.0, 3.0), somebody(2, 1.0, 3.0)
    for reset in (False, True):
        follower = Follower(FollowConfig(patient=True))
        follower.choose([mine], 10 * STEP_NS, "camera")
        if reset:
            follower.reset()
        assert follower.choose([other], 11 * STEP_NS if reset else 0, "camera") is other


def test_no_other_word_is_known() -> None:
    with pytest.raises(ConfigError, match="whom"):
        FollowConfig(whom="tallest")
