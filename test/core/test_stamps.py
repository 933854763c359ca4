"""When the past no longer applies."""

import pytest

from depth_pose.core.config import MAX_STAMP_GAP_NS
from depth_pose.core.stamps import StampGuard


@pytest.mark.parametrize(
    ("step_ns", "breaks"),
    [
        (40_000_000, False),
        (0, False),
        (MAX_STAMP_GAP_NS, False),
        (MAX_STAMP_GAP_NS + 1, True),
        (-1, True),
        (-(10**18), True),
    ],
)
def test_breaks(step_ns, breaks):
    guard = StampGuard()
    start = 1_700_000_000_000_000_000
    assert not guard.is_break(start)
    assert guard.is_break(start + step_ns) is breaks
    assert not guard.is_break(start + step_ns + 1)  # goes on from where it jumped to


def test_the_gap_is_half_a_second():
    assert MAX_STAMP_GAP_NS == 500_000_000


def test_the_first_frame_is_no_break_even_at_zero():
    assert not StampGuard().is_break(0)
