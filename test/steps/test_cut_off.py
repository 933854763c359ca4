"""A person whose lower body lies below the image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import synthetic as syn
from depth_pose.core.config import MatchConfig
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL
from depth_pose.core.skeleton import JOINT_NODES, NODE_INDEX
from depth_pose.people.person import view_person
from depth_pose.steps.cut_off import UprightExemplars, head_axes, is_cut_off
from depth_pose.steps.match import Matcher


def _cut(cloud, rows):
    """The cloud without its lowest rows."""
    return replace(cloud, points=cloud.points[:rows], labels=cloud.labels[:rows])


def _cut_below(cloud, posed, name):
    """The cloud of an image that ends at the height of a node."""
    y = posed.nodes[NODE_INDEX[name], 1]
    below = np.nanmax(np.where(np.isfinite(cloud.points[..., 1]), cloud.points[..., 1], -9.0), axis=1) > y
    return _cut(cloud, int(np.argmax(below)))


def test_a_cut_through_the_trunk_is_told_from_one_through_the_legs():
    posed = syn.posed(syn.arms_down())
    cloud = syn.to_cloud(syn.draw(syn.mesh(posed)))
    assert not is_cut_off(cloud)
    assert is_cut_off(_cut_below(cloud, posed, "pelvis"))


def test_axes_lie_at_the_head_and_are_level():
    posed = syn.posed(syn.arms_down())
    view = view_person(syn.to_cloud(syn.draw(syn.mesh(posed))))
    axes = head_axes(view.points, 1.0)
    assert np.linalg.norm(axes.origin - posed.nodes[NODE_INDEX["head"]]) < 0.15
    np.testing.assert_array_equal(axes.rotation, R_CAMERA_FACING_MODEL)


def test_upright_exemplars_are_upright(bank):
    upright = UprightExemplars(bank)
    for number in upright.views.numbers:
        assert bank.rotations(number)[NODE_INDEX["chest"], 1, 1] > 0.9


def test_half_a_body_is_matched_upright_and_in_its_place(bank):
    posed = syn.posed(syn.arms_down())
    cloud = _cut_below(syn.to_cloud(syn.draw(syn.mesh(posed))), posed, "pelvis")
    match = Matcher(bank, MatchConfig(scale=1.0)).match(cloud)
    best = match.candidates[0]
    from depth_pose.fit.articulated import candidate_pose

    pose = candidate_pose(bank, best, 1.0)
    nodes = bank.body.pose(pose.rotations, pose.root, 1.0).nodes
    upper = [NODE_INDEX[n] for n in ("chest", "neck", "head", "left_shoulder", "right_shoulder")]
    assert set(upper) <= set(JOINT_NODES.tolist())
    assert np.linalg.norm((nodes - posed.nodes)[upper], axis=1).max() < 0.12
