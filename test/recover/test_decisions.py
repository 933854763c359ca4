"""What becomes of a fit, and who is published: tables."""

from __future__ import annotations

import pytest

from depth_pose.body.pose import Fitted
from depth_pose.recover.failure import KINDS, Failure, Verdict, judge
from depth_pose.recover.published import is_published, renew_distance
from depth_pose.track.state import Answer, Evidence

FIT = Fitted.lost(0, "body_1")
"""Stands for any earlier fit."""
FIRST, LOST, KNOWN, FAILED_ONCE = (
    Answer(),
    Answer(is_waiting=True),
    Answer(last=FIT, good=FIT),
    Answer(last=FIT),
)


@pytest.mark.parametrize(
    ("kind", "answer", "is_over", "verdict"),
    [
        (None, FIRST, False, Verdict.TRUSTED),
        (None, KNOWN, True, Verdict.TRUSTED),
        # the first frame: given, but not trusted
        ("joint_angle", FIRST, False, Verdict.DOUBTFUL),
        ("low_confidence", FIRST, False, Verdict.DOUBTFUL),
        ("no_pose", FIRST, False, Verdict.REFUSED),
        # after a loss: a plausible pose is where following begins again
        ("low_confidence", LOST, False, Verdict.TRUSTED),
        ("joint_angle", LOST, False, Verdict.REFUSED),
        ("no_pose", LOST, False, Verdict.REFUSED),
        # with a frame before: compared with the body registered from there
        ("jump", KNOWN, False, Verdict.COMPARED),
        ("no_pose", KNOWN, False, Verdict.COMPARED),
        ("joint_angle", FAILED_ONCE, False, Verdict.COMPARED),
        # the last good fit is too old
        ("jump", KNOWN, True, Verdict.TRUSTED),
        ("worse_fit", KNOWN, True, Verdict.TRUSTED),
        ("bone_length", KNOWN, True, Verdict.REFUSED),
        ("no_pose", KNOWN, True, Verdict.REFUSED),
    ],
)
def test_what_becomes_of_a_fit(kind, answer, is_over, verdict) -> None:
    failure = None if kind is None else Failure(kind, "")
    assert judge(failure, answer, is_over=is_over) is verdict


def test_implausible_poses_need_to_agree_much_better() -> None:
    allowed = {kind: Failure(kind, "").allowance for kind in KINDS}
    assert allowed["no_pose"] > allowed["bone_length"] == allowed["joint_angle"] > 0.0
    assert {kind for kind in KINDS if Failure(kind, "").is_implausible} == {k for k in allowed if allowed[k]}


@pytest.mark.parametrize(
    ("probability", "was_published", "is_refused", "published"),
    [
        (0.9, False, False, True),
        (0.5, False, False, True),
        (0.4, False, False, False),
        (0.4, True, False, True),
        (0.3, True, False, False),
        (0.7, True, True, False),
        (0.8, False, True, True),
    ],
)
def test_who_is_published(probability, was_published, is_refused, published) -> None:
    assert is_published(probability, was_published, is_refused, least=0.5) == published


def test_pose_distance_is_a_running_mean() -> None:
    evidence = Evidence(pose_distance=renew_distance(Evidence(), 1.3))
    assert evidence.pose_distance == 1.3
    for _ in range(40):
        evidence = Evidence(pose_distance=renew_distance(evidence, 0.9))
    assert evidence.pose_distance == pytest.approx(0.9, abs=1e-3)
