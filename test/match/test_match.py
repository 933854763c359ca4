"""Matching: what the bank holds is found, at the right place and size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import synthetic as syn
from depth_pose.bank.views import DISTANCE_M, view_directions, view_rotation
from depth_pose.core.config import PersonalConfig
from depth_pose.match.match import match_confidence
from depth_pose.match.tuning import MatchTuning
from depth_pose.tuning import Tuning
from stages import make_matcher


@pytest.fixture(scope="module")
def matcher(bank):
    return make_matcher(bank, Tuning(match=MatchTuning(search_every=1)), build=PersonalConfig(scale=1.0))


def seen_as_in_the_bank(bank, exemplar, view, roll=0.0):
    """An exemplar's nodes and its people in front of the camera that rendered one of its views."""
    model = bank.body.pose(bank.rotations(exemplar), np.zeros(3))
    turn = syn.rotation("z", roll) @ view_rotation(*view_directions(exemplar)[view])
    target, ahead = model.vertices.mean(axis=0), np.array([0.0, 0.0, DISTANCE_M])
    vertices = (model.vertices - target) @ turn.T + ahead
    nodes = (model.nodes - target) @ turn.T + ahead
    return nodes, syn.to_people(syn.draw((vertices, bank.body.faces)))


def renamed(people, body_id):
    """The one person of a frame under another id."""
    (person,) = people.persons
    return replace(people, persons=(replace(person, found=replace(person.found, body_id=body_id)),))


def nodes_of(bank, candidate, scale=1.0):
    pose = bank.pose(candidate, scale)
    return bank.body.pose(pose.rotations, pose.root, scale).nodes


@pytest.mark.parametrize("exemplar", [0, 31, 77, 120, 163, 208, 251, 299])
def test_an_exemplar_is_found_first_from_its_own_views(bank, matcher, exemplar):
    for view in (1, 4, 6):
        nodes, people = seen_as_in_the_bank(bank, exemplar, view)
        (match,) = matcher.match(people)
        first = match.candidates[0]
        assert (first.exemplar, first.view) == (exemplar, view)
        assert syn.joint_error(nodes_of(bank, first), nodes) < 0.03
        assert first.score < 0.4


@pytest.mark.parametrize("roll", [-25.0, 20.0])
def test_a_rolled_camera_finds_the_same(bank, matcher, roll):
    nodes, people = seen_as_in_the_bank(bank, 31, 4, roll)
    first = matcher.match(people)[0].candidates[0]
    assert first.exemplar == 31
    assert syn.joint_error(nodes_of(bank, first), nodes) < 0.04


def test_an_answer(bank, matcher):
    (match,) = matcher.match(seen_as_in_the_bank(bank, 77, 2)[1])
    assert (match.body_id, match.bank_id) == ("body_1", bank.bank_id)
    assert match.scale == 1.0
    assert 1 <= len(match.candidates) <= MatchTuning().keep_unmeasured
    scores = [c.score for c in match.candidates]
    assert scores == sorted(scores)
    for c in match.candidates:
        assert 0 <= c.exemplar < bank.poses
        assert 0 <= c.view < bank.views
        np.testing.assert_allclose(c.rotation @ c.rotation.T, np.eye(3), atol=1e-6)
        assert 0.0 <= c.score <= 1.0
        assert c.distance >= 0.0


def test_confidence_falls_with_the_score_and_tells_a_person_from_a_board(bank, matcher):
    sure = [match_confidence(score) for score in np.linspace(0, 1, 21)]
    assert (np.diff(sure) < 0).all()
    assert 0.98 < sure[0] <= 1.0
    assert 0.0 <= sure[-1] < 0.02
    person = matcher.match(seen_as_in_the_bank(bank, 77, 2)[1])[0].candidates[0]
    depth = np.full((144, 176), np.inf)
    depth[20:130, 60:120] = 3.0
    board = matcher.match(syn.to_people(depth))[0].candidates[0]
    assert match_confidence(person.score) > 0.95
    assert match_confidence(board.score) < 0.5


def test_candidates_are_different_poses(bank, matcher):
    (match,) = matcher.match(seen_as_in_the_bank(bank, 77, 2)[1])
    nodes = [nodes_of(bank, c) for c in match.candidates]
    for i in range(len(nodes)):
        for j in range(i):
            assert np.linalg.norm(nodes[i] - nodes[j], axis=1).mean() > 0.049


@pytest.mark.parametrize("scale", [0.68, 0.8, 1.12])
def test_size_is_found(bank, scale):
    """A child and a tall person, held after three frames; the bank's body is 1.75 m."""
    matcher = make_matcher(bank, Tuning(match=MatchTuning(scale_frames=3)))
    for i in range(5):
        rotations = syn.FACING @ syn.rotation("y", 20.0 * i) @ bank.rotations(20 + i)
        posed = bank.body.pose(rotations, np.array([0.0, 0.0, 3.2]), scale)
        depth = syn.draw((posed.vertices, bank.body.faces))
        found = matcher.match(syn.to_people(depth, stamp_ns=syn.START_NS + i * syn.STEP_NS))[0].scale
        assert found == pytest.approx(scale, rel=0.08)
        if i == 3:
            held = found
    assert held == pytest.approx(scale, rel=0.04)
    assert found == held


@pytest.mark.parametrize("step_ns", [-syn.STEP_NS, 3 * 10**9])
def test_size_is_forgotten_where_stamps_jump_and_somebody_else_has_their_own(bank, step_ns):
    def people(scale, stamp_ns, body_id="body_1"):
        depth = syn.draw(syn.mesh(syn.posed(syn.arms_down(), distance=3.2, scale=scale)))
        return renamed(syn.to_people(depth, stamp_ns=stamp_ns), body_id)

    matcher = make_matcher(bank, Tuning(match=MatchTuning(scale_frames=1)))
    first = matcher.match(people(1.1, syn.START_NS))[0].scale
    assert matcher.match(people(0.75, syn.START_NS + syn.STEP_NS))[0].scale == first  # held
    other = matcher.match(people(0.75, syn.START_NS + 2 * syn.STEP_NS, "body_2"))[0].scale
    assert other == pytest.approx(0.75, rel=0.08)
    assert matcher.match(people(0.75, syn.START_NS + 3 * syn.STEP_NS))[0].scale == first
    after = syn.START_NS + 3 * syn.STEP_NS + step_ns
    assert matcher.match(people(0.75, after))[0].scale == pytest.approx(0.75, rel=0.08)


def test_nobody(matcher):
    assert matcher.match(syn.to_people(stamp_ns=7)) == ()


def test_warm_up_leaves_no_trace(bank):
    people = seen_as_in_the_bank(bank, 31, 3)[1]
    plain, warmed = (
        make_matcher(bank, Tuning(match=MatchTuning(scale_frames=2))),
        make_matcher(bank, Tuning(match=MatchTuning(scale_frames=2))),
    )
    warmed.warm_up()
    (a,), (b,) = plain.match(people), warmed.match(people)
    assert a.scale == b.scale
    assert [(c.exemplar, c.view, c.score) for c in a.candidates] == [
        (c.exemplar, c.view, c.score) for c in b.candidates
    ]
