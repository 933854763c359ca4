"""The descriptor, against a plain numpy twin, and its rotation by addition."""

import numpy as np
import pytest

from depth_pose.core.errors import ConfigError
from depth_pose.volume.descriptor import OUTER_RADIUS_M, TOP_M, Bins, describe, heading_angle
from depth_pose.volume.headings import turns
from depth_pose.volume.hull import Volume, empty_volume


@pytest.fixture
def cloud():
    rng = np.random.default_rng(3)
    return rng.uniform([-0.5, 0.05, -0.4], [0.6, 1.8, 0.7], (500, 3))


def volume_of(points, centroid):
    return Volume(points, np.asarray(centroid, float), len(points), 8)


def plain(points, centroid, stature, bins):
    """Soft counts written out: (fine, heights * azimuths * radii)."""
    scale = 1.75 / stature
    x, z = points[:, 0] - centroid[0], points[:, 2] - centroid[2]
    fine = np.zeros((bins.heights, bins.radii, bins.fine))
    coordinates = [
        np.clip(points[:, 1] * scale / TOP_M * bins.heights - 0.5, 0, bins.heights - 1),
        np.clip(np.hypot(x, z) * scale / OUTER_RADIUS_M * bins.radii - 0.5, 0, bins.radii - 1),
        np.arctan2(x, z) / (2 * np.pi) * bins.fine - 0.5,
    ]
    for h, r, a in zip(*coordinates, strict=True):
        for i, u in ((int(h), 1 - h % 1), (int(h) + 1, h % 1)):
            for j, v in ((int(r), 1 - r % 1), (int(r) + 1, r % 1)):
                for k, w in ((int(np.floor(a)), 1 - a % 1), (int(np.floor(a)) + 1, a % 1)):
                    if u * v * w > 0:
                        fine[i, j, k % bins.fine] += u * v * w
    width = bins.fine // bins.azimuths
    out = np.empty((bins.fine, bins.heights, bins.azimuths, bins.radii))
    for s in range(bins.fine):
        turned = np.roll(fine, -s, axis=2).reshape(bins.heights, bins.radii, bins.azimuths, width)
        out[s] = turned.sum(axis=3).transpose(0, 2, 1)
    return np.sqrt(out.reshape(bins.fine, -1) / len(points))


@pytest.mark.parametrize("bins", [Bins(), Bins(8, 16, 3), Bins(3, 8, 2, 64)])
def test_it_is_what_it_is_said_to_be(cloud, bins):
    got = describe(volume_of(cloud, [0.05, 0.9, 0.1]), 1.6, bins)
    assert got.shape == (bins.fine, bins.size)
    assert np.allclose(got, plain(cloud, [0.05, 0.9, 0.1], 1.6, bins), atol=1e-6)
    assert np.allclose(np.linalg.norm(got, axis=1), 1.0)


def test_the_paper_has_160_dimensions():
    assert Bins().size == 160


def test_a_turned_person_turns_the_rows(cloud):
    """A person who turns by k steps looks under heading s + k as they did under s."""
    centroid = np.array([0.05, 0.9, 0.1])
    bins = Bins()
    for steps in (1, 17, 100):
        turn = turns(heading_angle(steps, bins))
        moved = (cloud - centroid) @ turn.T + centroid
        before, after = describe(volume_of(cloud, centroid), 1.7), describe(volume_of(moved, centroid), 1.7)
        assert np.allclose(np.roll(after, -steps, axis=0), before, atol=1e-6)


def test_it_does_not_depend_on_place_or_size(cloud):
    base = describe(volume_of(cloud, [0.0, 0.9, 0.0]), 1.75)
    moved = describe(volume_of(cloud + [0.7, 0.0, -0.3], [0.7, 0.9, -0.3]), 1.75)
    small = describe(volume_of(0.8 * cloud, [0.0, 0.72, 0.0]), 0.8 * 1.75)
    assert np.allclose(base, moved, atol=1e-9)
    assert np.allclose(base, small, atol=1e-9)


def test_a_small_move_is_a_small_change(cloud):
    base = describe(volume_of(cloud, [0.0, 0.9, 0.0]), 1.75)[0]
    for move in ([0.002, 0, 0], [0, 0.002, 0], [0, 0, 0.002]):
        other = describe(volume_of(cloud + move, [0.0, 0.9, 0.0]), 1.75)[0]
        assert np.linalg.norm(other - base) < 0.1


def test_refusals():
    with pytest.raises(ConfigError, match="multiple of azimuths"):
        Bins(5, 16, 2, 100)
    with pytest.raises(ValueError, match="empty"):
        describe(empty_volume(8), 1.7)
