"""State of people, and when it is forgotten."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import synthetic as syn
from depth_pose.core.config import MAX_STAMP_GAP_NS, SmoothConfig
from depth_pose.core.stamps import LONGEST_SILENCE_NS
from depth_pose.recover.smooth import low_pass
from depth_pose.track.state import (
    RETURN_NS,
    Answer,
    Evidence,
    FilterState,
    PersonState,
    PersonStates,
    Shape,
)

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


def see(states: PersonStates, people, stamp_ns: int, *seen: str) -> list[PersonState]:
    states.begin(frame(people, stamp_ns, *seen))
    return [states[b] for b in seen]


def marked(mark: float) -> PersonState:
    """A state that can be told from others."""
    return PersonState(
        answer=Answer(good_points=round(10 * mark)),
        shape=Shape(scale=mark),
        evidence=Evidence(pose_distance=mark),
    )


def test_everybody_has_their_own_state(people):
    states = PersonStates()
    assert see(states, people, 0, "body_1") == [PersonState()]
    states["body_1"] = marked(0.1)
    other, again = see(states, people, STEP_NS, "body_2", "body_1")
    assert again == marked(0.1)
    assert other == PersonState()
    with pytest.raises(KeyError):
        states["body_3"]


def test_who_is_not_seen_is_forgotten_after_a_time_and_nobody_else(people):
    states = PersonStates()
    see(states, people, 0, "body_1", "body_2")
    states["body_1"], states["body_2"] = marked(0.1), marked(0.2)
    frames = RETURN_NS // STEP_NS
    for k in range(1, frames + 1):
        see(states, people, k * STEP_NS, "body_2")
    late, still = see(states, people, frames * STEP_NS, "body_1", "body_2")
    assert (late.shape.scale, still) == (0.1, marked(0.2))
    for k in range(frames + 1, 2 * frames + 2):
        see(states, people, k * STEP_NS, "body_2")
    late, still = see(states, people, (2 * frames + 2) * STEP_NS, "body_1", "body_2")
    assert late.shape.scale == 0.0
    assert still == marked(0.2)


def test_builds_of_people_who_are_forgotten_are_kept_for_a_second_pass(people):
    states = PersonStates()
    states.keeps_builds = True
    see(states, people, 0, "body_1", "body_2")
    states["body_1"] = marked(0.1)
    for k in range(1, RETURN_NS // STEP_NS + 2):
        see(states, people, k * STEP_NS, "body_2")
    (back,) = see(states, people, RETURN_NS + 2 * STEP_NS, "body_1")
    assert back == PersonState(shape=Shape(scale=0.1))


def test_poses_are_forgotten_sooner_than_the_person(people):
    states = PersonStates()
    see(states, people, 0, "body_1")
    states["body_1"] = marked(0.1)
    for k in range(1, MAX_STAMP_GAP_NS // STEP_NS):
        see(states, people, k * STEP_NS, "body_2")
    assert see(states, people, MAX_STAMP_GAP_NS, "body_1") == [marked(0.1)]
    for k in range(1, 2 + MAX_STAMP_GAP_NS // STEP_NS):
        see(states, people, MAX_STAMP_GAP_NS + k * STEP_NS, "body_2")
    (back,) = see(states, people, 2 * MAX_STAMP_GAP_NS + 2 * STEP_NS, "body_1")
    assert back == PersonState(shape=Shape(scale=0.1))


@pytest.mark.parametrize("silence_ns", [MAX_STAMP_GAP_NS + 1, LONGEST_SILENCE_NS])
def test_after_a_silence_of_the_sensor_only_shape_and_id_stay(people, silence_ns):
    states, filtered = PersonStates(), low_pass(FilterState(), np.zeros((19, 3)), 0, SmoothConfig())
    filtered = low_pass(filtered, np.full((19, 3), 0.04), STEP_NS, SmoothConfig())
    assert np.abs(filtered.velocity).max() > 0.1
    see(states, people, STEP_NS, "body_1")
    states["body_1"] = marked(0.1)._replace(filter=filtered)
    assert see(states, people, STEP_NS + silence_ns, "body_1") == [PersonState(shape=Shape(scale=0.1))]


def test_a_person_who_is_lost_keeps_shape_and_standing():
    lost = marked(0.1).lost()
    assert lost == marked(0.1)._replace(answer=Answer(is_waiting=True))


@pytest.mark.parametrize("step_ns", [-1, LONGEST_SILENCE_NS + 1])
def test_a_break_of_the_stamps_forgets_everybody(people, step_ns):
    states = PersonStates()
    see(states, people, 10 * STEP_NS, "body_1", "body_2")
    states["body_1"] = marked(0.1)
    assert see(states, people, 10 * STEP_NS + step_ns, "body_1") == [PersonState()]
    with pytest.raises(KeyError):
        states["body_2"]


def test_several_stages_begin_the_same_frame(people):
    states = PersonStates()
    for stamp_ns in (0, MAX_STAMP_GAP_NS, MAX_STAMP_GAP_NS):
        see(states, people, stamp_ns, "body_1")
        states["body_1"] = marked(0.1)
    assert see(states, people, MAX_STAMP_GAP_NS, "body_1") == [marked(0.1)]
    states.reset()
    assert see(states, people, MAX_STAMP_GAP_NS, "body_1") == [PersonState()]
