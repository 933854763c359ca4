"""Proposed bone lengths: measured of who stands; a size that clothes made too large is not taken."""

from __future__ import annotations

import numpy as np
import pytest

import synthetic as syn
from depth_pose.body.build import BUILD_NAMES, BuildSpace
from depth_pose.core.measurement import NO_PROPOSALS, Proposals
from depth_pose.core.skeleton import JOINT_NODES, JOINTS, MIRROR_JOINTS
from depth_pose.refine import proposed_bones
from depth_pose.refine.personal import Evidence, Proposed
from depth_pose.refine.proposed_bones import LENGTHS, BoneLengths, ProposedBones, measure_bones
from depth_pose.refine.proposed_depth import TrunkDepth
from depth_pose.refine.running_median import forget
from depth_pose.refine.tuning import BuildTuning
from depth_pose.refine.upright_stance import find_standing
from learned import Learned

PARTS = len(BUILD_NAMES)
BONES = len(proposed_bones.BONES)
AS_DEEP = TrunkDepth(0.0, np.eye(1 + PARTS)[1 + BUILD_NAMES.index("trunk_depth")], 1.0)


@pytest.fixture(scope="module")
def space(body):
    return BuildSpace(body)


def proposing(nodes, sure=0.68):
    joints = nodes[JOINT_NODES]
    places, weights = np.stack([joints, joints[MIRROR_JOINTS]]), np.full((2, len(joints)), sure)
    return Proposals(np.asarray(JOINT_NODES, np.int64), places, weights, np.full((2, len(joints), 2), 0.04))


def standing(body, scale=1.0, turn=0.0, **turned):
    rotations = syn.upright(**{node: syn.rotation(*how) for node, how in turned.items()})
    return syn.posed(rotations, turn=turn, scale=scale, body=body).nodes


def measure(proposals, nodes):
    return measure_bones(find_standing(proposals, nodes), nodes)


def proposed(space, scale, build=None, seed=0, noise=0.0):
    """Bones of a standing person of a size as the finder would propose them."""
    body = space.body(np.asarray(np.zeros(PARTS) if build is None else build, np.float32))
    bones = measure(proposing(standing(body, scale)), standing(body, scale))
    about = np.random.default_rng(seed).normal(0.0, noise, BONES)
    return BoneLengths(bones.lengths + proposed_bones.BIAS + about, bones.sure)  # as if it had no bias


def size(logarithm, build=None):
    return np.concatenate([[logarithm], np.zeros(PARTS) if build is None else build])


class Gathered:
    """Proposed lengths over frames."""

    def __init__(self, space, frames=()):
        self.bones, self.told = ProposedBones(space), LENGTHS.empty()
        for frame in frames:
            self.add(frame)

    def add(self, frame):
        self.told = LENGTHS.add(self.told, frame.lengths, frame.sure)

    def excess(self, x):
        return self.bones.excess(self.told, x)


def test_lengths_are_those_between_proposals_less_the_bias(space):
    nodes = standing(space.template, 1.1)
    told = measure(proposing(nodes), nodes)
    ends = np.array(list(proposed_bones.NODES)).T
    true = [np.log(np.linalg.norm(nodes[a] - nodes[b])) for a, b in ends]
    np.testing.assert_allclose(told.lengths, true - proposed_bones.BIAS, atol=1e-9)
    assert (told.sure[4:] > 0.5).all()  # arms hang, legs stand: all across the line of sight


def test_either_naming_of_the_sides_says_the_same(space):
    nodes = standing(space.template, right_knee=("x", 30.0))
    own = proposing(nodes)
    other = own._replace(places=own.places[::-1], weights=own.weights[::-1])
    for a, b in zip(measure(own, nodes), measure(other, nodes), strict=True):
        np.testing.assert_array_equal(a, b)


def test_bones_toward_the_camera_count_little(space):
    ahead = standing(space.template, left_shoulder=("x", -90.0))
    names = list(proposed_bones.BONES)
    arm = names.index(("left_shoulder", "left_elbow"))
    aside = standing(space.template)
    there, across = measure(proposing(ahead), ahead), measure(proposing(aside), aside)
    assert there.sure[arm] < 0.5 * across.sure[arm]
    shoulders = names.index(("left_shoulder", "right_shoulder"))
    profile = standing(space.template, turn=90.0)
    assert measure(proposing(profile), profile).sure[shoulders] < 0.1 * across.sure[shoulders]


@pytest.mark.parametrize(
    "turned",
    [
        {"left_knee": ("x", 110.0), "right_knee": ("x", 110.0)},
        {
            "left_hip": ("x", -90.0),
            "right_hip": ("x", -90.0),
            "left_knee": ("x", 90.0),
            "right_knee": ("x", 90.0),
        },
        {"pelvis": ("x", 90.0)},
        {"pelvis": ("z", 90.0)},
    ],
)
def test_people_who_kneel_sit_or_lie_say_nothing(space, turned):
    nodes = standing(space.template, **turned)
    assert find_standing(proposing(nodes), nodes) is None


def test_without_proposals_nothing_is_said(space):
    nobody = NO_PROPOSALS
    assert find_standing(nobody, standing(space.template)) is None
    assert Gathered(space).excess(size(0.5)) == 0.0


def test_much_larger_than_proposed_is_too_large_and_a_little_is_not(space):
    bones = Gathered(space, (proposed(space, 1.0, seed=k, noise=0.08) for k in range(40)))
    assert bones.excess(size(-0.1)) == bones.excess(size(0.0)) == bones.excess(size(0.02)) == 0.0
    excess = [bones.excess(size(s)) for s in (0.06, 0.1, 0.2, 0.3)]
    assert excess == sorted(excess)
    assert excess[1] > 0.05
    assert excess[3] == pytest.approx(0.27, abs=0.03)


def test_skin_of_thick_limbs_is_believed_less_and_that_of_thin_ones_more(space):
    bones = Gathered(space, [proposed(space, 1.0)] * 20)
    thick, thin = np.zeros(PARTS), np.zeros(PARTS)
    limbs = [BUILD_NAMES.index(girth) for girth in ("arm_girth", "leg_girth")]
    thick[limbs], thin[limbs] = 0.2, -0.2
    wide, usual, narrow = (bones.excess(size(0.06, build)) for build in (thick, None, thin))
    assert wide > usual + 0.03
    assert narrow < usual - 0.02


def test_wild_proposals_are_outvoted(space):
    rng = np.random.default_rng(3)
    frames = [proposed(space, 1.0, seed=k, noise=0.03) for k in range(30)]
    wild = [BoneLengths(np.log(rng.uniform(1e-3, 1e3, BONES)), np.ones(BONES)) for _ in range(8)]
    sane = Gathered(space, frames).excess(size(0.15))
    assert Gathered(space, frames + wild).excess(size(0.15)) == pytest.approx(sane, abs=0.03)


def test_proportions_of_the_build_are_not_taken_for_clothes(space):
    build = np.zeros(PARTS)
    build[[BUILD_NAMES.index("thigh"), BUILD_NAMES.index("shank")]] = 0.15
    bones = Gathered(space, [proposed(space, 1.0, build)] * 20)
    assert bones.excess(size(0.0, build)) == 0.0
    assert bones.excess(size(0.15, build)) > 0.1


def test_what_was_proposed_is_forgotten(space):
    bones = Gathered(space, [proposed(space, 1.0)] * 20)
    for _ in range(40):
        bones.told = forget(bones.told, 0.9)
        bones.add(proposed(space, 1.25))
    assert bones.excess(size(np.log(1.25))) == 0.0


def in_a_coat(space, is_given=False, score=0.1):
    """Follow somebody of size 1.0 whose skin says 1.2; how well frames fit is ``score``."""
    rng = np.random.default_rng(1)
    personal = Learned(BuildTuning(), space)
    for frame in range(40):
        personal.take_size(1.2, is_given)
        rows = rng.standard_normal((40, 1 + PARTS))
        skin = rows.T @ rows
        evidence = Evidence(skin, skin @ size(np.log(1.2)))
        told = Proposed(proposed(space, 1.0, seed=frame, noise=0.05), AS_DEEP)
        personal.add(frame * 60_000_000, score, evidence, told)
    personal.take_size(1.2, is_given)
    return personal


def test_a_coat_does_not_make_somebody_larger(space):
    personal = in_a_coat(space)
    assert personal.scale < 1.05
    assert personal.known().scale == pytest.approx(personal.scale, rel=0.005)
    np.testing.assert_allclose(personal.build, 0.0, atol=0.02)  # proportions are left as skin tells them


def test_nor_while_no_frame_fits_well_enough_to_use_the_build(space):
    personal = in_a_coat(space, score=1.0)
    assert not personal.build.any()
    assert personal.scale < 1.05


def test_a_given_size_is_kept_whatever_is_proposed(space):
    assert in_a_coat(space, is_given=True).scale == pytest.approx(1.2, rel=0.01)


def test_two_frames_do_not_decide(space):
    bones = [proposed(space, 0.7)] * 3
    assert Gathered(space, bones[:2]).excess(size(0.0)) == 0.0
    assert Gathered(space, bones).excess(size(0.0)) > 0.2


def test_people_whose_legs_are_cut_off_say_little(space):
    nodes = standing(space.template)
    whole = proposing(nodes)
    legs = [j for j, name in enumerate(JOINTS) if name.split("_")[-1] in ("knee", "ankle", "foot")]
    cut = whole._replace(weights=whole.weights.copy())
    cut.weights[:, legs] = 0.05
    told = [measure(p, nodes).sure.max() for p in (whole, cut)]
    assert told[1] < 0.02 * told[0]
