"""The library's front door: six lines, checked inputs, results in other forms, the bank that comes along."""

from __future__ import annotations

import copy
import doctest
import json
import pickle
import re
import subprocess
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import get_args
from xml.etree import ElementTree

import numpy as np
import pytest

import depth_pose
from depth_pose import BankError, Camera, ConfigError, DepthFrame, InputError, JointState, Tracker, Tracking
from depth_pose.core.errors import DepthPoseError
from depth_pose.core.result import Skeleton
from depth_pose.detect.sample_frame import sample_frame
from depth_pose.io.mcap_write import DepthWriter

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def tracker(bank):
    return Tracker(bank, quiet=True)


@pytest.fixture
def fresh(tracker):
    """The same tracker, of no frame."""
    tracker.reset()
    return tracker


@pytest.fixture(scope="module")
def new(bank):
    """A tracker that was never given a right frame, and so does not know the unit."""
    return Tracker(bank, quiet=True)


@pytest.fixture(scope="module", params=[False, True], ids=["single images", "a stream"])
def unwarned(request, bank):
    """A tracker that has not said anything yet, and whether its frames have times."""
    return Tracker(bank, quiet=True), request.param


@pytest.fixture(scope="module")
def frame():
    """Whole millimetres, as sensors send them."""
    frame = sample_frame()
    return replace(frame, depth=np.round(frame.depth, 3))


@pytest.fixture(scope="module")
def person(tracker, frame):
    tracker.reset()
    (found,) = tracker(frame.depth, frame.camera, time=0.0)
    return found


def test_the_six_lines_of_the_readme_run(frame, bank_path, monkeypatch, capsys):
    monkeypatch.setenv("DEPTH_POSE_BANK", str(bank_path))
    lines = (ROOT / "README.md").read_text().split("```python\n")[1].split("```")[0]
    assert len([line for line in lines.splitlines() if line.strip()]) == 6
    depth = (1000 * frame.depth).astype(np.uint16)
    width, height, K = frame.camera.width, frame.camera.height, frame.camera.matrix()
    lines = lines.replace("width=640, height=480", f"width={width}, height={height}")
    exec(lines, {"K": K, "frames": [(0.0, depth), (0.04, depth)]})
    said = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in said] == ["body_1", "body_1"]


@pytest.mark.parametrize("module", ["core.camera", "core.result", "people", "tracker"])
def test_the_docstrings_examples_run(module, bank_path, monkeypatch):
    monkeypatch.setenv("DEPTH_POSE_BANK", str(bank_path))
    failed, attempted = doctest.testmod(import_module(f"depth_pose.{module}"))
    assert attempted > 1
    assert not failed


def test_everything_is_exported_and_loaded_late():
    assert all(getattr(depth_pose, name) is not None for name in depth_pose.__all__)
    assert set(depth_pose.__all__) <= set(dir(depth_pose))
    with pytest.raises(AttributeError, match="'depth_pose' has no attribute 'Skeletons'"):
        _ = depth_pose.Skeletons
    code = "import sys, depth_pose; print(len({'numpy', 'numba', 'rich', 'scipy'} & set(sys.modules)))"
    assert subprocess.check_output([sys.executable, "-c", code], text=True) == "0\n"


def test_tracking_loads_no_open3d(bank_path):
    code = (
        "import sys, depth_pose; from depth_pose.detect.sample_frame import sample_frame as f; "
        f"t = depth_pose.Tracker({str(bank_path)!r}, quiet=True); assert len(t(f())) == 1; "
        "print([m for m in ('open3d', 'matplotlib', 'rclpy', 'mcap') if m in sys.modules])"
    )
    assert subprocess.check_output([sys.executable, "-c", code], text=True) == "[]\n"


# --- what goes in


@pytest.mark.parametrize("kind", ["uint16", "int32", ">u2", "float32", "float64", "fortran", "channel"])
def test_images_of_any_type_give_the_same_skeleton(fresh, frame, person, kind):
    depth = frame.depth
    if kind in ("uint16", "int32", ">u2"):
        depth = np.round(1000 * depth).astype(kind)
    elif kind == "fortran":
        depth = np.asfortranarray(depth)
    elif kind == "channel":
        depth = depth[..., None]
    else:
        depth = depth.astype(kind)
    (found,) = fresh(depth, frame.camera)
    np.testing.assert_allclose(found.positions, person.positions, atol=0.02)  # millimetres are rounded


def test_holes_may_be_zero_nan_or_infinite(fresh, frame):
    depth = frame.depth.copy()
    depth[:20] = 0.0
    first = fresh(depth, frame.camera)[0].positions
    for hole in (np.nan, np.inf, -1.0):
        depth[:20] = hole
        np.testing.assert_array_equal(fresh(depth, frame.camera)[0].positions, first)


@pytest.mark.parametrize("organised", [False, True])
def test_a_point_cloud_gives_the_same_skeleton(fresh, frame, person, organised):
    points = frame.camera.back_project(frame.depth)
    cloud = points if organised else points.reshape(-1, 3).astype(np.float64)
    (found,) = fresh(cloud)
    assert np.linalg.norm(found.positions - person.positions, axis=1).mean() < (0.001 if organised else 0.03)


def test_a_frame_of_a_recording_is_taken_as_it_is(tmp_path, tracker, frame, person):
    with DepthWriter(tmp_path / "in.mcap", frame.camera, "optical") as writer:
        writer.write(40_000_000, frame.depth)
    tracker.reset()
    (read,) = depth_pose.read_recording(tmp_path / "in.mcap")
    (found,) = tracker(read)
    assert (found.stamp_ns, found.frame_id) == (40_000_000, "optical")
    np.testing.assert_allclose(found.positions, person.positions, atol=0.02)  # millimetres are rounded


def test_depth_scale_is_the_unit(bank, frame, person):
    tracker = Tracker(bank, depth_scale=0.0002, quiet=True)
    (found,) = tracker((5000 * frame.depth).astype(np.uint16), frame.camera)
    assert np.linalg.norm(found.positions - person.positions, axis=1).mean() < 0.01
    for scale in (0.0, -1.0, float("nan")):
        with pytest.raises(ConfigError, match="depth_scale"):
            Tracker(bank, depth_scale=scale, quiet=True)


GOOD = np.full((144, 176), 2.0, np.float32)
CAMERA = Camera(176, 144, 170.0, 170.0, 87.5, 71.5)


@pytest.mark.parametrize(
    ("depth", "camera", "says"),
    [
        (1000 * GOOD, CAMERA, "median is 2000 metres.*depth_scale=0.001: these look like millimetres"),
        (1e5 * GOOD, CAMERA, "median is 200000 metres, which no sensor"),
        (0.001 * GOOD, CAMERA, "median is 0.002 metres"),
        ((5e4 * GOOD / 4).astype(np.uint16), CAMERA, "uint16, so millimetres, but its median is 25000"),
        (GOOD.astype(np.uint16), CAMERA, "so millimetres, but its median is 2 millimetres"),
        (np.full((144, 176), 200, np.uint8), CAMERA, "uint8, at most 255 mm"),
        (np.zeros((144, 176, 3), np.uint8), CAMERA, "a colour image has no depth"),
        (GOOD > 1, CAMERA, "dtype bool"),
        (np.array([["a"]]), CAMERA, "dtype <U1"),
        (GOOD[:120], CAMERA, "120 rows and 176 columns, but the camera's image has 144 and 176"),
        (GOOD.T, CAMERA, "looks transposed"),
        (GOOD[None], CAMERA, r"shape \(1, 144, 176\)"),
        (GOOD, None, "needs its camera"),
        (GOOD, (170.0, 170.0, 87.5, 71.5), "camera is a tuple"),
        (GOOD, CAMERA.matrix(), "camera is a ndarray"),
        (GOOD, CAMERA._replace(fx=0.0), "focal lengths"),
        (GOOD, CAMERA._replace(cx=float("nan")), "finite"),
        (GOOD, CAMERA._replace(fx=1.7, fy=1.7), "focal lengths"),
        (np.zeros((10, 3), np.float32), None, "no point with z > 0"),
        (np.full((10, 3), 2500.0), None, "these look like millimetres"),
        (np.ones((144, 176, 3)), CAMERA, "a point cloud, which has no camera"),
        (np.ones((10, 3), np.uint16), None, "a point cloud is float metres"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_wrong_inputs_are_refused_with_the_reason(new, depth, camera, says):
    with pytest.raises(InputError, match=says):
        new(depth, camera, time=0.0)


def test_the_unit_is_checked_until_an_image_has_shown_it(bank):
    new = Tracker(bank, quiet=True)
    new(np.zeros((144, 176), np.uint16), CAMERA)  # the lens is covered: nothing to see
    with pytest.raises(InputError, match="which no sensor"):
        new(np.full((144, 176), 40_000, np.uint16), CAMERA)
    new(np.full((144, 176), 2_000, np.uint16), CAMERA)
    new(np.full((144, 176), 40_000, np.uint16), CAMERA)


@pytest.mark.parametrize(
    ("time", "says"),
    [
        (float("nan"), "finite"),
        (-1.0, "not below 0"),
        ("1", "seconds as a float"),
        (True, "seconds as a float"),
        (np.datetime64("2020-01-01"), "seconds as a float"),
    ],
)
def test_wrong_times_are_refused(fresh, time, says):
    with pytest.raises(InputError, match=says):
        fresh(GOOD, CAMERA, time=time)


def test_frame_numbers_are_not_times(fresh):
    fresh(GOOD, CAMERA, time=0)
    with pytest.raises(InputError, match="integers are nanoseconds"):
        fresh(GOOD, CAMERA, time=1)


@pytest.mark.parametrize(
    ("time", "says"),
    [
        (1e300, "at most 9e.09 seconds"),
        (10**19, "at most 9e.09 seconds"),
        (np.float32(1.7e9), "steps of 128 s"),
        (np.float16(60.0), "float16"),
    ],
)
def test_times_that_hold_no_time_are_refused(fresh, time, says):
    with pytest.raises(InputError, match=says):
        fresh(GOOD, CAMERA, time=time)


def test_a_late_frame_is_skipped_with_a_warning_and_ids_are_kept(fresh, frame):
    ids = [fresh(frame.depth, frame.camera, time=t)[0].id for t in (5.0, 5.04)]
    with pytest.warns(RuntimeWarning, match=r"0\.040 s older than one before it"):
        assert fresh(frame.depth, frame.camera, time=5.0) == ()
    ids += [fresh(frame.depth, frame.camera, time=t)[0].id for t in (5.08, 6.2)]
    assert len(set(ids)) == 1


def test_a_frame_in_millimetres_is_refused(bank, frame):
    with pytest.raises(InputError, match="these look like millimetres"):
        Tracker(bank, quiet=True)(depth_pose.DepthFrame(0, "", 1000 * frame.depth, frame.camera))


@pytest.mark.parametrize("dtype", ["uint16", "float32"])
def test_masked_pixels_have_no_depth(fresh, frame, dtype):
    depth = (1000 * frame.depth).round().astype("uint16") if dtype == "uint16" else frame.depth
    spoilt, holes = depth.copy(), depth.copy()
    mask = np.zeros(depth.shape, bool)
    mask[:40] = mask[:, :30] = True
    spoilt[mask], holes[mask] = depth[100, 88], 0
    expected = fresh(holes, frame.camera)[0].positions
    (found,) = fresh(np.ma.masked_array(spoilt, mask), frame.camera)
    np.testing.assert_array_equal(found.positions, expected)


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"config": 5}, "the settings are 5; give a mapping"),
        ({"config": {"segment": 5}}, "segment is 5; it must be a mapping"),
        ({"config": {"segment": {"far": "x"}}}, "segment.far is 'x'"),
        ({"config": {7: {}}}, "no such section: 7"),
        ({"bank": 5}, "bank is 5; give a Bank, or the path"),
        ({"depth_scale": "mm"}, "depth_scale is 'mm'"),
        ({"depth_scale": True}, "depth_scale is True"),
        ({"frame_id": 5}, "frame_id is 5"),
    ],
)
def test_wrong_settings_are_refused_with_what_to_give(settings, says):
    with pytest.raises(ConfigError, match=says):
        Tracker(quiet=True, **settings)


def test_one_tracker_in_three_threads_is_refused_and_not_mixed(bank, frame):
    tracker = Tracker(bank, quiet=True)

    def track(number):
        try:
            return tracker(frame.depth, frame.camera, time=0.04 * number)
        except InputError as error:
            return str(error)

    with ThreadPoolExecutor(3) as pool:
        answers = list(pool.map(track, range(20)))
    refused = [answer for answer in answers if isinstance(answer, str)]
    assert refused and all(answer.endswith("make a Tracker for each") for answer in refused)
    tracker.reset()
    assert len(tracker(frame.depth, frame.camera, time=0.0)) == 1


def test_a_tracker_is_not_pickled(tracker):
    for copy_it in (pickle.dumps, copy.deepcopy):
        with pytest.raises(
            TypeError, match="a Tracker cannot be pickled or copied: make one in each process"
        ):
            copy_it(tracker)


@pytest.mark.parametrize("time", [1.5, 1_500_000_000, np.float32(1.5), np.int64(1_500_000_000)])
def test_times_are_seconds_or_nanoseconds(fresh, frame, time):
    (found,) = fresh(frame.depth, frame.camera, time=time)
    assert (found.stamp_ns, found.time) == (1_500_000_000, 1.5)


def test_people_keep_their_ids_until_time_jumps(fresh, frame):
    ids = [fresh(frame.depth, frame.camera, time=t)[0].id for t in (5.0, 5.04, 4.0, 4.04, 9.0)]
    assert ids[0] == ids[1] != ids[2] == ids[3] != ids[4]


def test_frames_without_a_time_stand_alone_and_do_not_count_ids_up(fresh, frame):
    for _ in range(3):
        people = fresh(frame.depth, frame.camera)
        assert [person.id for person in people] == ["body_1"]
        assert people[0].tracking is Tracking.NEW and np.isnan(people[0].velocity).all()


def test_images_that_are_upside_down_give_one_warning(fresh):
    camera = Camera(160, 120, 110.0, 110.0, 79.5, 59.5)
    below = (np.arange(120) - camera.cy)[:, None] / camera.fy
    room = np.minimum(np.where(below > 0, 1.2 / np.maximum(below, 1e-6), np.inf), 4.0)
    room = np.broadcast_to(room, (120, 160)).astype(np.float32)  # a floor 1.2 m below, a wall 4 m away
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for k in range(8):
            assert fresh(room, camera, time=k / 30) == ()
    fresh.reset()
    with pytest.warns(RuntimeWarning, match=r"upside down.*mount\.roll: 180") as said:
        for k in range(16):
            fresh(room[::-1].copy(), camera, time=k / 30)
    assert len(said) == 1


def test_a_depth_frame_has_metres_of_its_camera_s_size(fresh, frame):
    with pytest.raises(InputError, match="float32 metres"):
        replace(frame, depth=(1000 * frame.depth).astype(np.uint16))
    with pytest.raises(InputError, match="rows, columns"):
        DepthFrame(0, "", GOOD[:100], CAMERA)
    with pytest.raises(InputError, match="its own camera"):
        fresh(frame, frame.camera)


def test_cameras_are_made_of_matrices():
    assert Camera.from_matrix(CAMERA.matrix(), width=176, height=144) == CAMERA
    for K in (np.eye(4), CAMERA.matrix() * 2, np.full((3, 3), np.nan), CAMERA.matrix().T):
        with pytest.raises(InputError, match="K"):
            Camera.from_matrix(K, width=176, height=144)


def test_settings_are_checked(bank):
    with pytest.raises(ConfigError, match="segment"):
        Tracker(bank, {"segment": {"nearest": 1.0}}, quiet=True)
    tracker = Tracker(bank, {"segment": {"far": 2.0}}, quiet=True)
    assert tracker(sample_frame()) == ()


def test_settings_come_from_a_file(bank, tmp_path):
    (tmp_path / "my.yaml").write_text("segment: {far: 2.0}\n")
    assert Tracker(bank, str(tmp_path / "my.yaml"), quiet=True)(sample_frame()) == ()
    (tmp_path / "my.yaml").write_text("segment: {farther: 2.0}\n")
    with pytest.raises(ConfigError, match="farther"):
        Tracker(bank, tmp_path / "my.yaml", quiet=True)
    with pytest.raises(InputError, match=r"no\.yaml cannot be read"):
        Tracker(bank, tmp_path / "no.yaml", quiet=True)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (np.zeros_like, "less than 1 % of the pixels have depth"),
        (lambda depth: (100 * depth).astype(np.uint16), "may be centimetres"),
        (np.negative, "most depths are below 0.*negate them"),
        (lambda depth: np.divide(1.0, depth, where=depth > 0, out=np.zeros_like(depth)), "inverse depth"),
    ],
    ids=["nothing", "centimetres", "negative", "inverse"],
)
def test_why_nobody_is_found_is_said_once(unwarned, change, says):
    tracker, with_time = unwarned
    tracker.reset()
    camera = Camera(160, 120, 110.0, 110.0, 79.5, 59.5)
    below = (np.arange(120) - camera.cy)[:, None] / camera.fy
    room = np.minimum(np.where(below > 0, 1.2 / np.maximum(below, 1e-6), np.inf), 4.0)
    depth = change(np.broadcast_to(room, (120, 160)).astype(np.float32))
    with pytest.warns(RuntimeWarning, match=says) as said:
        for k in range(20):
            people = tracker(depth, camera, time=k / 30 if with_time else None)
            assert people == ()
    assert sum(bool(re.search(says, str(line.message))) for line in said) == 1
    assert re.search(says, "\n".join(people.warnings))


# --- what comes out


@pytest.fixture(scope="module")
def people(bank, frame):
    """The second frame, in which everybody has a velocity."""
    tracker = Tracker(bank, quiet=True)
    tracker(frame.depth, frame.camera, time=0.0)
    return tracker(frame.depth, frame.camera, time=0.04)


def test_people_are_a_tuple_with_the_frame_s_results(people, frame):
    (person,) = people
    assert isinstance(people, tuple) and people == (person,) and people[0] is person
    assert person in people and "body_1" in people and "body_7" not in people
    assert people["body_1"] is person
    with pytest.raises(KeyError, match="no 'body_7' in this frame; there are body_1"):
        people["body_7"]
    assert (people.time, people.frame_id, people.warnings) == (0.04, "camera", ())
    assert people.camera == frame.camera
    assert repr(people) == f"<People at 0.040 s: body_1 ({person.confidence:.2f}); floor 1.15 m below>"
    again = pickle.loads(pickle.dumps(people))
    assert again == people and again.floor.height == people.floor.height
    np.testing.assert_array_equal(again.labels, people.labels)


def test_the_floor_is_the_frame_s(people):
    np.testing.assert_allclose(people.floor.plane, [0, -1, 0, 1.15], atol=0.02)


def test_labels_are_on_the_image_s_own_grid(people, frame):
    assert people.labels.shape == frame.depth.shape
    mask = people.mask("body_1")
    np.testing.assert_array_equal(mask, people.labels == 1)
    np.testing.assert_array_equal(mask, people.mask(people[0]))
    is_person = (frame.depth > 2.8) & (frame.depth < 3.6) & (np.arange(frame.camera.height) < 125)[:, None]
    assert (mask & is_person).sum() > 0.9 * is_person.sum()
    assert (mask & ~is_person).sum() < 0.1 * is_person.sum()
    skipped = depth_pose.People()
    with pytest.raises(ValueError, match="no labels"):
        _ = skipped.labels


def test_a_distorted_image_gives_the_same_people_and_labels_of_its_own(fresh, frame, person):
    lens = Camera.from_opencv(frame.camera.matrix(), [-0.25, 0.06, 0.0, 0.0, 0.0], (176, 144))
    v, u = np.mgrid[:144, :176]
    rays = np.stack([(u - 87.5) / frame.camera.fx, (v - 71.5) / frame.camera.fy, np.ones(u.shape)], axis=-1)
    column, row = np.moveaxis(np.rint(lens.project(rays)).astype(int), -1, 0)
    seen = (column >= 0) & (column < 176) & (row >= 0) & (row < 144)
    distorted = np.zeros_like(frame.depth)
    distorted[row[seen], column[seen]] = frame.depth[seen]
    (found,) = people = fresh(distorted, lens)
    assert np.linalg.norm(found.positions - person.positions, axis=1).mean() < 0.02
    assert people.labels.shape == distorted.shape
    pixels = np.rint(found.pixels(lens)).astype(int)[found.joint_states == JointState.SEEN]
    assert people.mask("body_1")[pixels[:, 1], pixels[:, 0]].mean() > 0.9


def test_a_skeleton_is_a_collection_of_joints(people):
    person = people[0]
    assert "left_wrist" in person and "left_hand" not in person and 7 not in person
    assert [joint.name for joint in person] == list(depth_pose.JOINTS) == list(get_args(depth_pose.JointName))
    assert len(person) == 19 and bool(person)
    lost = Skeleton.lost(0, "camera")
    assert len(lost) == 0 and not lost and "head" not in lost and list(lost) == []
    assert person == replace(person, positions=person.positions.copy()) and hash(person) == hash(
        person.at(40_000_000)
    )
    assert person != replace(person, positions=person.positions + 1e-9) and person != 3
    assert re.fullmatch(
        r"<Skeleton body_1 at 0\.040 s: REFINED, confidence [01]\.\d\d, centre \(.*\) m, 1\d of 19 .*>",
        repr(person),
    )


def test_a_person_has_motion_and_place_in_space_and_image(people, frame):
    person = people[0]
    assert person.tracking is Tracking.TRACKED
    assert np.abs(person.velocities).max() < 0.1  # the same image twice
    np.testing.assert_array_equal(person["head"].velocity, person.velocities[4])
    assert (np.linalg.eigvalsh(person.covariances) > 0.0).all()
    np.testing.assert_array_equal(person["head"].covariance, person.covariances[4])
    assert abs(person.centre[2] - 3.2) < 0.1
    np.testing.assert_array_equal(person.pixels(frame.camera), frame.camera.project(person.positions))
    rows, columns = np.nonzero(people.mask(person))
    left, top, right, bottom = person.box_in(frame.camera)
    np.testing.assert_allclose(
        [left, top, right, bottom], [columns.min(), rows.min(), columns.max(), rows.max()], atol=5
    )
    points = frame.camera.back_project(frame.depth)[people.mask(person) & (frame.depth < 3.6)]
    points = points[points[:, 1] < 1.0]  # the floor is 15 cm below the feet
    low, high = person.box
    np.testing.assert_allclose(low[:2], points.min(axis=0)[:2], atol=0.08)
    np.testing.assert_allclose(high[:2], points.max(axis=0)[:2], atol=0.08)
    assert np.isnan(person.at(0).turned(np.eye(3), np.array([9.0, 0, 0]), "").box_in(frame.camera)).all()


def test_a_turned_skeleton_turns_all_of_it(people):
    person = people[0]
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    turned = person.turned(turn, np.array([1.0, 2, 3]), "room")
    np.testing.assert_allclose(turned.centre, turn @ person.centre + [1, 2, 3])
    np.testing.assert_allclose(turned.velocity, turn @ person.velocity)
    np.testing.assert_allclose(turned.covariances[3], turn @ person.covariances[3] @ turn.T)
    assert turned.frame_id == "room"


def test_people_are_drawn(people, frame):
    picture = depth_pose.draw(frame.depth, people)
    assert picture.shape == (144, 176, 3) and picture.dtype == np.uint8
    orange = (np.abs(picture.astype(int) - [240, 138, 36]).sum(axis=2) < 90).sum()
    assert orange > 30  # the left arm and leg
    in_millimetres = depth_pose.draw((1000 * frame.depth).round().astype(np.uint16), people)
    assert np.abs(in_millimetres.astype(int) - picture).max() <= 2
    with pytest.raises(InputError, match="needs the camera"):
        depth_pose.draw(frame.depth, tuple(people))
    with pytest.raises(InputError, match="shape"):
        depth_pose.draw(frame.depth[:100], people)
    nobody = depth_pose.draw(frame.depth, (), frame.camera)
    assert (np.abs(nobody.astype(int) - [240, 138, 36]).sum(axis=2) < 90).sum() == 0


def test_people_have_a_picture_in_notebooks_and_plots(people, monkeypatch):
    for shown in (people, people[0]):
        page = shown._repr_html_()
        drawn = ElementTree.fromstring(page)
        assert len(drawn.findall(".//{*}line")) == 18
        assert repr(shown) in "".join(drawn.itertext())
    monkeypatch.setenv("MPLBACKEND", "Agg")
    axes = people.plot()
    assert len(axes.lines) == 18
    assert people[0].plot(axes) is axes and len(axes.lines) == 36


def test_joints_of_everybody_are_one_table(people):
    from depth_pose.core.tables import COLUMNS

    table = people.to_pandas()
    assert list(table.columns) == list(COLUMNS[1:])
    assert table.equals(people[0].to_pandas()) and len(table) == 19
    assert len(depth_pose.People().to_pandas()) == 0
    made = json.loads(json.dumps(people.to_dict()))
    assert made["people"][0] == people[0].to_dict()
    assert made["floor"]["height"] == people.floor.height


def test_joints_are_found_by_name(person):
    for i, name in enumerate(depth_pose.JOINTS):
        joint = person[name]
        assert joint.name == name
        np.testing.assert_array_equal(joint.position, person.positions[i])
        assert 0.0 <= joint.confidence <= 1.0
        assert isinstance(joint.state, JointState)
    assert [joint.name for joint in person.joints] == list(depth_pose.JOINTS)
    assert person["left_wrist"].position[0] > person["right_wrist"].position[0]  # they face the camera
    with pytest.raises(KeyError, match="no joint 'left_hand'; the joints are pelvis"):
        person["left_hand"]
    with pytest.raises(KeyError, match="LOST"):
        Skeleton.lost(0, "")["head"]


def test_skeletons_become_dictionaries_records_and_tables(person):
    made = json.loads(json.dumps(person.to_dict()))
    assert made["body_id"] == person.id
    assert made["velocity"] is None and made["tracking"] == "NEW"
    assert made["joints"]["head"]["position"] == person["head"].position.tolist()
    assert made["joints"]["head"]["state"] == person["head"].state.name
    rows = np.array([person.to_record(), Skeleton.lost(7, "camera").to_record()])
    np.testing.assert_array_equal(rows["positions"][0], person.positions)
    assert rows["source"].tolist() == ["REFINED", "LOST"]
    assert np.isnan(rows["positions"][1]).all()
    table = person.to_pandas().set_index("joint")
    np.testing.assert_array_equal(table.loc["head", ["x", "y", "z"]].astype(float), person["head"].position)
    assert len(Skeleton.lost(0, "").to_pandas()) == 0


def test_pandas_is_asked_for_by_name(person, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ConfigError, match=r"pip install 'depth_pose\[pandas\]'"):
        person.to_pandas()


# --- the bank


def test_the_bank_comes_with_the_package(monkeypatch, tmp_path, frame):
    """Nothing is built, nothing is written to the user's cache."""
    monkeypatch.delenv("DEPTH_POSE_BANK", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (person,) = Tracker(quiet=True)(frame.depth, frame.camera)
    assert abs(person["pelvis"].position[2] - 3.2) < 0.1
    assert not (tmp_path / "depth_pose").exists()


def test_a_bank_that_is_named_and_missing_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setenv("DEPTH_POSE_BANK", str(tmp_path / "mine.npz"))
    with pytest.raises(BankError, match=r"mine.npz: no such bank"):
        Tracker(quiet=True)


def test_errors_have_one_base():
    assert all(issubclass(error, DepthPoseError) for error in (BankError, ConfigError, InputError))
