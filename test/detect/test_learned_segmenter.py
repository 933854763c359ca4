"""Everybody's pixels by the learned finder, and what it leaves out of limbs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from crowd import CAMERA, person, seen
from depth_pose.core.config import SegmentConfig
from depth_pose.core.labels import HIDDEN, PERSON
from depth_pose.detect._border_kernels import LimbLimits, attach_apart, attach_limbs
from depth_pose.detect.finder import TorsoDetection
from depth_pose.detect.learned_segmenter import LearnedSegmenter
from depth_pose.detect.tuning import DetectTuning

JUMP_M = DetectTuning().depth_jump
LIMITS = LimbLimits(JUMP_M, area=0.15, width=0.13, chance=0.05)


def take_ends(depth, people, chance=0.5):
    labels = people.copy()
    attach_limbs(depth, labels, np.full(depth.shape, chance, np.float32), CAMERA, LIMITS)
    return labels


@pytest.mark.parametrize("frame", [0, 6, 18, 30])
def test_hands_and_feet_are_the_person_s(frame: int) -> None:
    """Arms that are held out end in hands: as free space they would turn the arms away."""
    shown = seen(frame, [person(frame, -0.5, 3.2)])
    true = shown.depth < 4.7
    labels = LearnedSegmenter(SegmentConfig()).segment(shown).labels
    assert (labels[true] == PERSON).mean() > 0.98
    assert not (labels[~true] == PERSON).any()


def test_a_camera_that_moves_is_told_from_one_that_stands_still() -> None:
    segmenter = LearnedSegmenter(SegmentConfig(), tuning=DetectTuning(find_every=1))
    there = [seen(k, [person(k, -0.5, 3.2)]) for k in range(3)]
    assert not segmenter.segment(there[0]).is_still  # nothing was seen before
    assert segmenter.segment(there[1]).is_still
    assert not segmenter.segment(replace(there[2], depth=there[2].depth + 1.0)).is_still


def bar(left: int, right: int, z: float = 2.0):
    """A wall at 4 m, and before it a bar of eight rows from one column to another."""
    depth = np.full((CAMERA.height, CAMERA.width), np.float32(4.0))
    depth[60:68, left:right] = z
    return depth


def test_a_small_end_is_taken_and_a_large_thing_is_not() -> None:
    """Somebody of 20 pixels' width is known; what goes on from them is taken up to a forearm's size."""
    for right, taken in ((60, True), (160, False)):  # 40 pixels of 12 by 94 mm, and 140
        depth = bar(0, right)
        people = np.zeros(depth.shape, np.uint8)
        people[60:68, :20] = 2
        labels = take_ends(depth, people)
        np.testing.assert_array_equal(labels == 2, (depth < 3.0) if taken else (people == 2))


def test_what_lies_farther_or_apart_is_not_taken() -> None:
    depth = bar(0, 20)
    depth[60:68, 20:30] = 2.0 + 2.0 * JUMP_M
    depth[60:68, 40:50] = 2.0
    depth[20:24, 20:24] = 0.0
    people = np.zeros(depth.shape, np.uint8)
    people[60:68, :20] = 1
    np.testing.assert_array_equal(take_ends(depth, people), people)


def test_of_two_people_each_keeps_their_own() -> None:
    depth = np.minimum(bar(0, 40), bar(50, 90, 2.5))
    people = np.zeros(depth.shape, np.uint8)
    people[60:68, :30], people[60:68, 60:90] = 1, 2
    labels = take_ends(depth, people)
    assert (labels[60:68, :40] == 1).all() and (labels[60:68, 50:90] == 2).all()
    assert (labels > 0).sum() == 8 * 80


def test_what_is_broad_or_unlikely_is_not_taken() -> None:
    depth = bar(0, 40)
    people = np.zeros(depth.shape, np.uint8)
    people[60:68, :20] = 1
    assert (take_ends(depth, people)[60:68, 20:40] == 1).all()
    np.testing.assert_array_equal(take_ends(depth, people, chance=0.01), people)
    depth[50:80, 20:40] = 2.0  # 0.35 m by 0.24 m
    np.testing.assert_array_equal(take_ends(depth, people), people)


def test_what_is_apart_is_taken_if_most_of_it_votes_for_somebody() -> None:
    """A shank below a desk; not what touches somebody, is large, or is another's."""
    limits = LIMITS._replace(chance=0.5)
    depth = bar(40, 80)
    people = np.zeros(depth.shape, np.uint8)
    people[20:40, 40:80] = 2

    def taken(depth, votes, whose=2):
        labels, claims = people.copy(), np.zeros(people.shape, np.uint8)
        claims[60:68, 40 : 40 + votes] = whose
        attach_apart(depth, labels, claims, CAMERA, limits)
        np.testing.assert_array_equal(labels[:50], people[:50])
        return labels[60:68, 40:80]

    assert (taken(depth, 30) == 2).all()
    assert (taken(depth, 30, whose=1) == 1).all()
    assert not taken(depth, 10).any()
    assert not taken(depth, 0).any()
    assert not taken(np.minimum(depth, bar(0, 160)), 30).any()
    depth[20:60, 60:70] = 2.0  # goes on from somebody: `attach_limbs` has judged it
    assert not taken(depth, 30).any()


def test_a_thing_that_the_second_look_refuses_still_hides(monkeypatch) -> None:
    """A chair before somebody's legs is no free space, whatever the first look took it for."""
    shown = seen(6, [person(6, -0.5, 3.2)], board=(40, 90, 90, 144, 2.2))
    segmenter = LearnedSegmenter(SegmentConfig())
    before = segmenter.segment(shown)
    board = shown.depth < 2.3
    assert (before.labels[board] == HIDDEN).mean() > 0.1
    find = segmenter.candidates.find

    def with_the_board(frame):
        found = find(frame)
        found.labels[board] = 2
        return replace(found, people=(*found.people, TorsoDetection(2, 0.7, np.array([-0.3, 0.4, 2.2]))))

    monkeypatch.setattr(segmenter.candidates, "find", with_the_board)
    after = segmenter.segment(replace(shown, stamp_ns=shown.stamp_ns + 10**9))
    assert [s.label for s in after.detections] == [1]  # the board is refused
    # the mask, which is applied before, may move the border by a pixel
    assert (after.labels != before.labels).sum() < 0.02 * (before.labels[board] == HIDDEN).sum()
