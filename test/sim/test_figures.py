"""Simulated people: the same each time, of human size, resting on what they should, in all postures."""

import numpy as np
import pytest

from depth_pose.body.limits import violation
from depth_pose.core.errors import ConfigError
from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.motion.procedural.postures.sampler import KINDS, sample_postures
from depth_pose.sim.people import POSTURES, sample_figure

PER_POSTURE = 25


@pytest.fixture(scope="module")
def crowd():
    rng = np.random.default_rng(7)
    return [sample_figure(rng, name) for name in POSTURES for _ in range(PER_POSTURE)]


def areas(vertices, faces):
    a, b, c = (vertices[faces[:, i]].astype(np.float64) for i in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def test_the_same_generator_gives_the_same_person():
    first = [sample_figure(np.random.default_rng(3)) for _ in range(2)]
    sample_figure(np.random.default_rng(99))
    first.append(sample_figure(np.random.default_rng(3)))
    for other in first[1:]:
        for name in ("vertices", "faces", "joints", "held_vertices", "held_faces"):
            assert np.array_equal(getattr(first[0], name), getattr(other, name)), name
        assert (first[0].posture, first[0].seat_height) == (other.posture, other.seat_height)
    assert not np.array_equal(sample_figure(np.random.default_rng(4)).joints, first[0].joints)


def test_meshes_are_whole(crowd):
    for figure in crowd:
        for vertices, faces in (
            (figure.vertices, figure.faces),
            (figure.held_vertices, figure.held_faces),
        ):
            assert vertices.dtype == np.float32 and faces.dtype == np.int32
            assert vertices.shape[1:] == (3,) and faces.shape[1:] == (3,)
            assert np.isfinite(vertices).all()
            if len(faces):
                assert faces.min() >= 0 and faces.max() < len(vertices)
                assert areas(vertices, faces).min() > 1e-10
        assert figure.joints.shape == (19, 3) and figure.joints.dtype == np.float32
        assert np.isfinite(figure.joints).all()


def test_people_have_human_sizes(crowd):
    statures = np.array([figure.stature for figure in crowd])
    assert 1.0 <= statures.min() < 1.3 and 1.85 < statures.max() <= 2.0
    for figure in crowd:
        low, high = figure.vertices.min(axis=0), figure.vertices.max(axis=0)
        assert (high - low).max() < 1.6 * figure.stature + 0.4
        assert (high - low).max() > 0.4 * figure.stature
        assert 1500 < len(figure.faces) < 8000
        assert np.abs(figure.joints[JOINT_INDEX["pelvis"], [0, 2]]).max() < 1e-6


def test_what_is_held_is_near_a_hand(crowd):
    held = [figure for figure in crowd if len(figure.held_faces)]
    assert len(held) > 10 and len(held) < len(crowd) / 2
    wrists = [JOINT_INDEX["left_wrist"], JOINT_INDEX["right_wrist"]]
    for figure in held:
        away = np.linalg.norm(figure.held_vertices[None] - figure.joints[wrists][:, None], axis=-1)
        assert away.min() < 0.35


def test_joints_lie_inside(crowd):
    for figure in crowd:
        low, high = figure.vertices.min(axis=0), figure.vertices.max(axis=0)
        assert (figure.joints > low).all() and (figure.joints < high).all()
        away = np.linalg.norm(figure.vertices[None] - figure.joints[:, None], axis=-1).min(axis=1)
        assert away.max() < 0.25


def test_everyone_rests_on_something(crowd):
    for figure in crowd:
        lowest = figure.vertices[:, 1].min()
        if figure.posture == "lie":
            assert -0.035 < lowest - figure.seat_height < 0.005
            assert figure.joints[:, 1].max() - figure.joints[:, 1].min() < 0.75 * figure.stature
        elif figure.posture == "sit":
            assert -0.035 < lowest < 0.25
            assert 0.03 < figure.joints[JOINT_INDEX["pelvis"], 1] - figure.seat_height < 0.3
        else:
            assert figure.seat_height == 0 and abs(lowest) < 0.01


def test_those_on_all_fours_touch_the_floor_with_hands_and_knees(crowd):
    for figure in (f for f in crowd if f.posture == "crawl"):
        at = {name: figure.joints[JOINT_INDEX[name], 1] for name in JOINT_INDEX}
        assert min(at["left_knee"], at["right_knee"]) < 0.15
        assert min(at["left_wrist"], at["right_wrist"]) < 0.22
        assert at["pelvis"] > 0.2 * figure.stature


def test_everyone_faces_forward():
    rng = np.random.default_rng(11)
    for name in ("stand", "sit", "walk", "lean"):
        across = np.array(
            [
                f.joints[JOINT_INDEX["left_hip"]] - f.joints[JOINT_INDEX["right_hip"]]
                for f in (sample_figure(rng, name) for _ in range(30))
            ]
        )
        assert (across[:, 0] > 0).all()
        assert np.abs(across[:, 2] / across[:, 0]).max() < 0.7


def test_postures_come_by_their_shares():
    rng = np.random.default_rng(5)
    names = [sample_figure(rng).posture for _ in range(400)]
    share = sum(POSTURES.values())
    for name, probability in POSTURES.items():
        expected = 400 * probability / share
        assert abs(names.count(name) - expected) < 4.5 * np.sqrt(expected) + 1


def test_all_kinds_of_postures_stay_within_the_joint_limits():
    for name, kinds in KINDS.items():
        drawn = sample_postures(name, np.random.default_rng(1), 200)
        assert violation(drawn.angles).max() < 1e-6
        assert drawn.rotations.shape == (200, 21, 3, 3)
        identity = drawn.rotations @ np.swapaxes(drawn.rotations, -1, -2)
        assert np.allclose(identity, np.eye(3), atol=1e-9)
        assert len({id(kind) for kind in drawn.kinds}) == len(kinds)


def test_unknown_postures_are_refused():
    with pytest.raises(ConfigError, match="stand"):
        sample_figure(np.random.default_rng(0), "float")
    with pytest.raises(ConfigError, match="stand"):
        sample_postures("float", np.random.default_rng(0))


def wrist_places(loose):
    """Where left wrists are from the chest, in units of the stature, for 250 who stand."""
    rng = np.random.default_rng(11)
    crowd = [sample_figure(rng, "stand", loose=loose) for _ in range(250)]
    wrist, chest = JOINT_INDEX["left_wrist"], JOINT_INDEX["chest"]
    return np.array([(f.joints[wrist] - f.joints[chest]) / f.stature for f in crowd])


def test_loose_postures_reach_farther_about():
    plain, loose = wrist_places(False), wrist_places(True)
    assert (loose.std(axis=0) > plain.std(axis=0)).all()
    behind, above = (loose[:, 2] < -0.1).mean(), (loose[:, 1] > 0.1).mean()
    assert behind > 0.02
    assert above > 0.1
    assert np.linalg.norm(loose, axis=1).max() < 0.5  # arms are no longer than that


def test_loose_people_share_their_build_with_nobody():
    rng, count = np.random.default_rng(12), 150
    apart = [
        len({sample_figure(rng, "stand", loose).stature for _ in range(count)}) for loose in (True, False)
    ]
    assert apart[0] == count > apart[1]


@pytest.mark.slow
def test_anny_s_bodies_are_dressed_and_stand_on_the_floor():
    pytest.importorskip("anny", reason="the extra 'anny' is not installed")
    for posture in ("stand", "sit", "lie"):
        figure = sample_figure(np.random.default_rng(2), posture, anny=1.0)
        assert -0.04 < figure.vertices[:, 1].min() < 0.3
        inside = np.linalg.norm(figure.vertices[:, None] - figure.joints, axis=-1).min(axis=0)
        assert inside.max() < 0.25
