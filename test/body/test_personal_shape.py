"""Builds: parts change what they name and nothing else; files round trip, and bad ones are refused."""

from __future__ import annotations

import json

import numpy as np
import pytest

from depth_pose.body.build import BUILD_NAMES, CORRELATION, SPREAD, BuildSpace, prior_information
from depth_pose.body.build_file import KnownBuild, load_build, save_build
from depth_pose.core.errors import ConfigError
from depth_pose.core.skeleton import MIRROR_NODES, NODE_INDEX, NODE_PARENTS, NODES

BONES = {
    "neck_head": ["head"],
    "upper_arm": ["left_elbow", "right_elbow"],
    "forearm": ["left_wrist", "right_wrist"],
    "thigh": ["left_knee", "right_knee"],
    "shank": ["left_ankle", "right_ankle"],
    "foot": ["left_foot", "right_foot"],
}
"""Parts that are one bone's length, and the nodes at their ends."""


@pytest.fixture(scope="module")
def space(body):
    return BuildSpace(body)


def build_of(**parts):
    return np.array([parts.get(name, 0.0) for name in BUILD_NAMES], np.float32)


def lengths(body):
    return np.linalg.norm(body.nodes[1:] - body.nodes[NODE_PARENTS[1:]], axis=1)


@pytest.mark.parametrize("part", BONES)
def test_a_part_is_the_share_that_its_bones_are_longer(space, part):
    changed = lengths(space.body(build_of(**{part: 0.1}))) / lengths(space.template) - 1.0
    for name, change in zip(NODES[1:], changed, strict=True):
        assert change == pytest.approx(0.1 if name in BONES[part] else 0.0, abs=1e-6), name


@pytest.mark.parametrize(
    ("part", "node", "axis"), [("shoulder_width", "left_shoulder", 0), ("hip_width", "left_hip", 0)]
)
def test_widths_move_joints_aside(space, part, node, axis):
    at = NODE_INDEX[node]
    moved, before = space.body(build_of(**{part: 0.1})).nodes[at], space.template.nodes[at]
    np.testing.assert_allclose(moved / before, np.where(np.arange(3) == axis, 1.1, 1.0), atol=1e-6)


@pytest.mark.parametrize("part", ["trunk_breadth", "trunk_depth", "arm_girth", "leg_girth"])
def test_girths_leave_the_bones_alone(space, part):
    body = space.body(build_of(**{part: 0.15}))
    np.testing.assert_allclose(body.nodes, space.template.nodes, atol=1e-12)
    assert np.abs(body.vertices - space.template.vertices).max() > 0.005


def test_left_and_right_are_alike(space):
    nodes = space.body(np.linspace(-0.2, 0.2, len(BUILD_NAMES)).astype(np.float32)).nodes
    np.testing.assert_allclose(nodes[MIRROR_NODES] * [-1.0, 1.0, 1.0], nodes, atol=1e-9)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_skin_stays_whole_two_standard_deviations_out(space, sign):
    body = space.body((2.0 * sign * SPREAD).astype(np.float32))
    turned = (body.normals * space.template.normals).sum(axis=1)
    assert (turned > 0.5).mean() > 0.995


def test_no_build_is_the_template_and_bodies_are_made_once(space):
    assert space.body(build_of()) is space.body(np.zeros(0, np.float32)) is space.template
    assert space.body(build_of(thigh=0.05)) is space.body(build_of(thigh=0.05))


def test_the_skin_of_a_build_is_that_of_its_body(space):
    made = space.body(build_of(thigh=0.05))
    np.testing.assert_array_equal(made.skin.vertices, made.vertices)
    np.testing.assert_array_equal(made.skin.influence, space.template.skin.influence)


def test_the_prior_is_the_survey_without_what_ties_girths_to_bones():
    covariance = np.linalg.inv(prior_information())
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), SPREAD, rtol=1e-9)
    of_bones = covariance[:9, :9] / np.outer(SPREAD[:9], SPREAD[:9])
    np.testing.assert_allclose(of_bones, CORRELATION[:9, :9], atol=1e-9)
    np.testing.assert_allclose(covariance[:9, 9:], 0.0, atol=1e-12)
    assert np.array_equal(CORRELATION, CORRELATION.T)
    assert np.linalg.eigvalsh(CORRELATION).min() > 0.0


# --- files


@pytest.fixture
def known():
    spread = np.linspace(0.01, 0.05, 13)
    return KnownBuild(0.98, 0.012, np.round(np.linspace(-0.1, 0.2, 13), 4), np.round(spread, 4), 250)


def test_a_file_gives_the_build_that_was_saved(tmp_path, known):
    save_build(tmp_path / "me.json", known)
    again = load_build(tmp_path / "me.json")
    np.testing.assert_allclose(again.build, known.build)
    np.testing.assert_allclose(again.spread, known.spread)
    assert (again.scale, again.scale_spread, again.frames) == (0.98, 0.012, 250)


def changed(content, *keys, value):
    inside = content
    for key in keys[:-1]:
        inside = inside[key]
    if value is None:
        del inside[keys[-1]]
    else:
        inside[keys[-1]] = value


@pytest.mark.parametrize(
    ("keys", "value", "says"),
    [
        (("format",), "bank", "is not a build"),
        (("version",), 2, "version 2"),
        (("scale",), "tall", "scale is 'tall'"),
        (("scale",), 40, "from 0.3 to 2.5"),
        (("scale",), float("nan"), "scale is nan"),
        (("parts", "thigh"), None, "missing or unknown: thigh"),
        (("parts", "nose"), {"value": 0, "spread": 1}, "missing or unknown: nose"),
        (("parts", "thigh"), 3, "thigh.value is None"),
        (("parts", "thigh", "value"), 1.5, "thigh.value is 1.5"),
        (("parts", "thigh", "spread"), 0, "thigh.spread is 0"),
        (("parts",), [1, 2], "missing or unknown: "),
    ],
)
def test_a_bad_file_is_refused_with_the_reason(tmp_path, known, keys, value, says):
    path = tmp_path / "bad.json"
    save_build(path, known)
    content = json.loads(path.read_text())
    changed(content, *keys, value=value)
    path.write_text(json.dumps(content))
    with pytest.raises(ConfigError, match=r"bad\.json") as refused:
        load_build(path)
    assert says in str(refused.value)


@pytest.mark.parametrize(
    ("text", "says"), [("{", "not JSON"), ("[]", "is not a build"), (None, "cannot be read")]
)
def test_what_is_no_build_is_refused(tmp_path, text, says):
    path = tmp_path / "odd.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(ConfigError, match=says):
        load_build(path)
