"""The simulated stereo camera: errors of disparity, alike among neighbours, and fat edges."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.sim.fields import smooth_field
from depth_pose.sim.sensor import SENSORS, VirtualSensor
from depth_pose.sim.stereo import StereoConfig, measure_stereo

FOCAL = 385.0
PLAIN = StereoConfig(
    fattening=0.0, thin=0.0, error=0.0, lost=0.0, edge_loss=0.0, smoothing=0.0, temporal=0.0, step=0.0
)


def plain(**changes):
    return StereoConfig(**{**PLAIN.__dict__, **changes})


def wall(depth, shape=(120, 160)):
    return np.full(shape, depth, np.float32)


def box_before_wall(near=1.5, far=3.0, wide=40):
    depth = wall(far)
    depth[40:90, 80 - wide // 2 : 80 + wide // 2] = near
    return depth


def measured(depth, config, seed=0):
    return measure_stereo(depth, np.ones_like(depth), FOCAL, config, np.random.default_rng(seed))


def test_an_ideal_camera_returns_what_is_there_but_for_the_shadow():
    depth = box_before_wall()
    seen = measured(depth, PLAIN)
    known = seen > 0
    np.testing.assert_allclose(seen[known & (np.abs(seen - depth) < 0.5)], 3.0, atol=1.6)
    assert known[:, 120:].all()
    lost = np.argwhere(~known)
    reach = FOCAL * PLAIN.baseline * (1 / 1.5 - 1 / 3.0)
    assert len(lost) > 0
    assert ((lost[:, 0] >= 40) & (lost[:, 0] < 90)).all()
    columns = np.bincount(lost[:, 0], minlength=120)[40:90]
    assert abs(columns.mean() - reach) < 2.0
    # on one side only
    assert (lost[:, 1] < 80).all() or (lost[:, 1] > 80).all()


def test_errors_grow_with_the_square_of_the_distance():
    spread = [np.std(measured(wall(z), plain(error=0.1)) - z) for z in (1.0, 2.0, 4.0)]
    expected = 0.1 / (FOCAL * PLAIN.baseline) * np.array([1.0, 4.0, 16.0])
    np.testing.assert_allclose(spread, expected, rtol=0.3)


def test_neighbours_err_alike():
    off = measured(wall(2.0), plain(error=0.1, blob=20.0)) - 2.0
    beside = np.corrcoef(off[:, :-1].ravel(), off[:, 1:].ravel())[0, 1]
    away = np.corrcoef(off[:, :-60].ravel(), off[:, 60:].ravel())[0, 1]
    assert beside > 0.9
    assert abs(away) < 0.4


def test_what_is_near_grows():
    depth = box_before_wall()
    seen = measured(depth, plain(fattening=1.0, window=11))
    near = (seen > 0) & (seen < 2.0)
    assert near.sum() > 1.3 * (depth < 2.0).sum()
    assert near[40:90, 60:100].mean() > 0.95


def test_thin_things_vanish():
    depth = box_before_wall(wide=4)
    assert (measured(depth, plain(thin=0.0, window=15)) < 2.0)[45:85, 79:81].mean() > 0.9
    assert (measured(depth, plain(thin=1.0, window=15)) < 2.0)[45:85, 79:81].mean() < 0.2


def test_filling_leaves_no_shadow():
    depth = box_before_wall()
    for mode in (1, 2, 3):
        assert (measured(depth, plain(fill=mode)) > 0).all()


def test_smoothing_takes_from_the_bumps_and_stops_at_large_steps():
    rough = plain(error=0.2, blob=2.0)
    smooth = plain(error=0.2, blob=2.0, smoothing=0.8, smooth_step=2.0)
    assert np.std(measured(wall(2.0), smooth)) < 0.7 * np.std(measured(wall(2.0), rough))
    seen = measured(box_before_wall(), plain(smoothing=0.9, smooth_step=1.0))
    np.testing.assert_allclose(seen[65, 80], 1.5, atol=0.01)
    np.testing.assert_allclose(seen[65, 150], 3.0, atol=0.01)


def test_weak_surfaces_are_lost():
    depth, light = wall(2.0), np.ones((120, 160), np.float32)
    light[:, 80:] = 0.2
    seen = measure_stereo(depth, light, FOCAL, plain(lost=0.4), np.random.default_rng(0))
    assert (seen[:, 90:] == 0).mean() > (seen[:, :70] == 0).mean() + 0.15


def test_aligned_depth_is_resampled():
    own, aligned = (measured(wall(2.0), plain(error=0.1, colour_offset=x)) for x in (0.0, 0.03))
    assert not (own[:, :-1] == own[:, 1:]).any()
    assert 0.01 < (aligned[:, :-1] == aligned[:, 1:]).mean() < 0.6


def test_same_seed_same_image():
    depth = box_before_wall()
    np.testing.assert_array_equal(measured(depth, StereoConfig(), 3), measured(depth, StereoConfig(), 3))
    assert (measured(depth, StereoConfig(), 3) != measured(depth, StereoConfig(), 4)).any()


def test_a_smaller_image_of_the_same_camera_errs_as_much_in_metres():
    small = plain(error=0.1).scaled(0.5)
    depth = wall(2.0)
    half = measure_stereo(depth, np.ones_like(depth), 0.5 * FOCAL, small, np.random.default_rng(0))
    assert np.std(half) == pytest.approx(np.std(measured(depth, plain(error=0.1))), rel=0.4)


@pytest.mark.parametrize("name", ["d435", "d455", "oak_d", "zed"])
def test_presets_measure_a_wall(name):
    sensor = VirtualSensor(SENSORS[name].with_width(160), seed=1)
    corners = np.array([[-4, -4, 2.0], [4, -4, 2.0], [4, 4, 2.0], [-4, 4, 2.0]])
    seen = sensor.render([(corners, np.array([[0, 1, 2], [0, 2, 3]]))])
    assert (seen > 0).mean() > 0.8
    assert np.median(np.abs(seen[seen > 0] - 2.0)) < 0.03


def test_a_field_has_its_deviation_and_its_size():
    field = smooth_field(np.random.default_rng(0), (200, 200), 10.0)
    assert np.std(field) == pytest.approx(1.0, abs=0.2)
    assert np.corrcoef(field[:, :-1].ravel(), field[:, 1:].ravel())[0, 1] > 0.9
    assert abs(np.corrcoef(field[:, :-40].ravel(), field[:, 40:].ravel())[0, 1]) < 0.25
