"""Playback, tables, colours, pictures: what the viewer does beside talking to a browser."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from depth_pose.core.frame import DepthFrame
from depth_pose.core.result import Skeleton
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL, matrix_to_quat
from depth_pose.core.skeleton import JOINT_NODES, JointState, Source
from depth_pose.core.zone import parse_zone
from depth_pose.ros.tools.watch import NodeState
from depth_pose.viewer import colours
from depth_pose.viewer.frames import ViewerFrame, keep, owners
from depth_pose.viewer.playback import Playback
from depth_pose.viewer.screenshots import free_name, save_gif, save_png
from depth_pose.viewer.source import Recent, RecordedSource
from depth_pose.viewer.tables import chosen, nodes_table, people_table
from synthetic import CAMERA, START_NS, STEP_NS, posed, varied


def skeleton_at(x, z, body_id="body_1", confidence=0.8, hidden=0):
    rotations = varied(1, 5.0)
    nodes = posed(rotations, aside=x, distance=z).nodes
    states = np.zeros(19, np.uint8)
    states[:hidden] = JointState.OCCLUDED
    quats = matrix_to_quat((R_CAMERA_FACING_MODEL @ rotations)[JOINT_NODES])
    sure = np.full(19, 0.5, np.float32)
    found = (Source.REFINED, confidence, 0.01, 1.0, nodes[JOINT_NODES], quats, sure, states)
    return Skeleton(START_NS, "optical", body_id, *found)


def loaded(count):
    playback = Playback()
    for i in range(count):
        playback.add(START_NS + i * STEP_NS)
    return playback


def test_time_moves_the_frame_at_the_chosen_speed():
    playback = loaded(100)
    playback.advance(0.1)
    assert playback.index == 2
    playback.speed = 4.0
    playback.advance(0.1)
    assert playback.index == 12
    playback.playing = False
    playback.advance(5.0)
    assert playback.index == 12
    assert playback.seconds == pytest.approx(12 * 0.04)


def test_playback_waits_for_what_is_not_read_and_loops_after():
    playback = loaded(10)
    playback.advance(60.0)
    assert playback.index == 9
    playback.add(START_NS + 10 * STEP_NS)
    playback.advance(0.05)
    assert playback.index == 10
    playback.finish()
    playback.advance(1.0)
    assert playback.index == 0


def test_steps_pause_and_stay_inside():
    playback = loaded(5)
    playback.step(2)
    assert (playback.index, playback.playing) == (2, False)
    playback.step(-9)
    assert playback.index == 0
    playback.seek(99)
    assert playback.index == 4


def test_stamps_that_jump_back_do_not_stop_playback():
    playback = loaded(3)
    for i in range(3):
        playback.add(START_NS + i * STEP_NS)
    playback.seek(5)
    assert playback.index == 5


def test_a_kept_frame_has_the_points_of_the_image():
    rng = np.random.default_rng(0)
    depth = (rng.integers(500, 4000, (144, 176)) / 1e3).astype(np.float32)
    depth[::3] = np.nan
    frame = keep(DepthFrame(START_NS, "optical", depth, CAMERA), None, most=2000)
    points = frame.points()
    assert len(points) <= 2000
    everything = CAMERA.back_project(depth).reshape(-1, 3)
    everything = everything[np.isfinite(everything).all(axis=1)]
    gaps = np.linalg.norm(points[:50, None] - everything, axis=2).min(axis=1)
    assert gaps.max() < 2e-3, "millimetres, and the right rays"


def test_points_belong_to_the_nearest_person():
    people = (skeleton_at(-0.5, 3.0), skeleton_at(0.5, 3.0, "body_2"))
    points = np.concatenate([people[0].positions, people[1].positions, [[0, 0, 6.0]]]).astype(np.float32)
    points[:38, 2] -= 0.05
    owner = owners(points, people)
    assert (owner[:19] == 0).all()
    assert (owner[19:38] == 1).all()
    assert owner[38] == -1


def test_floor_before_the_feet_is_not_the_persons():
    person = skeleton_at(0.0, 3.0)
    toe = person.positions[14]
    floor = np.array([toe + (0, 0.04, -0.3)], np.float32)
    assert owners(floor, (person,))[0] == -1


def test_zone_and_number_choose_people():
    people = [skeleton_at(0.0, z, f"body_{i}") for i, z in enumerate((4.0, 2.0, 3.0))]
    assert [s.body_id for s in chosen(people, parse_zone(""), 2)] == ["body_1", "body_2"]
    assert [s.body_id for s in chosen(people, parse_zone("2.5:3.5"), 0)] == ["body_2"]
    assert len(chosen(people, parse_zone(""), 0)) == 3


def test_the_table_says_who_is_there():
    text = people_table([skeleton_at(0.0, 3.0, "body_7", confidence=0.66, hidden=4)], "body_7")
    row = text.splitlines()[2]
    assert [c.strip() for c in row.strip("|").split("|")][:2] == ["●", "body_7"]
    assert "| 3.0 |" in row
    assert "0.66" in row
    assert "15/19" in row
    assert people_table((), "") != people_table(None, "")
    later = people_table([skeleton_at(0.0, 3.0)], "", START_NS + 200_000_000)
    assert "| 0.2 s ago |" in later and "ago" not in people_table([skeleton_at(0.0, 3.0)], "", START_NS)


def test_who_had_no_turn_is_shown_for_a_second():
    """As by nodes that answer one person a frame."""

    depth = np.zeros((144, 176), np.uint16)
    recent, shown = Recent(), []
    for step, body_id in ((0, "body_10"), (1, "body_2"), (20, "body_3"), (26, "body_3"), (0, "body_1")):
        stamp = START_NS + step * STEP_NS
        people = (replace(skeleton_at(0.0, 3.0, body_id), stamp_ns=stamp),)
        recent.add(people)
        shown.append([s.body_id for s in recent.people(ViewerFrame(stamp, depth, CAMERA, people))])
    assert shown[:2] == [["body_10"], ["body_2", "body_10"]]
    assert shown[2:4] == [["body_2", "body_3", "body_10"], ["body_2", "body_3"]]
    assert shown[4] == ["body_1"], "time went back"


def test_names_of_others_stay_text_in_the_tables():
    """Markdown of a stranger may show an image from elsewhere, which tells them who looks."""
    evil = "a|![x](http://e/x.png)<b>\n\x1b[2J"
    shown = r"a\|\!\[x\]\(http\://e/x.png\)\<b\>\\n\\x1b\[2J"
    assert f"| {shown} |" in people_table([skeleton_at(0.0, 3.0, evil)], "")
    values = {"rate_hz": evil, "dropped: " + evil: "1"}
    text = nodes_table([NodeState(evil.replace("/", ""), evil, values)])
    assert text.count(shown) == 3 and "![x]" not in text and "\x1b" not in text


def test_the_table_of_nodes_has_drops_by_reason():
    values = {
        "rate_hz": "24.9",
        "process_ms_median": "8.1",
        "latency_ms_median": "31.0",
        "dropped: queue": "3",
    }
    text = nodes_table([NodeState("/depth_pose/refine", "dropped 3 queue", values)])
    assert "| refine | 24.9 | 8.1 | 31.0 | 3 queue |" in text


def test_confidence_goes_from_red_to_green():
    low, high = colours.of_confidence(np.array([0.05, 0.95]))
    assert low[0] > 2 * low[1]
    assert high[1] > 2 * high[0]
    assert not (colours.of_person("body_1") == colours.of_person("body_2")).all()


def test_pictures_are_written_and_never_over_others(tmp_path):
    rng = np.random.default_rng(1)
    pictures = [rng.integers(0, 255, (20, 30, 3), dtype=np.uint8) for _ in range(3)]
    first = free_name(tmp_path, ".png")
    save_png(first, pictures[0])
    np.testing.assert_array_equal(np.asarray(Image.open(first)), pictures[0])
    assert free_name(tmp_path, ".png") != first
    save_gif(tmp_path / "clip.gif", pictures, 0.1)
    with Image.open(tmp_path / "clip.gif") as clip:
        assert (clip.n_frames, clip.size, clip.info["duration"]) == (3, (30, 20), 100)


def test_a_recording_that_breaks_off_shows_what_was_read():
    from depth_pose.core.errors import InputError

    def frames():
        depth = np.full((144, 176), 2.0, np.float32)
        for i in range(3):
            yield DepthFrame(START_NS + i * STEP_NS, "optical", depth, CAMERA)
        raise InputError("in.mcap ends too early")

    source = RecordedSource(frames(), lambda frame: None, 1000)
    source.start()
    source.wait()
    assert len(source.playback) == 3
    assert source.error == "in.mcap ends too early"
