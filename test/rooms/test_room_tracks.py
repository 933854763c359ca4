"""Who is who over several cameras."""

from __future__ import annotations

import numpy as np
import pytest
from walkers import Eye, standing

from depth_pose.rooms.sightings import RoomSighting
from depth_pose.rooms.tracks import FORGET_NS, RoomTracks

MS = 1_000_000


def walk(tracks, eyes, path, seconds, periods_ms=None, sizes=None, start_ms=0):
    """Return for each person the ids given at any time, and the number of people at the end."""
    events = sorted(
        (t, c)
        for c, _ in enumerate(eyes)
        for t in range(start_ms + 7 * c, start_ms + int(1000 * seconds), (periods_ms or [66] * len(eyes))[c])
    )
    ids: dict[int, list[str]] = {}
    for t, c in events:
        seen = eyes[c].see(path(t / 1000.0), sizes)
        given = tracks.assign(c, t * MS, seen)
        assert len(set(given)) == len(given)
        owner = {f"body_{number}": who for who, number in eyes[c].ids.items()}
        for sighting, room_id in zip(seen, given, strict=True):
            ids.setdefault(owner[sighting.body_id], []).append(room_id)
    return ids


def names(ids, who):
    return list(dict.fromkeys(ids[who]))


def test_three_cameras_see_two_people_and_nobody_is_doubled():
    """Unlike rates, and each camera 12 cm off in a direction of its own."""
    eyes = [Eye(bias=b, seed=i) for i, b in enumerate([(0.12, 0), (-0.06, 0.1), (-0.06, -0.1)])]

    def path(t):
        return [(np.cos(t), np.sin(t)), (-1.2 * np.cos(0.7 * t), 1.2 * np.sin(0.7 * t) + 2.5)]

    ids = walk(RoomTracks(), eyes, path, 12.0, [33, 66, 80])
    assert len(set(ids[0])) == len(set(ids[1])) == 1
    assert ids[0][0] != ids[1][0]


def test_two_who_pass_each_other_keep_their_ids():
    """At 0.45 m, with 5 cm of noise."""
    eyes = [Eye(noise=0.05, seed=1), Eye(noise=0.05, seed=2, bias=(0.1, 0.0))]
    ids = walk(RoomTracks(), eyes, lambda t: [(-3 + t, 0.0), (3 - t, 0.45)], 6.0)
    assert len(set(ids[0])) == len(set(ids[1])) == 1


@pytest.mark.parametrize("gap", [0.6, 0.0, -0.8])
def test_who_leaves_one_view_and_enters_another_stays_the_same(gap):
    """Views that overlap, touch, or leave 0.8 m unseen between them; to and fro."""
    eyes = [Eye(right=0.5 * gap, seed=3), Eye(left=-0.5 * gap, seed=4)]
    ids = walk(RoomTracks(), eyes, lambda t: [(2.0 * np.cos(0.5 * t), 0.3)], 20.0)
    assert len(set(ids[0])) == 1


def test_size_tells_who_comes_back():
    """A child and an adult go out of view side by side, and come back the other way round."""
    tracks, eyes = RoomTracks(), [Eye(right=0.0, seed=5), Eye(left=1.0, seed=6)]

    def path(t):
        x = -1.0 + t
        return [(x, 0.0), (x, 0.5)] if x < 0.0 else [(x, 0.4), (x, 0.1)]

    ids = walk(tracks, eyes, path, 4.0, sizes=[1.05, 0.65])
    assert len(set(ids[0])) == len(set(ids[1])) == 1


def test_doubles_become_one():
    """A second camera is 0.65 m off, is believed to see somebody else, and is put right."""
    tracks, first, second = RoomTracks(), Eye(seed=7), Eye(seed=8, bias=(0.65, 0.0))
    path = lambda t: [(0.3 * t, 0.0)]  # noqa: E731
    ids = walk(tracks, [first, second], path, 1.0)
    assert names(ids, 0) == ["person_1", "person_2"]
    second.bias = (0.1, 0.0)
    ids = walk(tracks, [first, second], path, 3.0, start_ms=1000)
    assert ids[0][-1] == ids[0][-2] == "person_1"
    assert tracks.same == {"person_2": "person_1"}
    assert len(tracks.people) == 1


def test_side_by_side_in_one_camera_are_two():
    eyes = [Eye(seed=9), Eye(seed=10)]
    ids = walk(RoomTracks(), eyes, lambda t: [(0.0, 0.0), (0.28, 0.0)], 4.0)
    assert len(set(ids[0])) == len(set(ids[1])) == 1


def test_ids_that_a_camera_exchanges_are_put_right():
    tracks, eyes = RoomTracks(), [Eye(seed=11), Eye(seed=12)]
    path = lambda t: [(0.0, 0.0), (1.0, 0.2)]  # noqa: E731
    before = walk(tracks, eyes, path, 1.0)
    eyes[1].ids = {0: eyes[1].ids[1], 1: eyes[1].ids[0]}
    after = walk(tracks, eyes, path, 2.0, start_ms=1000)
    assert set(before[0]) == set(after[0])
    assert set(before[1]) == set(after[1])


def test_who_is_unseen_for_long_is_forgotten_and_ids_are_not_used_again():
    tracks = RoomTracks()
    eye = Eye(seed=13)
    assert tracks.assign(0, 0, eye.see([(0.0, 0.0)])) == ("person_1",)
    assert tracks.assign(0, FORGET_NS + 100 * MS, []) == ()
    assert tracks.people == []
    assert tracks.assign(0, FORGET_NS + 200 * MS, eye.see([(0.0, 0.0)])) == ("person_2",)
    assert tracks.assign(0, 0, eye.see([(0.0, 0.0)])) == ("person_3",)  # a replay from the start


def test_a_camera_left_out_takes_those_along_whom_only_it_saw():
    tracks, eyes = RoomTracks(), [Eye(right=0.0, seed=14), Eye(seed=15)]
    walk(tracks, eyes, lambda t: [(-1.0, 0.0), (1.0, 0.0)], 1.0)
    tracks.leave_out(1)
    assert [p.room_id for p in tracks.people] == ["person_1"]
    assert list(tracks.people[0].views) == [0]


def test_distances_use_what_both_know():
    """A camera that guesses the hips wrong still knows the place."""
    joints, states = standing(0.0, 0.0), np.zeros(19, np.uint8)
    sure = np.full(19, 0.9)
    a = RoomSighting("a", joints, sure, states)
    guessed = joints.copy()
    guessed[[0, 11, 15]] += [0.7, 0.0, 0.0]
    doubtful = np.where(np.isin(np.arange(19), [0, 11, 15]), 0.1, 0.9)
    b = RoomSighting("b", guessed + [0.1, 0.0, 0.4], doubtful, states)
    assert a.distance(b, np.zeros(3)) == pytest.approx(0.1)
    assert a.shift_to(b) == pytest.approx([0.1, 0.0, 0.4])
