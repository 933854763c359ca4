"""Who was surely found and has not moved stays found, for a while; nobody else gains by it."""

import numpy as np
import pytest

from depth_pose.detect.detection_persistence import DetectionPersistence
from depth_pose.detect.segmentation import Detection

STEP_NS = 100_000_000


def detection(probability, label=1):
    return Detection(label, np.zeros(3), probability)


def frame(columns=(10, 30), away=2.0):
    """Labels of one person in some columns, and depth."""
    labels, depth = np.zeros((40, 60), np.uint8), np.full((40, 60), 4.0, np.float32)
    labels[5:35, slice(*columns)] = 1
    depth[labels == 1] = away
    return labels, depth


def run(frames, probabilities, step_ns=STEP_NS, beliefs=None):
    beliefs = beliefs or DetectionPersistence(0.9)
    return [
        beliefs.renew([detection(p)], *f, 1 + n * step_ns)[0].probability
        for n, (f, p) in enumerate(zip(frames, probabilities, strict=True))
    ]


def test_who_does_not_move_keeps_a_little_less_of_their_probability():
    seen = run([frame()] * 5, [0.95, 0.3, 0.25, 0.25, 0.3])
    assert seen[0] == 0.95
    assert 0.85 < seen[4] < seen[3] < seen[2] < seen[1] < 0.95


def test_it_is_gone_in_the_end():
    seen = run([frame()] * 200, [0.95] + [0.25] * 199)
    assert seen[-1] < 0.3
    assert seen[-1] >= 0.25


@pytest.mark.parametrize(
    "then",
    [frame(columns=(35, 55)), frame(away=2.2), frame(columns=(26, 46))],
    ids=["other", "behind", "moved"],
)
def test_who_moved_or_is_another_gains_nothing(then):
    assert run([frame(), then], [0.95, 0.3])[1] == 0.3


def test_who_was_never_sure_gains_nothing():
    assert run([frame()] * 3, [0.8, 0.3, 0.3]) == [0.8, 0.3, 0.3]


def test_what_is_surer_now_counts():
    assert run([frame()] * 2, [0.92, 0.97])[1] == 0.97


def test_a_gap_a_jump_back_and_a_reset_forget():
    assert run([frame()] * 2, [0.95, 0.3], step_ns=2_000_000_000)[1] == 0.3
    assert run([frame()] * 2, [0.95, 0.3], step_ns=-STEP_NS)[1] == 0.3
    beliefs = DetectionPersistence(0.9)
    run([frame()], [0.95], beliefs=beliefs)
    beliefs.reset()
    assert beliefs.renew([detection(0.3)], *frame(), STEP_NS)[0].probability == 0.3


def test_an_image_of_another_size_is_another_camera():
    beliefs = DetectionPersistence(0.9)
    run([frame()], [0.95], beliefs=beliefs)
    labels, depth = (a[::2, ::2] for a in frame())
    assert beliefs.renew([detection(0.3)], labels, depth, STEP_NS)[0].probability == 0.3
