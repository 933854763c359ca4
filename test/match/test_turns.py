"""Exemplars are searched for in turn, and carried along with the person in between."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import synthetic as syn
from depth_pose.core.config import PersonalConfig
from depth_pose.match.match import Matcher
from depth_pose.match.tuning import MatchTuning
from depth_pose.stages import StageFactory
from depth_pose.track.person_view import FramePeople
from depth_pose.tuning import Tuning
from stages import make_matcher

_SHIFT_M = np.array([0.05, 0.0, 0.02])


@pytest.fixture(scope="module")
def people(bank) -> FramePeople:
    posed = bank.body.pose(np.diag([1.0, -1.0, -1.0]) @ bank.rotations(31), np.array([0.0, 0.0, 3.0]))
    return syn.to_people(syn.draw((posed.vertices, bank.body.faces)))


def shifted(people: FramePeople, k: int, step_ns: int = 33_000_000) -> FramePeople:
    """The same people k steps farther on: their points alone, so that a search answers something else."""
    stamped = syn.restamped(people, k * step_ns)
    return replace(
        stamped, persons=tuple(replace(p, points=p.points + k * _SHIFT_M) for p in stamped.persons)
    )


def named(people: FramePeople, *body_ids: str) -> FramePeople:
    """The one person of a frame several times, under some ids."""
    (person,) = people.persons
    persons = tuple(replace(person, found=replace(person.found, body_id=b)) for b in body_ids)
    return replace(people, persons=persons)


def searches(
    matcher: Matcher, people: FramePeople, frames: int, step_ns: int = 33_000_000
) -> list[list[bool]]:
    """Return for each frame and person whether exemplars were searched for (and not carried along)."""
    before: dict[str, np.ndarray] = {}
    out = []
    for k in range(frames):
        now = {m.body_id: m.candidates[0].translation for m in matcher.match(shifted(people, k, step_ns))}
        out.append(
            [b not in before or not np.allclose(t - before[b], _SHIFT_M, atol=1e-9) for b, t in now.items()]
        )
        before = now
    return out


def test_candidates_go_along_with_the_person(bank, people) -> None:
    matcher = make_matcher(bank, Tuning(match=MatchTuning(search_every=3)), build=PersonalConfig(scale=1.0))
    (first,) = matcher.match(shifted(people, 0))
    (second,) = matcher.match(shifted(people, 1))
    for a, b in zip(first.candidates, second.candidates, strict=True):
        assert (b.exemplar, b.view, b.score) == (a.exemplar, a.view, a.score)
        np.testing.assert_allclose(b.translation - a.translation, _SHIFT_M, atol=1e-9)


def test_two_people_take_turns(bank, people) -> None:
    matcher = make_matcher(bank, Tuning(match=MatchTuning(search_every=2)), build=PersonalConfig(scale=1.0))
    told = searches(matcher, named(people, "body_1", "body_2"), 6)
    assert told[0] == [True, True]
    for was, now in pairwise(told[1:]):
        assert sum(was) == 1 and was != now


def test_every_frame_is_searched_where_that_is_asked_for_or_the_size_is_not_known(bank, people) -> None:
    for scale, tuning in (
        (1.0, MatchTuning(search_every=1)),
        (0.0, MatchTuning(scale_frames=5, search_every=4)),
    ):
        matcher = make_matcher(bank, Tuning(match=tuning), build=PersonalConfig(scale=scale))
        assert searches(matcher, people, 4) == [[True]] * 4


def test_candidates_are_not_carried_for_long(bank, people) -> None:
    for step_ns, told in ((33_000_000, [True, False, False, True]), (66_000_000, [True, False, True, False])):
        matcher = make_matcher(
            bank, Tuning(match=MatchTuning(search_every=3)), build=PersonalConfig(scale=1.0)
        )
        found = searches(matcher, named(people, "body_0"), 4, step_ns)
        assert [f for (f,) in found] == told
    matcher = make_matcher(bank, Tuning(match=MatchTuning(search_every=3)), build=PersonalConfig(scale=1.0))
    assert searches(matcher, people, 3, 200_000_000) == [[True]] * 3


def test_a_reset_forgets_whose_turn_it_is(bank, people) -> None:
    matcher = make_matcher(bank, Tuning(match=MatchTuning(search_every=3)), build=PersonalConfig(scale=1.0))
    told = [searches(matcher, people, 5)]
    matcher.reset()
    assert searches(matcher, people, 5) == told[0]


def cut(people: FramePeople, is_cut: bool) -> FramePeople:
    """The same people, with or without something that cuts them off below."""
    return replace(people, persons=tuple(replace(p, is_cut_below=is_cut) for p in people.persons))


def test_the_size_is_not_sought_anew_whenever_the_image_wavers(bank, people) -> None:
    shared = StageFactory(bank, tuning=Tuning(match=MatchTuning(scale_frames=3, search_every=1)))
    matcher, frames = shared.make_matcher(), []
    for k in range(16):
        matcher.match(cut(syn.restamped(people, k * 33_000_000), is_cut=k % 3 == 1))
        frames.append(shared.states["body_1"].shape.search.frames)
    assert frames[2:] == [3] * 14


def test_the_size_is_sought_anew_once_somebody_is_whole_for_good(bank, people) -> None:
    shared = StageFactory(bank, tuning=Tuning(match=MatchTuning(scale_frames=3, search_every=1)))
    matcher, frames = shared.make_matcher(), []
    for k in range(12):
        matcher.match(cut(syn.restamped(people, k * 33_000_000), is_cut=k < 4))
        frames.append(shared.states["body_1"].shape.search.frames)
    assert frames == [1, 2, 3, 3, 3, 3, 3, 3, 1, 2, 3, 3]
