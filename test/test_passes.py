"""Two passes over a recording: one path through both answers, and what is written of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import JOINTS, Source
from depth_pose.passes import join

COUNT = len(JOINTS)
REST = np.stack([np.linspace(-0.5, 0.5, COUNT), np.linspace(-1, 1, COUNT), np.full(COUNT, 3.0)], axis=1)


def skeleton(n, offset=0.0, sure=0.9, body_id="body_1"):
    return Skeleton(
        stamp_ns=n * 33_000_000,
        frame_id="camera",
        body_id=body_id,
        source=Source.REFINED,
        confidence=sure,
        residual=0.0,
        scale=1.0,
        positions=REST + [offset, 0.0, 0.0],
        quats_xyzw=np.tile([0.0, 0.0, 0.0, 1.0], (COUNT, 1)),
        joint_confidence=np.full(COUNT, sure, np.float32),
        joint_states=np.zeros(COUNT, np.uint8),
        build=np.zeros(13, np.float32),
    )


def test_lag_of_both_directions_cancels():
    """A person who walks 2 cm a frame; each pass is 1 cm behind in its own direction."""
    forward = [[skeleton(n, 0.02 * n - 0.01)] for n in range(10)]
    backward = [[skeleton(n, 0.02 * n + 0.01)] for n in range(10)]
    everybody, gain = join(forward, backward)
    for n, (joined,) in enumerate(everybody):
        np.testing.assert_allclose(joined.positions, REST + [0.02 * n, 0, 0], atol=1e-3)
    assert gain.skeletons == 10 and gain.added == 0


def test_the_path_takes_the_surer_answer_and_does_not_jump_for_one_frame():
    """The first pass is wrong until frame 6; one doubtful frame of the second is not worth two jumps."""
    forward = [[skeleton(n, 0.5 if n < 6 else 0.0, 0.3 if n < 6 else 0.9)] for n in range(10)]
    backward = [[skeleton(n, 0.0, 0.25 if n == 3 else 0.9)] for n in range(10)]
    everybody, gain = join(forward, backward)
    assert max(abs(joined.positions - REST).max() for (joined,) in everybody) < 0.01
    assert gain.replaced >= 6
    assert gain.confidence[1] > gain.confidence[0]


def test_who_is_answered_in_one_pass_only_is_in_the_answer():
    forward = [[], [skeleton(1)], [skeleton(2), skeleton(2, 1.0, body_id="body_2")]]
    backward = [[skeleton(0)], [skeleton(1)], [skeleton(2)]]
    everybody, gain = join(forward, backward)
    assert [[s.body_id for s in frame] for frame in everybody] == [
        ["body_1"],
        ["body_1"],
        ["body_1", "body_2"],
    ]
    assert (gain.skeletons, gain.added) == (4, 1)


def test_nobody_in_view_is_no_error():
    everybody, gain = join([[], []], [[], []])
    assert everybody == [(), ()]
    assert gain.skeletons == 0


def test_equal_answers_stay_as_they_are():
    forward = [[skeleton(n)] for n in range(3)]
    everybody, _ = join(forward, [[replace(s) for s in frame] for frame in forward])
    assert [frame[0].stamp_ns for frame in everybody] == [0, 33_000_000, 66_000_000]
    assert everybody[1][0].positions == pytest.approx(REST)
