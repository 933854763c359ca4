"""What is remembered of people, and when it is forgotten."""

from __future__ import annotations

from dataclasses import replace

import pytest

import synthetic as syn
from depth_pose.core.config import MAX_STAMP_GAP_NS
from depth_pose.track.memory import RETURN_NS, Subject, Subjects

STEP_NS = 40_000_000


@pytest.fixture(scope="module")
def people():
    """A frame that shows one person."""
    return syn.to_people(syn.draw(syn.mesh(syn.posed(syn.arms_down()))), stamp_ns=0)


def frame(people, stamp_ns: int, *seen: str):
    """The frame at another time, with people of these ids."""
    (person,) = people.persons
    persons = tuple(replace(person, found=replace(person.found, body_id=b)) for b in seen)
    return replace(people, stamp_ns=stamp_ns, persons=persons)


def see(subjects: Subjects, people, stamp_ns: int, *seen: str) -> list[Subject]:
    subjects.begin(frame(people, stamp_ns, *seen))
    return [subjects[b] for b in seen]


def test_everybody_has_their_own_memory(people):
    subjects = Subjects()
    (one,) = see(subjects, people, 0, "body_1")
    other, again = see(subjects, people, STEP_NS, "body_2", "body_1")
    assert again is one is not other
    with pytest.raises(KeyError):
        subjects["body_3"]


def test_who_is_not_seen_is_forgotten_after_a_time_and_nobody_else(people):
    subjects = Subjects()
    one, other = see(subjects, people, 0, "body_1", "body_2")
    frames = RETURN_NS // STEP_NS
    for k in range(1, frames + 1):
        see(subjects, people, k * STEP_NS, "body_2")
    assert see(subjects, people, frames * STEP_NS, "body_1", "body_2") == [one, other]
    for k in range(frames + 1, 2 * frames + 2):
        see(subjects, people, k * STEP_NS, "body_2")
    late, still = see(subjects, people, (2 * frames + 2) * STEP_NS, "body_1", "body_2")
    assert late is not one
    assert still is other


def test_poses_are_forgotten_sooner_than_the_person(people):
    subjects = Subjects()
    (one,) = see(subjects, people, 0, "body_1")
    one.build, one.kept, one.recovery = object(), object(), object()
    for k in range(1, MAX_STAMP_GAP_NS // STEP_NS):
        see(subjects, people, k * STEP_NS, "body_2")
    see(subjects, people, MAX_STAMP_GAP_NS, "body_1")
    assert None not in (one.build, one.kept, one.recovery)
    for k in range(1, 2 + MAX_STAMP_GAP_NS // STEP_NS):
        see(subjects, people, MAX_STAMP_GAP_NS + k * STEP_NS, "body_2")
    see(subjects, people, 2 * MAX_STAMP_GAP_NS + 2 * STEP_NS, "body_1")
    assert one.build is not None
    assert (one.kept, one.recovery) == (None, None)


@pytest.mark.parametrize("step_ns", [-1, MAX_STAMP_GAP_NS + 1])
def test_a_break_of_the_stamps_forgets_everybody(people, step_ns):
    subjects = Subjects()
    one, _ = see(subjects, people, 10 * STEP_NS, "body_1", "body_2")
    (new,) = see(subjects, people, 10 * STEP_NS + step_ns, "body_1")
    assert new is not one
    with pytest.raises(KeyError):
        subjects["body_2"]


def test_several_stages_begin_the_same_frame(people):
    subjects = Subjects()
    for stamp_ns in (0, MAX_STAMP_GAP_NS, MAX_STAMP_GAP_NS):
        (one,) = see(subjects, people, stamp_ns, "body_1")
        one.kept = one.kept or object()
    (again,) = see(subjects, people, MAX_STAMP_GAP_NS, "body_1")
    assert again.kept is one.kept is not None
    subjects.reset()
    (new,) = see(subjects, people, MAX_STAMP_GAP_NS, "body_1")
    assert new is not one
