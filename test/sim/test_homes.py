"""Homes: what materials return, pets that are no people, cameras that move."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from depth_pose.core.camera import Camera
from depth_pose.evaluate.truth import load_known_people
from depth_pose.sim.clips import sample_clip, write_clip
from depth_pose.sim.furniture.home import (
    make_clothes_horse,
    make_counter,
    make_dining_table,
    make_hat_stand,
    make_low_table,
    make_pram,
    make_television,
    make_tower,
    make_trolley,
)
from depth_pose.sim.home_scenes import HOME_MOUNTINGS, sample_home
from depth_pose.sim.home_sensors import HOME_FAMILIES, sample_home_sensor, sample_named_sensor
from depth_pose.sim.homes import HIDING, HOME_AT_WALLS, HOME_STANDING
from depth_pose.sim.materials import REFLECTANCE, WORN, sample_reflectance, sample_wardrobe
from depth_pose.sim.people import HOLDS_M, sample_figure
from depth_pose.sim.pets import GAITS, sample_pet
from depth_pose.sim.placed import place
from depth_pose.sim.rooms import make_room
from depth_pose.sim.scene_noise import Shown, measure
from depth_pose.sim.scene_view import View, look
from depth_pose.sim.scenes import Scene, render
from depth_pose.sim.sensor import SENSORS
from depth_pose.sim.shapes import Assembly, Kind, joined, triangulate
from depth_pose.sim.stereo import StereoConfig, measure_stereo
from depth_pose.sim.walks import free_points, sample_pet_walk, sample_views

CAMERA = Camera(160, 120, 140.0, 140.0, 79.5, 59.5)


@pytest.fixture(scope="module")
def homes() -> list[Scene]:
    return [sample_home(np.random.default_rng([3, i]), width=160) for i in range(16)]


def _returned(material: str, distance: float, family: str) -> float:
    """Share of a wall of a material that returns depth, over some sensors of a family."""
    rng, shares = np.random.default_rng(1), []
    for _ in range(12):
        sensor = replace(sample_home_sensor(rng, family), near=0.1, far=10.0, vignette=2.0, dazzle=np.inf)
        full = np.ones((60, 80), np.float32)
        albedo = np.float32(sample_reflectance(rng, material))
        shares.append((measure(Shown(distance * full, full, albedo * full, 150.0), sensor, rng) > 0).mean())
    return float(np.mean(shares))


@pytest.mark.parametrize("family", ["structured", "tof"])
def test_dark_materials_return_less_and_less_with_distance(family: str) -> None:
    assert _returned("cloth", 2.0, family) > 0.95
    assert _returned("leather", 2.0, family) < 0.3
    assert _returned("screen", 1.0, family) < _returned("leather", 1.0, family) + 0.05
    shares = [_returned("denim", z, family) for z in (1.0, 2.0, 4.0)]
    assert shares[0] > shares[1] > shares[2]
    assert shares[0] > 0.5 > shares[2]


def test_partial_returns_come_in_blotches() -> None:
    """Neighbours of a hole are mostly holes, too, where half of a surface is lost."""
    rng = np.random.default_rng(4)
    sensor = replace(sample_home_sensor(rng, "structured"), near=0.1, far=9.0, blotches=1.0, raggedness=0.0)
    full = np.ones((120, 160), np.float32)
    albedo = sensor.least_light * 4.0 * full  # half of the pixels return at 2 m
    lost = measure(Shown(2 * full, full, albedo, 150.0), replace(sensor, ghosts=0.0), rng) == 0
    assert 0.25 < lost.mean() < 0.75
    assert (lost[:, 1:] & lost[:, :-1]).sum() / lost[:, :-1].sum() > 0.75


def test_a_wardrobe_has_a_material_for_each_part() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        worn = sample_wardrobe(rng)
        for part, name, albedo in zip(WORN, worn.names, worn.albedos, strict=True):
            low, high = REFLECTANCE[name]
            assert name in WORN[part] and low <= albedo <= high


def test_the_person_image_is_true_where_nothing_returned() -> None:
    """A person all in leather: the labels show the whole person, nearly none of it has depth."""
    rng = np.random.default_rng(2)
    worn = replace(sample_wardrobe(rng), albedos=(0.0005,) * 4)
    figure = sample_figure(rng, "stand")
    room = Assembly(Kind.WALL, 0.7)
    room.box((0, 1.5, 4.0), (8.0, 3.0, 0.1))
    sensor = replace(sample_home_sensor(rng, "structured"), near=0.2, far=9.0, ghosts=0.0)
    view, surfaces = look(CAMERA, 1.0, 0.0, 0.0), triangulate(room, rng)
    dark, light = (
        render(view, surfaces, [place(figure, 0.0, 2.5, np.pi, rng, w)], sensor, np.random.default_rng(3))
        for w in (worn, replace(worn, albedos=(0.7,) * 4))
    )
    np.testing.assert_array_equal(dark.person, light.person)
    assert dark.visible[0] == light.visible[0] > 0.9
    assert dark.returned[0] < 0.2 < 0.7 < light.returned[0]  # edges are ragged
    own = dark.person == 1
    assert dark.returned[0] == pytest.approx((dark.depth[own] > 0).mean(), abs=1e-6)


def test_homes_are_of_every_family_and_record_what_is_worn(homes: list[Scene]) -> None:
    assert {s.sensor for s in homes} <= set(HOME_FAMILIES)
    assert len({s.sensor for s in homes}) >= 3
    assert sum(bool((s.person > 0).any()) for s in homes) >= 8
    for s in homes:
        assert len(s.fabrics) == len(s.joints) and all(len(f) == len(WORN) for f in s.fabrics)
        assert np.all((s.returned >= 0) & (s.returned <= 1))
        np.testing.assert_array_equal(s.person > 0, s.kind == Kind.PERSON)


@pytest.mark.parametrize("mounting", list(HOME_MOUNTINGS))
def test_cameras_at_home_are_mounted_as_asked(mounting: str) -> None:
    heights = {"robot": (0.3, 1.2), "shelf": (1.5, 2.4), "low": (0.3, 0.6), "ceiling": (2.1, 4.0)}
    low, high = heights.get(mounting, (0.4, 3.0))
    for i in range(3):
        scene = sample_home(np.random.default_rng([5, i]), width=64, people=0, mounting=mounting)
        assert low <= scene.height <= high and not scene.person.any()


def test_the_same_state_gives_the_same_home() -> None:
    one, other = (sample_home(np.random.default_rng(8), width=96, people=2) for _ in range(2))
    for name in ("depth", "person", "joints", "returned"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert one.fabrics == other.fabrics


@pytest.mark.parametrize(
    "make",
    [make_pram, make_trolley, make_tower, make_hat_stand, make_counter, make_television, make_dining_table,
     make_low_table, make_clothes_horse, *(m for m, _ in (*HOME_STANDING, *HOME_AT_WALLS, *HIDING))],
)  # fmt: skip
def test_things_of_homes_stand_on_the_floor_and_are_no_people(make) -> None:
    for i in range(4):
        rng = np.random.default_rng(i)
        surfaces = triangulate(make(rng), rng)
        assert np.isfinite(surfaces.vertices).all() and surfaces.vertices[:, 1].min() > -0.25
        assert not np.isin(surfaces.kind, (Kind.PERSON, Kind.HELD)).any()


def test_a_repainted_thing_keeps_the_colours_of_its_parts() -> None:
    thing = Assembly(Kind.SOFA, 0.5)
    thing.box((0, 0, 0), (1, 1, 1))
    thing.lump((0, 1, 0), (1, 1, 1), albedo=0.9)
    thing.repaint(0.002)
    thing.bar((0, 0, 0), (0, 1, 0), 0.1)
    assert sorted(set(triangulate(thing, np.random.default_rng(0)).albedo)) == pytest.approx([0.002, 0.9])


@pytest.mark.parametrize("gait", list(GAITS))
def test_paws_of_a_walking_pet_stand_still_on_the_floor(gait: str) -> None:
    """While it is down, a paw moves back by as much as the body moves ahead."""
    pet = replace(sample_pet(np.random.default_rng(1)), gait=gait)
    dt = 1e-3
    for phase in np.linspace(0, 1, 21):
        now, soon = (triangulate(pet.shapes(p), np.random.default_rng(0)) for p in (phase, phase + dt))
        low = now.vertices[:, 1] < 0.3 * pet.leg
        assert low.any()
        back = soon.vertices[low, 2] - now.vertices[low, 2]
        down = np.abs(soon.vertices[low, 1] - now.vertices[low, 1]) < 1e-9
        assert down.any() and back[down].min() == pytest.approx(-pet.stride * dt / 0.6, rel=0.05)
    assert (triangulate(pet.shapes(), np.random.default_rng(0)).kind == Kind.PET).all()


@pytest.fixture(scope="module")
def stage() -> tuple[View, object]:
    rng = np.random.default_rng(6)
    return look(CAMERA, 0.8, 0.1, 0.0), make_room(rng, 0.8, False)


def test_a_pet_walks_where_it_looks_and_stays_in_the_room(stage) -> None:
    view, room = stage
    walk = sample_pet_walk(np.random.default_rng(2), view, room, 120, 15.0)
    steps = np.diff(walk.spots, axis=0)
    far = np.hypot(*steps.T)
    moving = far > 1e-6
    assert moving.any()
    ahead = np.stack([np.sin(walk.heading[1:]), np.cos(walk.heading[1:])], axis=1)
    np.testing.assert_allclose((steps * ahead).sum(axis=1)[moving], far[moving], rtol=1e-6)
    assert far.max() < 0.12
    assert all(room.walls.inward(*spot) > 0.0 for spot in walk.spots)
    assert (walk.surfaces(5).kind == Kind.PET).all()


def test_a_moving_camera_is_rigid_and_keeps_its_way_free(stage) -> None:
    view, room = stage
    views = sample_views(np.random.default_rng(3), view, room, 60, 15.0)
    turned = np.array([v.rotation for v in views])
    np.testing.assert_allclose(
        turned @ turned.transpose(0, 2, 1), np.broadcast_to(np.eye(3), (60, 3, 3)), atol=1e-9
    )
    positions = np.array([v.position for v in views])
    assert np.abs(np.diff(positions, axis=0)).max() < 0.1 < np.ptp(turned[:, 0, 0]) + np.ptp(positions[:, 2])
    room.free = [free_points(views)]
    box = Assembly(Kind.BOX)
    box.box((0, 0.3, 0), (0.3, 0.6, 0.3))
    assert not room.put(box, *views[-1].position[[0, 2]], 0.0, crowded=0.0)
    room.free = []


@pytest.fixture(scope="module")
def driven():
    return sample_clip(np.random.default_rng(1), 16, 15.0, 2, 96, model="d435", home=True, moves=True)


def test_the_truth_of_a_moving_camera_is_in_its_frame_at_that_moment(driven) -> None:
    """Taken back to the room, people on their feet are on the floor and move no faster than people do."""
    assert driven.moves and driven.T_camera_floor.shape == (16, 4, 4)
    inverse = np.linalg.inv(driven.T_camera_floor)
    world = np.einsum("tij,tpkj->tpki", inverse[:, :3, :3], driven.joints) + inverse[:, None, None, :3, 3]
    assert np.all(world[..., 2].min(axis=2) > -0.05) and np.all(world[..., 2].min(axis=2) < 0.35)
    assert np.linalg.norm(np.diff(world[:, :, 0], axis=0), axis=-1).max() < 3.0 / 15.0
    assert np.ptp(driven.T_camera_floor[:, :3], axis=0).max() > 0.02
    assert len(driven.materials) == driven.joints.shape[1]


def test_the_truth_of_a_moving_camera_is_scored_as_a_camera_s(driven, tmp_path: Path) -> None:
    write_clip(tmp_path / "home.mcap", driven)
    known = load_known_people(tmp_path / "home.npz")
    assert not known.is_room
    np.testing.assert_array_equal(known.joints, driven.joints)
    with np.load(tmp_path / "home.npz") as truth:
        np.testing.assert_array_equal(truth["T_camera_floor"], driven.T_camera_floor)
        assert truth["materials"].shape == (driven.joints.shape[1], len(WORN))


def test_the_same_home_is_seen_by_a_standing_camera(driven) -> None:
    still = sample_clip(np.random.default_rng(1), 16, 15.0, 2, 96, model="d435", home=True)
    assert not still.moves and still.materials == driven.materials
    np.testing.assert_array_equal(still.joints[0], driven.joints[0])
    T = still.T_camera_floor[0] @ np.linalg.inv(driven.T_camera_floor[9])
    np.testing.assert_allclose(driven.joints[9] @ T[:3, :3].T + T[:3, 3], still.joints[9], atol=1e-5)


def test_named_sensors_have_their_image_and_their_range(driven) -> None:
    model = SENSORS["d435"].with_width(96)
    assert driven.camera == model.camera
    measured = driven.depth[driven.depth > 0]
    assert model.near <= measured.min() and measured.max() <= model.far
    assert sample_named_sensor(np.random.default_rng(0), "zed").family == "passive"
    assert sample_named_sensor(np.random.default_rng(0), "azure_kinect").family == "tof"


def test_surfaces_are_joined_in_order() -> None:
    one, two = Assembly(Kind.PET, 0.2), Assembly(Kind.BOX, 0.4)
    for thing in (one, two):
        thing.box((0, 0, 0), (1, 1, 1))
    rng = np.random.default_rng(0)
    both = joined([triangulate(one, rng), triangulate(two, rng)])
    assert both.faces.max() == len(both.vertices) - 1
    assert list(both.kind) == [Kind.PET] * 12 + [Kind.BOX] * 12


@pytest.mark.parametrize("doing", list(HOLDS_M))
def test_who_holds_something_up_is_partly_hidden_by_it(doing: str) -> None:
    hidden = 0
    for i in range(4):
        figure = sample_figure(np.random.default_rng(i), "stand", doing=doing)
        assert len(figure.held_faces) and figure.doing == doing
        middle = figure.held_vertices.mean(axis=0)
        hidden += middle[2] > figure.joints[2, 2] and middle[1] > 0.3 * figure.stature
    assert hidden >= 3


def test_passive_stereo_errs_in_front_of_and_behind_the_truth() -> None:
    """About a third of the errors above a pixel lie behind, as those of a matcher do."""
    rng = np.random.default_rng(5)
    depth = np.full((240, 320), 3.5, np.float32)
    for k in range(6):
        depth[30 * k : 30 * k + 20, 40 * k : 40 * k + 60] = 1.8
    config = StereoConfig(baseline=0.075, rim=3.0, mismatch=0.6, jump=4.0, edge_loss=0.0, lost=0.0)
    light = np.full(depth.shape, 0.4, np.float32)
    off = []
    for _ in range(4):
        measured = measure_stereo(depth, light, 230.0, config, rng)
        known = measured > 0
        off.append(230.0 * 0.075 * (1 / measured[known] - 1 / depth[known]))
    wrong = np.concatenate(off)
    wrong = wrong[np.abs(wrong) > 1.0]
    assert 0.03 < len(wrong) / (4 * depth.size) < 0.25
    assert 0.2 < (wrong < 0).mean() < 0.5


def test_a_margin_loses_the_columns_that_one_camera_shows() -> None:
    depth = np.full((40, 160), 2.0, np.float32)
    light = np.ones(depth.shape, np.float32)
    config = StereoConfig(baseline=0.1, margin=1, lost=0.0)
    measured = measure_stereo(depth, light, 200.0, config, np.random.default_rng(0))
    assert not measured[:, :10].any() and (measured[:, 11:] > 0).all()
