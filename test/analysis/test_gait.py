"""Steps of simulated walkers whose cadence, speed and footprints are known."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from walked import skeletons_of, write

from depth_pose.analysis import analyse_recording
from depth_pose.core.skeleton import NODE_INDEX
from depth_pose.sim.function import walk_straight

FPS, SECONDS = 30.0, 8.0


def measures_of(path):
    (person,) = analyse_recording(path).people
    return {(m.name, m.side): m for m in person.gait.measures}


def true_steps(clip, cadence):
    """Mean step length of the left and of the right foot, metres, by standing ankles."""
    nodes, lengths = clip.nodes(), {}
    places = []
    for k in range(1, int(cadence / 60.0 * SECONDS) - 1):  # the left foot touches down at k / 2, of even k
        side = "left" if k % 2 == 0 else "right"
        frame = round((k / 2 + 0.2) * 120.0 / cadence * FPS)
        places.append((side, nodes[frame, NODE_INDEX[f"{side}_ankle"], 2]))
    for (_, before), (side, after) in pairwise(places):
        lengths.setdefault(side, []).append(after - before)
    return tuple(np.mean(lengths[side]) for side in ("left", "right"))


@pytest.mark.parametrize(("seed", "turn"), [(0, 0.0), (1, 90.0), (2, 180.0), (3, 40.0)])
def test_a_walk_is_measured(tmp_path, seed, turn):
    clip = walk_straight(FPS, SECONDS, seed, cadence=90.0 + 9.0 * seed)
    path = write(tmp_path / "walk.mcap", skeletons_of(clip, turn, seed))
    found = measures_of(path)
    true_speed = np.linalg.norm((clip.roots[-1] - clip.roots[0])[[0, 2]]) / ((len(clip) - 1) / FPS)
    assert found["cadence", ""].value == pytest.approx(90.0 + 9.0 * seed, rel=0.02)
    assert found["speed", ""].value == pytest.approx(true_speed, rel=0.03)
    for side, true in zip(("left", "right"), true_steps(clip, 90.0 + 9.0 * seed), strict=True):
        step = found["step length", side]
        assert step.value == pytest.approx(true, abs=0.03)
        assert step.count >= 4
        assert 0.001 < step.deviation < 0.02
    stance = [found["stance", side].value for side in ("left", "right")]
    assert all(55 < value < 70 for value in stance)
    assert found["swing", "left"].value == pytest.approx(100 - stance[0])
    assert 10 < found["double support", ""].value < 35


def test_somebody_slow_who_almost_stands_at_each_step_walks_on(tmp_path):
    """At .31 m/s the pelvis has less than .25 m/s for some frames of each step."""
    clip = walk_straight(FPS, 4.0, 2, cadence=100.0, size=0.5)
    person = analyse_recording(write(tmp_path / "walk.mcap", skeletons_of(clip, 90.0, 2))).people[0]
    cadence = next(m for m in person.gait.measures if m.name == "cadence")
    assert cadence.value == pytest.approx(100.0, rel=0.02)
    assert (len(person.gait.walks), cadence.count) == (1, 4)


@pytest.mark.parametrize(("dropped", "walks"), [(range(60, 62), 1), (range(60, 90), 2)])
def test_a_walk_goes_on_through_dropped_frames(tmp_path, dropped, walks):
    clip = walk_straight(FPS, SECONDS, 1, cadence=100.0)
    skeletons = [s for k, s in enumerate(skeletons_of(clip, 90.0)) if k not in dropped]
    gait = analyse_recording(write(tmp_path / "walk.mcap", skeletons)).people[0].gait
    assert len(gait.walks) == walks
    assert next(m for m in gait.measures if m.name == "cadence").value == pytest.approx(100.0, rel=0.02)


def test_cadence_is_that_of_all_events_not_of_the_first_and_the_last(tmp_path):
    """Root mean square of twenty walks of four seconds."""
    off = []
    for seed in range(20):
        cadence = 92.0 + 1.4 * seed
        clip = walk_straight(FPS, 4.0, seed, cadence=cadence, size=0.9)
        found = measures_of(write(tmp_path / f"{seed}.mcap", skeletons_of(clip, 30.0 * seed, seed)))
        if found["cadence", ""].count:
            off.append(found["cadence", ""].value / cadence - 1.0)
            assert abs(off[-1]) < 3 * found["cadence", ""].deviation / cadence + 0.005
    assert len(off) >= 15
    assert np.sqrt(np.mean(np.square(off))) < 0.0045


def test_steps_of_unlike_length_are_told(tmp_path):
    """Simulated walkers are a little lame: each leg has its own curves."""
    clip = walk_straight(FPS, SECONDS, 4, cadence=100.0)
    skeletons = skeletons_of(clip)
    found = measures_of(write(tmp_path / "walk.mcap", skeletons))
    left, right = true_steps(clip, 100.0)
    said = found["symmetry of step length", ""]
    assert said.value == pytest.approx(
        100 * (left - right) / (0.5 * (left + right)), abs=3 * said.deviation + 1
    )


def test_events_do_not_depend_on_where_the_camera_stands(tmp_path):
    clip = walk_straight(FPS, SECONDS, 5)
    paths = [write(tmp_path / f"{turn}.mcap", skeletons_of(clip, turn)) for turn in (0.0, 70.0)]
    times = []
    for path in paths:
        (person,) = analyse_recording(path).people
        (walk,) = person.gait.walks
        times.append([(event.side, event.strike) for event in walk.events])
    assert [side for side, _ in times[0]] == [side for side, _ in times[1]]
    np.testing.assert_allclose([t for _, t in times[0]], [t for _, t in times[1]], atol=0.06)


@pytest.mark.parametrize(
    ("seconds", "values", "knows_floor", "reason"),
    [
        (1.5, {}, True, "steps were seen whole; 4 are needed"),
        (SECONDS, {"joint_confidence": np.full(19, 0.3, np.float32)}, True, "ankles are sure in at most 0%"),
        (SECONDS, {"joint_confidence": np.full(19, 0.3, np.float32)}, False, "no floor"),
    ],
)
def test_what_a_recording_does_not_show_is_refused_with_the_reason(
    tmp_path, seconds, values, knows_floor, reason
):
    skeletons = skeletons_of(walk_straight(FPS, seconds, 0), **values)
    found = measures_of(write(tmp_path / "walk.mcap", skeletons, knows_floor))
    assert all(not m.is_known and np.isnan(m.value) for m in found.values())
    assert all(reason in m.reason for m in found.values())


def test_five_frames_a_second_are_too_few(tmp_path):
    (person,) = analyse_recording(
        write(tmp_path / "walk.mcap", skeletons_of(walk_straight(5.0, SECONDS, 0)))
    ).people
    for part, least in ((person.gait, 15), (person.rising, 10), (person.sway, 10)):
        assert {m.reason for m in part.measures} == {f"5.0 frames a second are too few; {least} are needed"}
    assert any(not r.reason for r in person.ranges)
