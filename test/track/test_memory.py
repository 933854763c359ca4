"""What is remembered of people, and when it is forgotten."""

from __future__ import annotations

import pytest

from depth_pose.core.config import MAX_STAMP_GAP_NS
from depth_pose.track.memory import MEMORY_NS, PerPerson

STEP_NS = 40_000_000


def note(memory: PerPerson[list[int]], stamp_ns: int, *seen: str) -> None:
    """A frame that shows these people, each of whom notes its stamp."""
    memory.begin(stamp_ns)
    for body_id in seen:
        memory[body_id].append(stamp_ns)


def test_everybody_has_their_own_state() -> None:
    memory: PerPerson[list[int]] = PerPerson(list)
    note(memory, 0, "body_1")
    note(memory, STEP_NS, "body_2", "body_1")
    assert memory.get("body_1") == [0, STEP_NS]
    assert memory.get("body_2") == [STEP_NS]
    assert memory.get("body_3") is None


@pytest.mark.parametrize("memory_ns", [MEMORY_NS, MAX_STAMP_GAP_NS])
def test_who_is_not_seen_is_forgotten_after_a_time_and_nobody_else(memory_ns) -> None:
    memory: PerPerson[list[int]] = PerPerson(list, memory_ns)
    note(memory, 0, "body_1", "body_2")
    frames = memory_ns // STEP_NS
    for k in range(1, frames + 1):
        note(memory, k * STEP_NS, "body_2")
    assert memory.get("body_1") == [0]  # until the time is over
    note(memory, (frames + 1) * STEP_NS, "body_2")
    assert memory.get("body_1") is None
    assert len(memory["body_2"]) == frames + 2


def test_to_ask_whether_something_is_known_is_not_to_see() -> None:
    memory: PerPerson[list[int]] = PerPerson(list, MAX_STAMP_GAP_NS)
    note(memory, 0, "body_1")
    for k in range(1, 14):
        memory.begin(k * STEP_NS)
        memory.get("body_1")
    assert memory.get("body_1") is None


@pytest.mark.parametrize("step_ns", [-1, MAX_STAMP_GAP_NS + 1])
def test_a_break_of_the_stamps_forgets_everybody(step_ns) -> None:
    memory: PerPerson[list[int]] = PerPerson(list)
    note(memory, 10 * STEP_NS, "body_1", "body_2")
    note(memory, 10 * STEP_NS + step_ns, "body_2")
    assert memory.get("body_1") is None
    assert memory.get("body_2") == [10 * STEP_NS + step_ns]


def test_the_longest_step_and_the_same_stamp_again_are_no_break() -> None:
    memory: PerPerson[list[int]] = PerPerson(list)
    for stamp_ns in (0, MAX_STAMP_GAP_NS, MAX_STAMP_GAP_NS):
        note(memory, stamp_ns, "body_1")
    assert memory.get("body_1") == [0, MAX_STAMP_GAP_NS, MAX_STAMP_GAP_NS]


def test_one_person_is_forgotten_alone_and_reset_forgets_all() -> None:
    memory: PerPerson[list[int]] = PerPerson(list)
    note(memory, 0, "body_1", "body_2")
    memory.forget("body_1")
    memory.forget("body_7")  # never seen
    assert memory.get("body_1") is None
    assert memory.get("body_2") == [0]
    memory.reset()
    assert memory.get("body_2") is None
