"""A person whose lower body lies below the image."""

from __future__ import annotations

import numpy as np

import synthetic as syn
from depth_pose.core.config import PersonalConfig
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL
from depth_pose.core.skeleton import JOINT_NODES, NODE_INDEX
from depth_pose.match.upright_exemplars import UprightExemplars, head_axes
from stages import make_matcher


def _cut_below(posed, name=None):
    """The person in an image that ends at the height of a node."""
    depth, camera = syn.draw(syn.mesh(posed)), syn.CAMERA
    if name is not None:
        rows = round(float(camera.project(posed.nodes[NODE_INDEX[name]])[1]))
        depth, camera = depth[:rows], camera.cropped(0, 0, camera.width, rows)
    return syn.to_people(depth, camera=camera)


def test_a_cut_through_the_trunk_is_told_from_one_through_the_legs():
    posed = syn.posed(syn.arms_down())
    assert not _cut_below(posed).persons[0].is_cut_below
    sideways = syn.posed(syn.arms_down(), turn=90.0)
    assert not _cut_below(sideways, "left_ankle").persons[0].is_cut_below
    assert _cut_below(posed, "pelvis").persons[0].is_cut_below


def test_a_cut_by_the_side_is_told():
    def seen(aside):
        return syn.to_person(syn.draw(syn.mesh(syn.posed(syn.arms_down(), aside=aside))))

    assert not seen(0.5).is_cut_beside
    for aside in (-1.35, 1.35):
        assert seen(aside).is_cut_beside


def test_axes_lie_at_the_head_and_are_level():
    posed = syn.posed(syn.arms_down())
    axes = head_axes(_cut_below(posed).persons[0].points, 1.0)
    assert np.linalg.norm(axes.origin - posed.nodes[NODE_INDEX["head"]]) < 0.15
    np.testing.assert_array_equal(axes.rotation, R_CAMERA_FACING_MODEL)


def test_upright_exemplars_are_upright(bank):
    upright = UprightExemplars(bank)
    for number in upright.views.numbers:
        assert bank.rotations(number)[NODE_INDEX["chest"], 1, 1] > 0.9


def test_half_a_body_is_matched_upright_and_in_its_place(bank):
    posed = syn.posed(syn.arms_down())
    (match,) = make_matcher(bank, build=PersonalConfig(scale=1.0)).match(_cut_below(posed, "pelvis"))
    pose = bank.pose(match.candidates[0], 1.0)
    nodes = bank.body.pose(pose.rotations, pose.root, 1.0).nodes
    upper = [NODE_INDEX[n] for n in ("chest", "neck", "head", "left_shoulder", "right_shoulder")]
    assert set(upper) <= set(JOINT_NODES.tolist())
    assert np.linalg.norm((nodes - posed.nodes)[upper], axis=1).max() < 0.12
