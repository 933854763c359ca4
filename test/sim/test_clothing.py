"""Cloth: hangs where it is pinned, keeps its lengths, lags behind, stays out of legs."""

import numpy as np
import pytest

from depth_pose.core.errors import ConfigError
from depth_pose.motion.procedural.dance import perform
from depth_pose.sim.clothing import GARMENTS, Clothes, Garment, find_garment
from depth_pose.volume.headings import turns


@pytest.fixture(scope="module")
def still(body):
    return body.nodes, np.tile(np.eye(3), (21, 1, 1))


def lengths_off(clothes, vertices):
    a, b = clothes.links.T
    now = np.linalg.norm(vertices[a] - vertices[b], axis=1)
    return now / clothes.lengths - 1.0


def test_a_skirt_hangs_round(body, still):
    clothes = Clothes(Garment(skirt=0.5, flare=0.2), body)
    vertices = clothes.step(*still, 1 / 30)
    for _ in range(20):
        vertices = clothes.step(*still, 1 / 30)
    assert np.median(np.abs(lengths_off(clothes, vertices))) < 0.03
    assert vertices[:, 1].max() < body.nodes[0, 1] + 0.1
    assert body.nodes[0, 1] - 0.55 < vertices[:, 1].min() < body.nodes[0, 1] - 0.3
    assert vertices[:, 0].min() < -0.15 and vertices[:, 0].max() > 0.15
    assert np.abs(vertices[:, 0].mean()) < 0.02


def test_it_lags_a_turn_and_follows(body, still):
    nodes, rotations = still
    clothes = Clothes(Garment(skirt=0.6, flare=0.3), body)
    for _ in range(15):
        vertices = clothes.step(nodes, rotations, 1 / 30)
    faces = clothes.faces
    hem = np.arange(len(vertices))[-8:]

    def azimuth(v):
        return np.unwrap(np.arctan2(v[hem, 0] - nodes[0, 0], v[hem, 2] - nodes[0, 2]))

    before = azimuth(clothes.step(nodes, rotations, 1 / 30))
    turned = turns(np.radians(60.0)) @ rotations
    quick = clothes.step(nodes, turned, 0.1)
    lag = np.degrees(np.angle(np.exp(1j * (azimuth(quick) - before)))).mean()
    for _ in range(60):
        late = clothes.step(nodes, turned, 1 / 30)
    settled = np.degrees(np.angle(np.exp(1j * (azimuth(late) - before)))).mean()
    assert lag < 45.0 < settled
    assert faces.max() < len(late) and np.isfinite(late).all()


@pytest.mark.parametrize("name", [n for n, g in GARMENTS.items() if g is not None])
def test_dancing_in_every_garment(body, name):
    clip = perform("sweep", 4, 1.5)
    clothes = Clothes(find_garment(name), body)
    for rotations, root in zip(clip.rotations, clip.roots, strict=True):
        posed = body.pose(rotations, root)
        vertices = clothes.step(posed.nodes, rotations, 1 / clip.fps)
        assert np.isfinite(vertices).all() and vertices[:, 1].min() >= 0.0
        assert np.linalg.norm(vertices - posed.nodes[0], axis=1).max() < 1.6
    assert np.median(np.abs(lengths_off(clothes, vertices))) < 0.1
    knee = posed.nodes[[14, 18]]  # the legs stay inside the skirt, or at least it out of them
    assert np.linalg.norm(vertices[:, None] - knee, axis=-1).min() > 0.03


def test_reset_forgets(body, still):
    clothes = Clothes(Garment(), body)
    first = clothes.step(*still, 1 / 30)
    clothes.step(still[0] + [0.3, 0.0, 0.0], still[1], 1 / 30)
    clothes.reset()
    assert np.array_equal(clothes.step(*still, 1 / 30), first)


def test_refusals(body):
    with pytest.raises(ConfigError, match="no garment"):
        find_garment("armour")
    with pytest.raises(ConfigError, match="skirt or sleeves"):
        Clothes(Garment(skirt=0.0), body)
    with pytest.raises(ConfigError, match="the most it may be"):
        Garment(flare=2.0)
