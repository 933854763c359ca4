"""What becomes of a fit, and who is published: tables."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.body.pose import Fitted
from depth_pose.recover.failure import KINDS, Failure, Verdict, judge
from depth_pose.recover.published import is_published, renew_standing
from depth_pose.track.state import Answer

FIT = Fitted.lost(0, "body_1")
"""Stands for any earlier fit."""
FIRST, LOST, KNOWN, FAILED_ONCE = (
    Answer(),
    Answer(is_waiting=True),
    Answer(last=FIT, good=FIT),
    Answer(last=FIT),
)


@pytest.mark.parametrize(
    ("kind", "answer", "is_over", "is_hopeless", "verdict"),
    [
        (None, FIRST, False, False, Verdict.TRUSTED),
        (None, KNOWN, True, True, Verdict.TRUSTED),
        # the first frame: given, but not trusted, unless nothing is like a body
        ("joint_angle", FIRST, False, False, Verdict.DOUBTFUL),
        ("low_confidence", FIRST, False, True, Verdict.REFUSED),
        ("no_pose", FIRST, False, False, Verdict.REFUSED),
        # after a loss: a plausible pose is where following begins again
        ("low_confidence", LOST, False, False, Verdict.TRUSTED),
        ("joint_angle", LOST, False, False, Verdict.REFUSED),
        ("no_pose", LOST, False, False, Verdict.REFUSED),
        # with a frame before: compared with the body registered from there
        ("jump", KNOWN, False, False, Verdict.COMPARED),
        ("no_pose", KNOWN, False, True, Verdict.COMPARED),
        ("joint_angle", FAILED_ONCE, False, False, Verdict.COMPARED),
        ("joint_angle", FAILED_ONCE, False, True, Verdict.REFUSED),
        # the last good fit is too old
        ("jump", KNOWN, True, False, Verdict.TRUSTED),
        ("worse_fit", KNOWN, True, False, Verdict.TRUSTED),
        ("bone_length", KNOWN, True, False, Verdict.REFUSED),
        ("no_pose", KNOWN, True, False, Verdict.REFUSED),
    ],
)
def test_what_becomes_of_a_fit(kind, answer, is_over, is_hopeless, verdict) -> None:
    failure = None if kind is None else Failure(kind, "")
    assert judge(failure, answer, is_over=is_over, is_hopeless=is_hopeless) is verdict


def test_implausible_poses_need_to_agree_much_better() -> None:
    allowed = {kind: Failure(kind, "").allowance for kind in KINDS}
    assert allowed["no_pose"] > allowed["bone_length"] == allowed["joint_angle"] > 0.0
    assert {kind for kind in KINDS if Failure(kind, "").is_implausible} == {k for k in allowed if allowed[k]}


@pytest.mark.parametrize(
    ("probability", "standing", "is_refused", "published"),
    [
        (0.6, 0.3, False, True),
        (0.6, 0.05, False, False),
        (0.6, 0.3, True, False),
        (0.9, 0.05, False, True),
        (0.9, 0.05, True, True),
        (0.75, 0.0, True, True),
    ],
)
def test_who_is_published(probability, standing, is_refused, published) -> None:
    assert is_published(probability, standing, is_refused=is_refused) == published


def test_standing_follows_probability_and_confidence() -> None:
    standing = 0.3
    for _ in range(40):
        standing = renew_standing(standing, 0.8, 0.5)
    assert standing == pytest.approx(0.4, abs=1e-3)
    assert np.isclose(renew_standing(0.3, 0.0, 1.0), 0.225)
