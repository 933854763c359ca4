"""Images turned for the net: what it says comes back to where it belongs, and who lies across is found."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from depth_pose.core.config import SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.detect.candidates import CandidateFinder, lies_across
from depth_pose.detect.finder import PeopleFinder
from depth_pose.detect.turned import NORMAL_GRID, Turned, reduce_frame
from depth_pose.sim.scenes import sample_scene

SCENES = [
    s
    for s in (sample_scene(np.random.default_rng([21, k]), people=1, mounting="common") for k in range(20))
    if len(s.visible) and s.visible[0] > 0.9 and s.depth.shape == (240, 320) and s.sensor != "stereo"
]
"""Somebody who stands free before a camera, several times."""


@pytest.fixture(scope="module")
def finder() -> PeopleFinder:
    return PeopleFinder(SegmentConfig())


@cache
def upright() -> DepthFrame:
    """The scene in which the finder is surest: not it is tested here, but what turning changes."""
    finder = PeopleFinder(SegmentConfig())
    frames = [DepthFrame(0, "", s.depth, s.camera) for s in SCENES]
    return max(frames, key=lambda f: max((p.probability for p in finder.find(f).people), default=0.0))


def tipped(frame: DepthFrame) -> DepthFrame:
    """A frame of a camera that lies on its side: a quarter turn clockwise."""
    c = frame.camera
    camera = c._replace(width=c.height, height=c.width, fx=c.fy, fy=c.fx, cx=c.height - 1 - c.cy, cy=c.cx)
    return replace(frame, depth=np.ascontiguousarray(np.rot90(frame.depth, -1)), camera=camera)


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_the_camera_of_a_turned_image_sees_the_same_points(turns: int) -> None:
    frame = upright()
    turned = Turned(frame, turns, 0.2, NORMAL_GRID).image
    plain = reduce_frame(frame)
    spin = np.linalg.matrix_power(np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), turns)
    there = turned.camera.back_project(turned.depth[: turned.rows, : turned.cols])
    here = plain.camera.back_project(plain.depth[: plain.rows, : plain.cols])
    bounds = [np.percentile(p[p[..., 2] > 0], (2, 50, 98), axis=0) for p in (there, here @ spin.T)]
    np.testing.assert_allclose(*bounds, atol=0.08)


def test_a_tipped_camera_and_a_turned_image_find_what_an_upright_camera_finds(finder: PeopleFinder) -> None:
    plain, turned = finder.find(upright()), finder.find(tipped(upright()), 1)
    assert max(p.probability for p in plain.people) > 0.9
    best, same = (max(f.people, key=lambda p: p.probability) for f in (plain, turned))
    assert same.probability == pytest.approx(best.probability, abs=0.05)
    # the tipped camera's x is the upright one's -y, its y is that one's x
    x, y, z = best.torso
    np.testing.assert_allclose(same.torso, [-y, x, z], atol=0.05)
    areas = [(f.labels == p.label).mean() for f, p in ((plain, best), (turned, same))]
    assert areas[1] == pytest.approx(areas[0], rel=0.15)


def test_four_quarter_turns_are_none() -> None:
    image = reduce_frame(upright())
    rng = np.random.default_rng(0)
    mask = rng.normal(size=(1, *image.depth.shape)).astype(np.float32)
    torso = rng.normal(size=(4, *image.depth.shape)).astype(np.float32)
    back = Turned(upright(), 4, 0.2, NORMAL_GRID).back(image, mask, torso)
    inside = np.s_[:, : image.rows, : image.cols]
    np.testing.assert_array_equal(back[0][inside], mask[inside])
    np.testing.assert_array_equal(back[1][inside], torso[inside])


def test_in_doubt_the_image_is_turned_and_stays_so() -> None:
    candidates, frame = CandidateFinder(SegmentConfig()), tipped(tipped(upright()))
    first = max((p.probability for p in candidates.find(frame).people), default=0.0)
    for _ in range(16):
        found = candidates.find(frame)
    best = max(p.probability for p in found.people)
    assert best > 0.9
    assert best >= first
    candidates.reset()
    again = max((p.probability for p in candidates.find(frame).people), default=0.0)
    assert again == pytest.approx(first)


def test_only_who_lies_across_the_image_counts_in_one_turned_by_a_quarter() -> None:
    own = np.zeros((60, 80), bool)
    own[20:30, 10:60] = True
    assert lies_across(own)
    assert not lies_across(own.T)
    assert not lies_across(own[:, :20] & False)
