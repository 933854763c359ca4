"""What a node missed: told apart by when it came, or would have come."""

import itertools

import pytest

from depth_pose.ros.transport.losses import BUSY_TIMES_KEPT, BusyTimes, count_lost

PERIOD, DELAY = 33_000_000, 4_000_000


def message(number, offset_ns=0):
    """Build rclpy's info on a sensor's message; its clock may be another machine's."""
    sent = 10**18 + number * PERIOD
    return {
        "publication_sequence_number": number,
        "source_timestamp": sent + offset_ns,
        "received_timestamp": sent + DELAY,
    }


@pytest.mark.parametrize("offset_ns", [0, 5_000_000_000, -7_000_000_000], ids=["same", "ahead", "behind"])
def test_what_came_while_the_node_was_busy(offset_ns):
    busy = BusyTimes()
    begin = 10**18 + PERIOD + DELAY
    busy.add(begin, begin + 3 * PERIOD)  # busy with frame 1; 2 and 3 come meanwhile, and 4 wins
    assert count_lost(message(1, offset_ns), message(4, offset_ns), busy) == (2, 0)


@pytest.mark.parametrize("missing", [1, 5])
def test_what_never_came_to_a_node_that_waited(missing):
    busy = BusyTimes()
    begin = 10**18 + PERIOD + DELAY
    busy.add(begin, begin + PERIOD // 3)
    assert count_lost(message(1), message(missing + 2), busy) == (0, missing)


def test_both():
    busy = BusyTimes()
    begin = 10**18 + PERIOD + DELAY
    busy.add(begin, begin + int(1.5 * PERIOD))  # 2 comes within, 3 and 4 do not
    assert count_lost(message(1), message(5), busy) == (1, 2)


@pytest.mark.parametrize(("early_ns", "counts"), [(4_000_000, (1, 0)), (6_000_000, (0, 1))])
def test_what_came_just_before_a_busy_time_may_have_come_within(early_ns, counts):
    """Stamps of a transport are a few milliseconds off."""
    busy = BusyTimes()
    arrival = 10**18 + 2 * PERIOD + DELAY
    busy.add(arrival + early_ns, arrival + early_ns + 1_000_000)
    assert count_lost(message(1), message(3), busy) == counts


def test_nothing_is_missing_between_two_in_a_row():
    busy = BusyTimes()
    busy.add(0, 2 * 10**18)
    assert count_lost(message(1), message(2), busy) == (0, 0)


def test_only_the_last_busy_times_are_kept():
    busy = BusyTimes()
    for begin in itertools.islice(itertools.count(0, 10), 1000):
        busy.add(begin, begin + 5)
    oldest = 9990 - 10 * (BUSY_TIMES_KEPT - 1)
    assert busy.covers(9993) and busy.covers(oldest) and busy.covers(oldest + 5)
    assert not busy.covers(9997) and not busy.covers(oldest - 7) and not busy.covers(3)


def test_a_night_without_a_network_is_counted_and_not_gone_through():
    missing = 10**12  # looking at each would take a year
    assert count_lost(message(1), message(missing + 2), BusyTimes()) == (0, missing)
