"""The limb search: limbs that are plainly wrong are replaced, right ones are kept."""

from __future__ import annotations

import numpy as np
import pytest

import synthetic as syn
from depth_pose.body.pose import BodyPose, FittedBody
from depth_pose.body.rendered_depth import DepthComparer, Observation, nearest_person_pixels
from depth_pose.core.camera import Camera
from depth_pose.core.skeleton import NODE_INDEX
from depth_pose.refine import _limb_kernels as kernels
from depth_pose.refine._reach_kernels import Limbs, reach
from depth_pose.refine.articulated import ArticulatedFitter
from depth_pose.refine.limbs import LimbSearch, may_be_legs

DOWN = syn.rotation("z", -38.0), syn.rotation("z", 38.0)
FORWARD = syn.rotation("x", -20.0) @ syn.rotation("y", -60.0)
BAND = 0.12


@pytest.fixture(scope="module")
def search(bank):
    return LimbSearch(bank)


@pytest.mark.parametrize(
    ("true", "moved"),
    [
        ({"left_shoulder": syn.rotation("z", 100.0), "right_shoulder": DOWN[1]}, ["left_wrist"]),
        ({"left_shoulder": DOWN[0], "right_shoulder": syn.rotation("z", -100.0)}, ["right_wrist"]),
        (
            {"left_shoulder": syn.rotation("z", 40.0), "right_shoulder": syn.rotation("z", -50.0)},
            ["left_wrist", "right_wrist"],
        ),
        (
            {"left_shoulder": DOWN[0], "right_shoulder": DOWN[1], "left_hip": syn.rotation("z", 50.0)},
            ["left_ankle"],
        ),
        ({"left_shoulder": FORWARD, "right_shoulder": DOWN[1]}, ["left_wrist"]),
    ],
    ids=["left arm", "right arm", "both arms", "left leg", "arm forward"],
)
def test_wrong_limbs_are_replaced(body, search, true, moved):
    """The body stands with its limbs down where the input has them raised."""
    posed = syn.posed(syn.upright(**true))
    person = syn.to_person(syn.draw(syn.mesh(posed)))
    comparer = DepthComparer(person.coarse)
    wrong = BodyPose(syn.FACING @ syn.arms_down(), posed.nodes[0], 1.0)
    standing = body.pose(wrong.rotations, wrong.root)
    proposals = search.propose(FittedBody(wrong, standing.vertices, standing.nodes), comparer)
    assert 1 <= len(proposals) <= 5
    target = person.target(800)
    fitter = ArticulatedFitter(body)

    def compared(start):
        pose = fitter.fit(target, start).pose
        found = body.pose(pose.rotations, pose.root)
        return comparer.compare(found.vertices, body.faces).score, found.nodes

    without = compared(wrong)
    best = min(map(compared, proposals), key=lambda c: c[0])
    assert best[0] < without[0]
    ends = [NODE_INDEX[name] for name in moved]
    assert np.linalg.norm((without[1] - posed.nodes)[ends], axis=1).min() > 0.3
    assert np.linalg.norm((best[1] - posed.nodes)[ends], axis=1).max() < 0.08


def test_right_limbs_agree_better_than_others(body, search):
    """Others are proposed all the same, since they are not fitted yet; none of them wins."""
    rotations = syn.upright(left_shoulder=syn.rotation("z", 60.0), right_shoulder=DOWN[1])
    posed = syn.posed(rotations)
    person = syn.to_person(syn.draw(syn.mesh(posed)))
    comparer = DepthComparer(person.coarse)
    pose = BodyPose(syn.FACING @ rotations, posed.nodes[0], 1.0)
    before = pose.rotations.copy()
    right = comparer.compare(posed.vertices, body.faces).score
    for proposal in search.propose(FittedBody(pose, posed.vertices, posed.nodes), comparer):
        other = body.pose(proposal.rotations, proposal.root)
        if np.linalg.norm(other.nodes - posed.nodes, axis=1).max() > 0.15:
            assert comparer.compare(other.vertices, body.faces).score > right + 0.02
    np.testing.assert_array_equal(pose.rotations, before)


def test_proposals_change_nothing_but_limbs(body, search):
    posed = syn.posed(syn.upright(left_shoulder=syn.rotation("z", 100.0)))
    person = syn.to_person(syn.draw(syn.mesh(posed)))
    wrong = BodyPose(syn.FACING @ syn.arms_down(), posed.nodes[0], 0.98)
    standing = body.pose(wrong.rotations, wrong.root, 0.98)
    fitted = FittedBody(wrong, standing.vertices, standing.nodes)
    proposals = search.propose(fitted, DepthComparer(person.coarse))
    assert proposals
    trunk = [NODE_INDEX[n] for n in ("pelvis", "spine", "chest", "neck", "head")]
    for p in proposals:
        np.testing.assert_array_equal(p.rotations[trunk], wrong.rotations[trunk])
        np.testing.assert_array_equal(p.root, wrong.root)
        assert p.scale == 0.98
        r = p.rotations
        np.testing.assert_allclose(r @ r.transpose(0, 2, 1), np.broadcast_to(np.eye(3), r.shape), atol=1e-5)


def test_limbs_reach(search):
    """Bent limbs keep their bones, and end where they are to, or as far toward it as they can."""
    pair = search.pairs[0]
    samples, rotations = pair.limbs[0].samples, pair.rotations[0]
    targets = np.array([[0.3, 0.1, 0.3], [0.2, -0.2, 0.1], [0.5, 0.3, 2.0]])
    balls, turned = np.empty((6, 9, 3)), np.empty((6, *rotations.shape[1:]))
    reach(Limbs(samples, pair.tips[0], rotations, 1), targets, 2, balls, turned)
    starts = 1.5 * balls[:, 0] - 0.5 * balls[:, 2]
    for k, target in enumerate(np.repeat(targets, 2, axis=0)):
        line = (balls[k, 5] - starts[k]) / np.linalg.norm(balls[k, 5] - starts[k])
        np.testing.assert_allclose(line, (target - starts[k]) / np.linalg.norm(target - starts[k]), atol=1e-9)
        if k < 4:
            np.testing.assert_allclose(balls[k, 5], target, atol=1e-9)
        # the segments turn as their bones do
        for bone, (a, b) in enumerate(((None, 2), (2, 5), (5, 8))):
            begin = starts[k] if a is None else balls[k, a]
            rest = pair.ends[0, bone] if bone else pair.ends[0, 0]
            np.testing.assert_allclose(turned[k, 1 + bone] @ rest, balls[k, b] - begin, atol=1e-6)


def test_no_leg_explains_a_chairs_back(body, search):
    """What lies behind the trunk at its height is no leg; before it, or below, it may be one."""
    pose = BodyPose(syn.FACING @ syn.arms_down(), np.array([0.0, 0.0, 3.0]), 1.0)
    points = np.array([[0.0, -0.3, 3.3], [0.0, -0.3, 2.6], [0.0, 0.4, 3.3]], np.float32)
    np.testing.assert_array_equal(may_be_legs(points, pose), [False, True, True])


def test_pair_costs_twin():
    """The sum of costs and of what neither limb covers, for all pairs."""
    rng = np.random.default_rng(0)
    cost_a, cost_b = rng.uniform(0, 5, 12), rng.uniform(0, 5, 4)
    cover_a, cover_b = rng.uniform(0, 1, (12, 30)), rng.uniform(0, 1, (4, 30))
    weight = 3
    total = kernels.pair_costs(cost_a, cover_a.astype(np.float32), cost_b, cover_b.astype(np.float32), weight)
    uncovered = np.minimum(cover_a[:, None], cover_b).sum(axis=2)
    np.testing.assert_allclose(total, cost_a[:, None] + cost_b + weight * uncovered, rtol=1e-5)


def test_best_pairs_twin():
    """The best first, each different from those before; never the last of both, the limbs as they are."""
    rng = np.random.default_rng(0)
    total = rng.uniform(0, 5, (8, 6))
    total[-1, -1] = -1.0
    centres = rng.uniform(-0.1, 0.1, (8, 4, 3)), rng.uniform(-0.1, 0.1, (6, 4, 3))
    apart = 0.15

    def gap(side, i, j):
        return np.linalg.norm(centres[side][i] - centres[side][j], axis=-1).max()

    expected = []
    for k in np.argsort(total, axis=None):
        a, b = divmod(int(k), 6)
        same = [gap(0, a, c) < apart and gap(1, b, d) < apart for c, d in expected]
        if (a, b) != (7, 5) and not any(same):
            expected.append((a, b))
    assert 3 < len(expected) < 47
    for count in (3, 48):
        found = kernels.best_pairs(total, *centres, count, apart)
        assert [tuple(pair) for pair in found] == expected[:count]


def test_score_twin():
    """A limb's misfit, ball by ball, and the share to which each point lies off its surface."""
    rng = np.random.default_rng(1)
    limbs, balls, weight, keep = 15, 6, 2, 1.5
    samples = rng.uniform(-0.4, 0.4, (limbs, balls, 3))
    radii, areas = rng.uniform(0.03, 0.08, balls), rng.uniform(0.002, 0.01, balls)
    rotation, origin, scale = syn.rotation("y", 40.0) @ syn.FACING, np.array([0.05, 0.0, 2.0]), 0.9
    labels = rng.integers(0, 3, (36, 48)).astype(np.uint8)
    depth = np.where(labels == 1, rng.uniform(1.7, 2.3, labels.shape), 0.0).astype(np.float32)
    camera = Camera(48, 36, 50.0, 52.0, 23.5, 17.5)
    _, _, fx, fy, cx, cy = camera
    points = rng.uniform([-0.4, -0.4, 1.7], [0.4, 0.4, 2.3], (25, 3))
    observed = Observation(depth, labels, camera)
    nearest = nearest_person_pixels(observed)
    own, reach = origin + rng.uniform(-0.3, 0.3, (balls, 3)), 0.08

    centres = np.concatenate([origin + scale * samples @ rotation.T, own[None]])
    off = np.abs(np.linalg.norm(points - centres[:, :, None], axis=-1) - scale * radii[:, None]) / reach
    covers = np.minimum(off.min(axis=1), 1.0)
    costs = np.zeros(limbs + 1)
    for k in range(limbs + 1):
        for c, r, area in zip(centres[k], scale * radii, areas, strict=True):
            pixels = area * scale**2 * fx * fy / c[2] ** 2
            i, j = round(fy * c[1] / c[2] + cy), round(fx * c[0] / c[2] + cx)
            if not (0 <= i < 36 and 0 <= j < 48):
                costs[k] += 0.3 * pixels
                continue
            before = depth[i, j] - (c[2] - r)
            on_person = min(before / reach, 1.0) if before > 0 else min(-before / reach, 0.3)
            di, dj = nearest[i, j] - [i, j]
            beside = min(np.hypot(di * c[2] / fy, dj * c[2] / fx) / reach, 1.0)
            costs[k] += pixels * (beside, on_person, 0.3)[labels[i, j]]
    costs[limbs] -= keep

    def scored(fitting, best):
        limb, anchor = kernels.Limb(samples, radii, areas), kernels.Anchor(rotation, origin, scale)
        settings = kernels.LimbSettings(reach, keep, fitting, best)
        columns = np.ascontiguousarray(points.T, np.float32)
        return kernels.score_limbs(limb, own, anchor, observed, nearest, columns, weight, settings)

    chosen, cost, cover, found = scored(limbs + 1, limbs + 1)
    assert sorted(chosen) == list(range(limbs + 1))
    assert chosen[-1] == limbs
    np.testing.assert_allclose(cost, costs[chosen], rtol=1e-6)
    np.testing.assert_allclose(cover, covers[chosen], atol=1e-4)
    np.testing.assert_allclose(found, centres[chosen])

    few, best = 6, 3
    chosen = scored(few, best)[0]
    fitting = [k for k in np.argsort(costs)[:few] if k != limbs]
    assert set(chosen[:-1]) <= set(fitting)
    assert chosen[-1] == limbs
    total = costs + weight * covers.sum(axis=1)
    within = sorted([*fitting, limbs], key=lambda k: total[k])[:best]
    assert set(chosen) == {*within, limbs}
