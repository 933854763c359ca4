from dataclasses import replace

import numpy as np
import pytest

from depth_pose.core.camera import Camera
from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.sim._scene_kernels import cast_shadow
from depth_pose.sim.furniture import AT_WALLS, STANDING
from depth_pose.sim.noise import NO_NOISE
from depth_pose.sim.scene_noise import SceneSensor, Shown, measure, sample_sensor
from depth_pose.sim.scene_view import draw, look, silhouette_area
from depth_pose.sim.scenes import MOST_PEOPLE, Scene, sample_scene
from depth_pose.sim.sensor import SENSORS, VirtualSensor
from depth_pose.sim.shapes import Assembly, Kind, triangulate

CAMERA = Camera(160, 120, 140.0, 141.0, 79.0, 60.0)


@pytest.fixture(scope="module")
def scenes() -> list[Scene]:
    return [sample_scene(np.random.default_rng([7, i]), people=i % 4) for i in range(12)]


@pytest.fixture(scope="module")
def loners() -> list[Scene]:
    return [sample_scene(np.random.default_rng([8, i]), people=1) for i in range(24)]


def test_the_same_state_gives_the_same_scene() -> None:
    one, other = (sample_scene(np.random.default_rng(5), people=2) for _ in range(2))
    for name in ("depth", "clean", "person", "kind", "joints", "visible", "seen", "up"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert one.camera == other.camera


def test_labels_agree_with_each_other_and_with_the_depth(scenes: list[Scene]) -> None:
    for scene in scenes:
        camera, shape = scene.camera, scene.depth.shape
        assert shape == (camera.height, camera.width) == scene.person.shape == scene.kind.shape
        assert shape[1] <= 320 and shape[0] <= 240
        np.testing.assert_array_equal(scene.person > 0, scene.kind == Kind.PERSON)
        np.testing.assert_array_equal(scene.clean > 0, scene.kind != Kind.NOTHING)
        assert scene.person.max(initial=0) <= len(scene.joints) == len(scene.visible) == len(scene.seen)
        for p, joints in enumerate(scene.joints):
            pixels = scene.person == p + 1
            assert (scene.visible[p] > 0) == pixels.any()
            if pixels.any():  # nothing of a person is farther from their joints than clothes and bags reach
                z = scene.clean[pixels]
                assert z.min() > joints[:, 2].min() - 0.6 and z.max() < joints[:, 2].max() + 0.6


def test_what_is_measured_is_near_what_is_there(scenes: list[Scene]) -> None:
    for scene in scenes:
        both = (scene.depth > 0) & (scene.clean > 0)
        off = np.abs(scene.depth[both] - scene.clean[both]) / scene.clean[both]
        assert both.sum() == 0 or np.median(off) < 0.03


def test_nobody_is_in_a_scene_without_people(scenes: list[Scene]) -> None:
    for scene in scenes[::4]:
        assert not scene.person.any() and scene.joints.shape == (0, 19, 3)
        assert not np.isin(scene.kind, (Kind.PERSON, Kind.HELD)).any()


def test_up_is_the_way_from_the_feet_to_the_head_of_who_stands(loners: list[Scene]) -> None:
    found = 0
    for scene in loners:
        assert np.linalg.norm(scene.up) == pytest.approx(1.0, abs=1e-5)
        for joints in scene.joints:
            feet = joints[[JOINT_INDEX["left_ankle"], JOINT_INDEX["right_ankle"]]].mean(axis=0)
            rise = (joints[JOINT_INDEX["head"]] - feet) @ scene.up
            found += rise > 0.85 * np.linalg.norm(joints[JOINT_INDEX["head"]] - feet)
    assert found >= len(loners) // 3


def test_joints_of_unhidden_people_fall_on_their_own_pixels(loners: list[Scene]) -> None:
    on, asked = 0, 0
    names = ("pelvis", "spine", "chest", "head", "left_hip", "right_hip")
    for scene in loners:
        for p in np.flatnonzero(scene.visible > 0.9):
            c, (x, y, z) = scene.camera, scene.joints[p, [JOINT_INDEX[n] for n in names]].T
            u, v = np.rint(c.fx * x / z + c.cx).astype(int), np.rint(c.fy * y / z + c.cy).astype(int)
            inside = (u >= 0) & (u < c.width) & (v >= 0) & (v < c.height)
            asked += inside.sum()
            on += (scene.person[v[inside], u[inside]] == p + 1).sum()
            assert scene.seen[p, [JOINT_INDEX[n] for n in names]][inside].mean() > 0.8
    assert asked > 25 and on / asked > 0.9


def test_as_many_people_as_may_be_asked_for() -> None:
    counts = [len(sample_scene(np.random.default_rng([10, i]), people=MOST_PEOPLE).joints) for i in range(4)]
    assert max(counts) == MOST_PEOPLE and min(counts) >= 1


def test_the_depth_buffer_agrees_with_cast_rays() -> None:
    rng = np.random.default_rng(0)
    thing = Assembly(Kind.BOX)
    for maker, _ in STANDING + AT_WALLS:
        thing.add(maker(rng), *rng.uniform((-1.5, -1.0, 1.0), (1.5, 0.5, 5.0)), rng.uniform(0, 6))
    thing.box((0, -1, 0), (20, 0.02, 20))  # goes on behind the camera
    made = triangulate(thing, rng)
    points = made.vertices * [1, -1, 1]
    drawn = draw(points, made.faces, CAMERA)
    model = replace(SENSORS["tof"], camera=CAMERA, near=0.05, far=100.0, noise=NO_NOISE)
    rays = VirtualSensor(model, 0).render([(points.astype(np.float32), made.faces.astype(np.uint32))])
    assert np.mean(np.isclose(drawn.depth, rays, atol=0.01)) > 0.985
    assert (drawn.face >= 0).mean() > 0.5


def test_a_silhouette_goes_on_beyond_the_image() -> None:
    thing = Assembly(Kind.BOX)
    thing.box((0.0, 0.0, 2.0), (1.0, 1.0, 0.001))
    made = triangulate(thing, np.random.default_rng(0))
    whole = CAMERA.fx * CAMERA.fy / 2.0**2
    for aside in (0.0, 1.0, 1.9):  # the last is out of the image
        area = silhouette_area(made.vertices + [aside, 0, 0], made.faces, CAMERA)
        assert area == pytest.approx(whole, rel=0.05)


def test_a_camera_that_is_tilted_down_sees_the_floor_ahead_below_the_middle() -> None:
    view = look(CAMERA, 1.5, np.deg2rad(30), 0.0)
    spot = view.to_optical(np.array([[0.0, 1.5 - 2 * np.tan(np.deg2rad(30)), 2.0], [1.0, 1.5, 2.0]]))
    np.testing.assert_allclose(view.project(spot)[0], [CAMERA.cx, CAMERA.cy], atol=1e-6)
    assert view.project(spot)[1, 0] < CAMERA.cx  # x of the room goes to the left
    np.testing.assert_allclose(view.rotation @ view.rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(view.rotation) == pytest.approx(1.0)


@pytest.mark.parametrize("to_right", [False, True])
def test_a_shadow_falls_on_the_side_away_from_the_projector(to_right: bool) -> None:
    depth = np.full((4, 100), 3.0, np.float32)
    depth[:, 40:60] = 1.0
    shadow = np.zeros(depth.shape, bool)
    cast_shadow(depth, (-1 if to_right else 1) * 20.0, 0.5, shadow)
    beside = shadow[0, 27:40] if to_right else shadow[0, 60:73]
    assert beside.mean() > 0.9 and shadow[0].sum() == pytest.approx(20.0 * (1 - 1 / 3), abs=2)


@pytest.mark.parametrize("family", ["structured", "tof", "stereo"])
def test_a_sensor_measures_a_white_wall_and_loses_a_black_one(family: str) -> None:
    shape = (120, 160)
    for i in range(5):
        rng = np.random.default_rng([11, i])
        sensor: SceneSensor = sample_sensor(rng, family)
        flat = np.full(shape, 2.0, np.float32)
        white = measure(Shown(flat, np.ones(shape, np.float32), 0 * flat + 0.8, 290.0), sensor, rng)
        black = measure(Shown(flat, np.ones(shape, np.float32), 0 * flat + 1e-6, 290.0), sensor, rng)
        if family != "stereo":
            assert (white > 0).mean() > 0.7 or sensor.vignette < 1.5
            assert (black > 0).mean() < 0.3
        assert white.max() <= sensor.far and np.median(np.abs(white[white > 0] - 2.0)) < 0.06
        np.testing.assert_allclose(white * 1000, np.rint(white * 1000), atol=1e-3)


@pytest.mark.parametrize("maker", [m for m, _ in STANDING + AT_WALLS])
def test_things_stand_on_the_floor(maker) -> None:
    for i in range(10):
        rng = np.random.default_rng(i)
        thing = triangulate(maker(rng), rng)
        assert thing.vertices[:, 1].min() > -0.1
        assert thing.vertices[:, 1].max() < 3.5
        assert len(thing.faces) == len(thing.kind) == len(thing.albedo)
        assert thing.faces.max() < len(thing.vertices)


def test_lookalikes_are_things_and_change_nothing_else():
    rooms = [
        sample_scene(np.random.default_rng([11, i]), people=0, studio=False, lookalikes=True)
        for i in range(6)
    ]
    kinds = np.concatenate([np.unique(r.kind[r.depth > 0]) for r in rooms])
    assert not any(r.person.any() for r in rooms)
    assert Kind.COATS in kinds
    again = sample_scene(np.random.default_rng([11, 0]), people=0, studio=False, lookalikes=True)
    np.testing.assert_array_equal(again.depth, rooms[0].depth)
