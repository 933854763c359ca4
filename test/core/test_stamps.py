"""When the past no longer applies, and which frames are skipped."""

import pytest

from depth_pose.core.config import MAX_STAMP_GAP_NS
from depth_pose.core.stamps import LONGEST_SILENCE_NS, StampFilter, StampGuard, StampStep

START = 1_700_000_000_000_000_000
STEP = 40_000_000


@pytest.mark.parametrize(
    ("step_ns", "meaning"),
    [
        (40_000_000, StampStep.NEXT),
        (0, StampStep.NEXT),
        (MAX_STAMP_GAP_NS, StampStep.NEXT),
        (MAX_STAMP_GAP_NS + 1, StampStep.SILENCE),
        (LONGEST_SILENCE_NS, StampStep.SILENCE),
        (LONGEST_SILENCE_NS + 1, StampStep.BREAK),
        (-1, StampStep.BREAK),
        (-(10**18), StampStep.BREAK),
    ],
)
def test_what_a_step_means(step_ns, meaning):
    guard = StampGuard()
    assert guard.step(START) is StampStep.NEXT
    assert guard.step(START + step_ns) is meaning
    assert guard.step(START + step_ns + 1) is StampStep.NEXT  # goes on from where it jumped to


def test_the_gap_is_half_a_second():
    assert MAX_STAMP_GAP_NS == 500_000_000


def test_the_first_frame_is_no_break_even_at_zero():
    assert not StampGuard().is_break(0)


def passed(stamps):
    """Stamps that a filter lets through, in steps from the start."""
    order = StampFilter()
    return [s for s in stamps if not order.why_skipped(START + round(s * STEP))]


@pytest.mark.parametrize("wrong", [-START / STEP, -100.0, 2 * 3600 * 25, -3.0, -0.5])
def test_a_single_wrong_stamp_is_skipped(wrong):
    stamps = [0, 1, 2, 3, 3 + wrong, 5, 6, 7]
    assert passed(stamps) == [0, 1, 2, 3, 5, 6, 7]


@pytest.mark.parametrize("jump", [-1000.0, 90_000.0])
def test_a_jump_is_believed_from_the_second_frame(jump):
    assert passed([0, 1, 2, *(jump + i for i in range(4))]) == [0, 1, 2, jump + 1, jump + 2, jump + 3]


@pytest.mark.parametrize("period", [10.0, 100.0, 1000.0])
def test_slow_streams_pass_from_the_third_frame(period):
    stamps = [period * i for i in range(8)]
    assert passed(stamps)[-5:] == stamps[-5:] and len(passed(stamps)) >= 7


def test_a_silence_and_equal_stamps_pass():
    stamps = [0, 1, 1, 26, 27, 75, 76]
    assert passed(stamps) == stamps
