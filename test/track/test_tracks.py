"""Who is who from frame to frame: names over time, from places, sizes and poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.skeleton import JOINT_NODES, rest_nodes
from depth_pose.detect.segmentation import Detection
from depth_pose.track.person_odds import PersonOdds
from depth_pose.track.state import RETURN_NS
from depth_pose.track.tracks import PeopleTracks, TrackLimits

STEP_NS = 40_000_000

ODDS = PersonOdds(np.array([-3.0, 1.5, 0.8, 7.0, 0.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
"""At a logit of 2, or with .4 m of way at half of that, a track is as likely a person as not."""


def new_tracks(keep: float = 0.3) -> PeopleTracks:
    return PeopleTracks(TrackLimits(start=0.6, keep=keep, confirm=0.5), ODDS)


def at(x: float, z: float = 3.0, y: float = 0.0, probability: float = 1.0) -> Detection:
    return Detection(1, np.array([x, y, z]), probability)


def measured(joints: np.ndarray, confidence: float) -> JointMeasurement:
    sigma = np.full((len(joints), 2), 0.05, np.float32)
    return JointMeasurement(joints, sigma, np.full(len(joints), confidence, np.float32))


def of_size(stature: float, x: float) -> Detection:
    """Somebody upright with the joints of the rest pose."""
    joints = (stature * rest_nodes()[JOINT_NODES] + [x, 0.0, 3.0]).astype(np.float32)
    return Detection(1, np.array([x, 0.0, 3.0]), 1.0, measured(joints, 1.0))


def person(
    stature: float, x: float, z: float = 3.0, pose: int = 0, probability: float = 1.0, rng=None
) -> Detection:
    """Somebody in a pose of their own, with joints that are proposed with an error of 4 cm."""
    rest = rest_nodes()[JOINT_NODES]
    bent = rest + np.random.default_rng(pose).normal(0.0, 0.03, rest.shape)
    noise = np.zeros(rest.shape) if rng is None else rng.normal(0.0, 0.02, rest.shape)
    joints = (stature * bent + noise + [x, 0.0, z]).astype(np.float32)
    shaken = np.zeros(3) if rng is None else rng.normal(0.0, 0.03, 3)
    return Detection(1, np.array([x, 0.0, z]) + shaken, probability, measured(joints, 0.86))


@pytest.fixture
def tracks() -> PeopleTracks:
    return new_tracks()


def test_two_who_pass_each_other_keep_their_names(tracks) -> None:
    """One crosses to the right, one to the left, half a metre behind; given in any order."""
    rng = np.random.default_rng(0)
    for k in range(75):
        x = -1.5 + 0.04 * k
        shown = [at(x, 2.8), at(-x, 3.3)]
        expected = ["body_1", "body_2"]
        if k and rng.random() < 0.5:
            shown, expected = shown[::-1], expected[::-1]
        assert tracks.assign(shown, k * STEP_NS) == tuple(expected)


def test_who_is_not_sure_is_believed_once_they_move() -> None:
    """A coat stays where it is; somebody takes a step; somebody else is sure at once."""
    tracks = new_tracks(keep=0.2)
    for k in range(30):
        coat, walker = at(-1.5 + 0.02 * (-1) ** k, probability=0.8), at(0.02 * k, probability=0.7)
        expected = (None, None if k < 13 else "body_1")
        assert tracks.assign([coat, walker], k * STEP_NS) == expected
    shown = [at(-1.5, probability=0.8), at(0.6), at(1.8, probability=0.97)]
    assert tracks.assign(shown, 30 * STEP_NS) == (None, "body_1", "body_2")


def test_way_does_not_count_while_the_camera_moves() -> None:
    """A coat passes a robot that drives, and then a camera that stands still."""
    tracks = new_tracks(keep=0.2)
    for k in range(30):
        coat = at(0.03 * k, probability=0.7)
        assert tracks.assign([coat], k * STEP_NS, is_still=False) == (None,)
    names = [tracks.assign([at(0.03 * k, probability=0.7)], k * STEP_NS)[0] for k in range(30, 60)]
    assert names[0] is None
    assert names[-1] == "body_1"


def test_one_hides_the_other_while_they_pass(tracks) -> None:
    """The farther one is not seen for ten frames in the middle."""
    for k in range(75):
        x = -1.5 + 0.04 * k
        near, far = at(x, 2.5), at(-x, 3.5)
        if 32 <= k < 43:
            assert tracks.assign([near], k * STEP_NS) == ("body_1",)
        else:
            assert tracks.assign([near, far], k * STEP_NS) == ("body_1", "body_2")


def test_who_comes_back_in_another_size_is_somebody_else(tracks) -> None:
    """A child goes behind a door, an adult comes out, then the child."""
    for k in range(10):
        assert tracks.assign([of_size(1.2, 0.0)], k * STEP_NS) == ("body_1",)
    for k in range(10, 22):
        assert tracks.assign([], k * STEP_NS) == ()
    for k in range(22, 40):
        assert tracks.assign([of_size(1.75, 0.1)], k * STEP_NS) == ("body_2",)
    assert tracks.assign([of_size(1.2, 0.0), of_size(1.75, 0.6)], 40 * STEP_NS) == ("body_1", "body_2")


def test_who_comes_back_in_their_size_has_their_name(tracks) -> None:
    for k in range(10):
        assert tracks.assign([of_size(1.7, 0.0)], k * STEP_NS) == ("body_1",)
    for k in range(10, 30):
        assert tracks.assign([], k * STEP_NS) == ()
    assert tracks.assign([of_size(1.55, 0.2)], 30 * STEP_NS) == ("body_1",)


def test_both_are_hidden_while_they_pass(tracks) -> None:
    """Each is expected where their own way leads, though the other was last seen nearer to it."""
    for k in range(40):
        x = -1.1 + 0.05 * k
        hidden = abs(x) < 0.25
        shown = [] if hidden else [at(x), at(-x, 3.1)]
        assert tracks.assign(shown, k * STEP_NS) == (() if hidden else ("body_1", "body_2"))


def test_who_runs_on_while_hidden_is_awaited_farther_on(tracks) -> None:
    """More than a metre in 0.6 s, at 2 m/s."""
    for k in range(50):
        shown = [] if 20 <= k < 35 else [at(-2.0 + 0.08 * k)]
        assert tracks.assign(shown, k * STEP_NS) == ("body_1",) * len(shown)


@pytest.mark.parametrize("speed", [0.0, 0.6])
def test_who_is_hidden_for_a_second_and_a_half_keeps_the_name(tracks, speed) -> None:
    """Standing, or walking slowly on; the other one, who stays, does not take it over."""
    for k in range(80):
        mine, other = at(-1.2 + speed * k * 0.04), at(1.4, 3.5)
        if 20 <= k < 57:
            assert tracks.assign([other], k * STEP_NS) == ("body_2",)
        else:
            assert tracks.assign([mine, other], k * STEP_NS) == ("body_1", "body_2")


def test_who_was_away_for_too_long_is_somebody_new(tracks) -> None:
    tracks.assign([at(0.0)], 0)
    away = RETURN_NS // STEP_NS + 1
    for k in range(1, away):
        assert tracks.assign([], k * STEP_NS) == ()
    assert tracks.assign([at(0.0)], away * STEP_NS) == ("body_2",)


@pytest.mark.parametrize(("way", "name"), [(0.5, "body_1"), (0.7, "body_2"), (3.0, "body_2")])
def test_nobody_jumps(tracks, way, name) -> None:
    """From one frame to the next a person's middle moves by 57 cm at most."""
    tracks.assign([at(0.0)], 0)
    assert tracks.assign([at(way)], STEP_NS) == (name,)


def test_heights_do_not_count(tracks) -> None:
    """Somebody whose legs vanish behind a table has a higher middle, and is the same."""
    tracks.assign([at(0.0, y=0.3)], 0)
    assert tracks.assign([at(0.0, y=-0.5)], STEP_NS) == ("body_1",)


def test_two_side_by_side_never_swap(tracks) -> None:
    """Shoulder to shoulder, with middles that tremble by 5 cm, seen in any order."""
    rng = np.random.default_rng(1)
    for k in range(300):
        shown = [at(x + 0.05 * rng.standard_normal(), 3.0 + 0.05 * rng.standard_normal()) for x in (0.0, 0.5)]
        expected = ("body_1", "body_2")
        if k and rng.random() < 0.5:
            shown, expected = shown[::-1], expected[::-1]
        assert tracks.assign(shown, k * STEP_NS) == expected


def test_the_sum_of_distances_decides_not_the_nearest_pair(tracks) -> None:
    """Both moved half a metre to the right: the first now stands where the second stood."""
    tracks.assign([at(0.0), at(0.5)], 0)
    assert tracks.assign([at(0.5), at(0.95)], STEP_NS) == ("body_1", "body_2")


@pytest.mark.parametrize(
    ("first", "then", "names"),
    [(0.59, 0.59, (None, None)), (0.9, 0.3, ("body_1", "body_1")), (0.9, 0.29, ("body_1", None))],
)
def test_how_likely_a_person_must_be_to_start_and_to_go_on(tracks, first, then, names) -> None:
    one = tracks.assign([at(0.0, probability=first)], 0)
    two = tracks.assign([at(0.0, probability=then)], STEP_NS)
    assert one + two == names


def test_who_was_doubted_for_a_while_is_the_same(tracks) -> None:
    for k, (probability, name) in enumerate([(0.9, "body_1"), (0.1, None), (0.1, None), (0.4, "body_1")]):
        assert tracks.assign([at(0.0, probability=probability)], k * STEP_NS) == (name,)


@pytest.mark.parametrize("step_ns", [-STEP_NS, STEP_NS])
def test_after_a_reset_everybody_is_new(tracks, step_ns) -> None:
    assert tracks.assign([at(0.0), at(1.0)], 10 * STEP_NS) == ("body_1", "body_2")
    tracks.reset()
    assert tracks.assign([at(0.0), at(1.0)], 10 * STEP_NS + step_ns) == ("body_3", "body_4")


def test_no_name_is_given_twice(tracks) -> None:
    """Whoever comes, goes, and is forgotten."""
    given: set[str] = set()
    for k in range(20):
        (name,) = tracks.assign([at(2.0 * (k % 2))], 2 * k * RETURN_NS)
        assert name not in given
        given.add(name)
    tracks.reset()
    (name,) = tracks.assign([at(0.0)], 40 * RETURN_NS)
    assert name not in given


def test_the_same_again_gives_the_same() -> None:
    """Twelve who mill about, with some who are missed: names repeat in a second run."""

    def run() -> list[tuple[str | None, ...]]:
        rng, tracks = np.random.default_rng(3), new_tracks()
        places = rng.uniform(-3, 3, (12, 2)) + [0.0, 5.0]
        out = []
        for k in range(100):
            places = places + rng.normal(0.0, 0.03, places.shape)
            shown = [at(x, z, probability=rng.random()) for x, z in places[rng.random(12) < 0.9]]
            out.append(tracks.assign(shown, k * STEP_NS))
        return out

    assert run() == run()


def test_no_two_in_a_frame_share_a_name() -> None:
    rng, tracks = np.random.default_rng(4), new_tracks()
    for k in range(200):
        shown = [at(*rng.uniform(-1, 1, 2) + [0.0, 3.0]) for _ in range(rng.integers(0, 6))]
        names = [n for n in tracks.assign(shown, k * STEP_NS) if n is not None]
        assert len(names) == len(set(names)) == len(shown)


@pytest.mark.parametrize("fps", [5, 30])
@pytest.mark.parametrize("speed", [0.6, 1.5])
def test_people_who_cross_with_one_hidden_keep_their_names(tracks, fps, speed) -> None:
    """The farther one is hidden while the nearer one is before them."""
    rng, step_ns = np.random.default_rng(5), 10**9 // fps
    frames = int(3.0 / speed * fps)
    for k in range(frames):
        x = -1.5 + speed * k / fps
        near, far = person(1.75, x, 2.5, 1, rng=rng), person(1.6, -x, 3.3, 2, rng=rng)
        is_hidden = abs(-x / 3.3 - x / 2.5) < 0.12
        shown, names = ([near], ("body_1",)) if is_hidden else ([near, far], ("body_1", "body_2"))
        assert tracks.assign(shown, k * step_ns) == names


@pytest.mark.parametrize("fps", [5, 30])
@pytest.mark.parametrize("way", [0.0, 0.8, -0.8])
def test_who_is_hidden_for_four_seconds_comes_back_as_themselves(tracks, fps, way) -> None:
    """They walk behind a shelf and come out where they went in, on the other side, or in between."""
    rng, step_ns = np.random.default_rng(6), 10**9 // fps
    for k in range(9 * fps):
        seconds = k / fps
        other = person(1.7, 1.5, 3.0, 1, rng=rng)
        if 3.0 < seconds < 7.0:
            assert tracks.assign([other], k * step_ns) == ("body_1",)
            continue
        x = -1.5 + 0.3 * seconds if seconds < 5.0 else -0.6 + way + 0.3 * (seconds - 7.0)
        assert tracks.assign([other, person(1.72, x, 3.5, 2, rng=rng)], k * step_ns) == ("body_1", "body_2")


@pytest.mark.parametrize("fps", [5, 30])
def test_two_of_different_size_change_places_while_hidden(tracks, fps) -> None:
    """An adult and a child behind a screen for 2 s: the places mislead, and the sizes are right."""
    rng, step_ns = np.random.default_rng(7), 10**9 // fps
    for k in range(6 * fps):
        seconds = k / fps
        side = 0.35 if seconds < 2.0 else -0.35
        shown = [person(1.8, -side, rng=rng), person(1.25, side, rng=rng)]
        if 2.0 <= seconds < 4.0:
            assert tracks.assign([], k * step_ns) == ()
        else:
            assert tracks.assign(shown, k * step_ns) == ("body_1", "body_2")


def test_two_of_one_size_are_told_apart_by_place(tracks) -> None:
    rng = np.random.default_rng(8)
    for k in range(150):
        shown = [person(1.7, -0.5, pose=1, rng=rng), person(1.7, 0.5, pose=1, rng=rng)]
        if 50 <= k < 100:
            assert tracks.assign([], k * STEP_NS) == ()
        else:
            assert tracks.assign(shown, k * STEP_NS) == ("body_1", "body_2")


@pytest.mark.parametrize("fps", [5, 30])
def test_who_is_in_view_keeps_the_name_though_somebody_hidden_was_nearer(tracks, fps) -> None:
    """One is hidden at the middle; the other steps there within a second: nobody has come back."""
    rng, step_ns = np.random.default_rng(9), 10**9 // fps
    for k in range(3 * fps):
        seconds = k / fps
        walker = person(1.7, -1.2 + max(0.0, seconds - 1.0), 3.0, 1, rng=rng)
        if seconds < 1.0:
            shown = [walker, person(1.7, 0.0, 3.4, 2, rng=rng)]
            assert tracks.assign(shown, k * step_ns) == ("body_1", "body_2")
        else:
            assert tracks.assign([walker], k * step_ns) == ("body_1",)


def test_a_newcomer_where_somebody_left_has_a_new_name_if_the_build_differs(tracks) -> None:
    rng = np.random.default_rng(10)
    for k in range(100):
        if k < 40:
            assert tracks.assign([person(1.8, 0.0, rng=rng)], k * STEP_NS) == ("body_1",)
        elif k < 70:
            assert tracks.assign([], k * STEP_NS) == ()
        else:
            assert tracks.assign([person(1.4, 0.05, rng=rng)], k * STEP_NS) == ("body_2",)


def test_a_newcomer_far_from_where_somebody_left_has_a_new_name(tracks) -> None:
    """In half a second nobody walks four metres."""
    for k in range(20):
        assert tracks.assign([person(1.7, -2.0)], k * STEP_NS) == ("body_1",)
    for k in range(20, 32):
        assert tracks.assign([], k * STEP_NS) == ()
    assert tracks.assign([person(1.7, 2.0)], 32 * STEP_NS) == ("body_2",)


def test_at_five_frames_a_second_a_runner_keeps_the_name(tracks) -> None:
    """Running at 4 m/s from a stand, 80 cm a frame: nobody else is there."""
    for k in range(12):
        assert tracks.assign([person(1.7, -2.0 + max(0.0, 0.8 * (k - 4)))], k * 200_000_000) == ("body_1",)


def test_a_part_of_somebody_does_not_bring_back_who_is_hidden(tracks) -> None:
    """For a frame the finder sees a person twice in one place; who is hidden a metre away stays hidden."""
    for k in range(20):
        shown = [person(1.7, 0.0, pose=1), person(1.7, 1.0, pose=2)]
        assert tracks.assign(shown, k * STEP_NS) == ("body_1", "body_2")
    for k in range(20, 40):
        assert tracks.assign([person(1.7, 0.0, pose=1)], k * STEP_NS) == ("body_1",)
    part = person(1.6, 0.15, pose=3)
    part = replace(part, measured=replace(part.measured, confidence=part.measured.confidence * 0.4))
    assert tracks.assign([person(1.7, 0.0, pose=1), part], 40 * STEP_NS) == ("body_1", None)
    assert tracks.assign([person(1.7, 0.0, pose=1)], 41 * STEP_NS) == ("body_1",)


def test_who_comes_back_little_by_little_is_themselves() -> None:
    """First seen with doubt, as something new that is followed, and then for sure."""
    tracks = new_tracks(keep=0.2)
    for k in range(20):
        assert tracks.assign([person(1.7, 0.0)], k * STEP_NS) == ("body_1",)
    for k in range(20, 80):
        assert tracks.assign([], k * STEP_NS) == ()
    doubtful = [tracks.assign([person(1.7, 1.3, probability=0.7)], k * STEP_NS)[0] for k in range(80, 84)]
    assert set(doubtful) <= {None, "body_1"}
    assert tracks.assign([person(1.7, 1.3, probability=0.99)], 84 * STEP_NS) == ("body_1",)
    assert 0.9 < tracks.probability("body_1") < 1.0


def test_a_coat_does_not_become_who_went_out_beside_it() -> None:
    """The coat was there before they were gone."""
    tracks = new_tracks(keep=0.2)
    coat = person(1.6, 0.4, 3.4, 3, probability=0.8)
    for k in range(40):
        shown = [coat, person(1.7, -1.0 + 0.04 * k, 3.0, 1)]
        assert tracks.assign(shown, k * STEP_NS) == (None, "body_1")
    for k in range(40, 120):
        assert tracks.assign([coat], k * STEP_NS) == (None,)


def test_from_a_ceiling_the_way_along_the_columns_counts(tracks) -> None:
    """Seen from above, two who stand one above the other in the image do not change names."""
    rng = np.random.default_rng(11)
    for k in range(60):
        shown = [at(0.0, 2.0 + 0.02 * rng.standard_normal(), y) for y in (-0.6, 0.6)]
        expected = ("body_1", "body_2")
        if k and rng.random() < 0.5:
            shown, expected = shown[::-1], expected[::-1]
        assert tracks.assign(shown, k * STEP_NS) == expected


def test_a_look_that_is_wrong_about_the_size_changes_no_name(tracks) -> None:
    """Somebody bends down and seems small for a while."""
    for k in range(60):
        stature = 1.1 if 30 <= k < 40 else 1.75
        assert tracks.assign([person(stature, 0.01 * k)], k * STEP_NS) == ("body_1",)
