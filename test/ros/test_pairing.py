from depth_pose.ros.nodes.statistics import NodeStatistics
from depth_pose.ros.transport.pairing import Pairer


def make(ordered=True, capacity=3):
    drops = []
    return Pairer(2, capacity, drops.append, ordered=ordered), drops


def test_pairs_by_exact_stamp():
    pairer, drops = make()
    assert pairer.add(0, 10, "a") is None
    assert pairer.add(1, 11, "B") is None
    assert pairer.add(1, 10, "A") == ("a", "A")
    assert pairer.add(0, 11, "b") == ("b", "B")
    assert not len(pairer) and not drops


def test_complete_set_drops_those_before_it_only():
    pairer, drops = make()
    pairer.add(0, 1, "a")
    pairer.add(0, 2, "b")
    pairer.add(0, 3, "c")
    assert pairer.add(1, 2, "B") == ("b", "B")
    assert drops == [1] and len(pairer) == 1
    assert pairer.add(1, 3, "C") == ("c", "C")


def test_unordered_keeps_all():
    pairer, drops = make(ordered=False)
    pairer.add(0, 1, "a")
    pairer.add(0, 2, "b")
    assert pairer.add(1, 2, "B") == ("b", "B")
    assert pairer.add(1, 1, "A") == ("a", "A")
    assert not drops


def test_holds_a_bounded_number():
    pairer, drops = make(capacity=3)
    for stamp in range(100):
        pairer.add(0, stamp, stamp)
        assert len(pairer) <= 3
    assert sum(drops) == 97
    assert pairer.add(1, 0, "late") is None
    assert pairer.add(1, 99, "A") == (99, "A")


def test_order_is_that_of_arrival_where_stamps_jump_back():
    pairer, drops = make()
    pairer.add(0, 900, "old")
    pairer.add(0, 5, "new")
    assert pairer.add(1, 5, "NEW") == ("new", "NEW")
    assert drops == [1] and not len(pairer)


def test_node_statistics():
    statistics = NodeStatistics()
    for i in range(20):
        statistics.answer(0.010, 0.020 if i else 1e9)
    statistics.drop("overtaken", 3)
    text = statistics.as_text()
    assert text["answered"] == "20" and text["dropped"] == "3" and text["dropped: overtaken"] == "3"
    assert text["process_ms_median"] == "10.0" and text["latency_ms_p95"] == "20.0"
    assert statistics.new_drops() == {"overtaken": 3} and not statistics.new_drops()
    statistics.answer(0.010, -4.0)  # a stamp of another clock: its latency means nothing
    assert statistics.as_text()["latency_ms_median"] == "unknown"
