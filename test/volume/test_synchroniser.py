"""Sets of views of several cameras: whole, late, gone, and back again."""

from depth_pose.volume.synchroniser import Synchroniser

STEP = 16_666_667


def synchroniser():
    return Synchroniser(3)


def feed(g, index, cameras=(0, 1, 2), now=None, skew_ns=0):
    for c in cameras:
        g.add(c, index * STEP + c * skew_ns, f"{c}:{index}", index * STEP / 1e9 if now is None else now)


def test_a_whole_set_is_given_at_once():
    g = synchroniser()
    feed(g, 0)
    views = g.take(0.0)
    assert views.images == ("0:0", "1:0", "2:0") and views.stamp_ns == 0
    assert g.take(0.0) is None


def test_skewed_stamps_are_one_set():
    g = synchroniser()
    feed(g, 5, skew_ns=1_500_000)
    assert g.take(0.1).images == ("0:5", "1:5", "2:5")


def test_a_late_camera_is_waited_for_a_little():
    g = synchroniser()
    feed(g, 0)
    g.take(0.0)
    now = STEP / 1e9
    feed(g, 1, (0, 2))
    assert g.take(now + 0.010) is None
    views = g.take(now + 0.0121)
    assert views.images == ("0:1", None, "2:1") and g.missing[1] == 1
    g.add(1, STEP, "1:1", now + 0.013)
    assert g.take(now + 0.1) is None and g.late[1] == 1


def test_a_camera_that_is_gone_is_not_waited_for():
    g = synchroniser()
    feed(g, 0)
    g.take(0.0)
    for i in range(1, 60):
        feed(g, i, (0, 1))
        now = i * STEP / 1e9
        views = g.take(now)
        if now > 0.52:  # half a second after the others went on without it
            assert views is not None and views.images[2] is None
            assert g.gone(now) == [2]
        elif views is None:
            assert g.take(now + 0.0125) is not None
    feed(g, 60)
    assert g.gone(1.0) == []
    assert g.take(1.0).images == ("0:60", "1:60", "2:60")


def test_the_newest_wins():
    g = synchroniser()
    for i in range(4):
        feed(g, i)
    assert g.take(0.1).stamp_ns == 3 * STEP
    assert g.overtaken == 3 and g.take(0.1) is None


def test_a_clock_that_goes_back_starts_anew():
    g = synchroniser()
    feed(g, 600)
    assert g.take(10.0) is not None
    feed(g, 0, now=10.1)
    assert g.take(10.1).stamp_ns == 0 and not g.late


def test_what_is_worth_a_short_wait():
    """A set that has just begun and lacks a camera that is there."""
    g = Synchroniser(2)
    assert not g.is_waiting and not g.is_fresh(0.0, 0.001)
    g.add(0, 10**9, "a", 1.0)
    assert g.is_fresh(1.0, 0.001) and not g.is_fresh(1.002, 0.001)
    g.add(1, 10**9, "b", 1.0)
    assert g.is_waiting and not g.is_fresh(1.0, 0.001)  # whole
    assert g.take(1.0).images == ("a", "b")
    assert not g.is_waiting
    g.add(0, 10**9 + 16_000_000, "c", 1.016)
    assert g.is_fresh(1.0165, 0.001)
    assert not g.is_fresh(1.0175, 0.001)  # no longer
    g.add(1, 10**9 + 16_500_000, "d", 1.0176)
    assert g.take(1.0176).images == ("c", "d")


def test_after_a_pause_of_all_cameras_none_is_gone():
    g = synchroniser()
    feed(g, 0)
    g.take(0.0)
    now = 5.0
    assert g.gone(now) == [0, 1, 2]
    g.add(0, 5 * 10**9, "a", now)
    assert g.take(now) is None  # the others are on their way
    g.add(1, 5 * 10**9, "b", now + 0.001)
    g.add(2, 5 * 10**9, "c", now + 0.002)
    assert g.take(now + 0.002).images == ("a", "b", "c")


def test_offline_every_set_is_given_in_turn():
    g = synchroniser()
    for i in (2, 0, 1):
        feed(g, i, (0, 1) if i == 1 else (0, 1, 2))
    assert [v.stamp_ns for v in g.take_all(2 * STEP)] == [0, STEP]
    assert g.missing == {2: 1} and g.overtaken == 0
    assert [v.images for v in g.take_all()] == [("0:2", "1:2", "2:2")]
    feed(g, 1)
    assert sum(g.late.values()) == 3 and not list(g.take_all())  # given already


def test_sets_in_turn():
    """As a lossless node takes them: none is let go, and a set that waits holds up those behind it."""
    g = synchroniser()
    feed(g, 0, (0, 2))
    for index in (1, 2):
        feed(g, index)
    now = 2 * STEP / 1e9
    assert g.take(0.001, newest=False) is None
    found = []
    while (views := g.take(now + 0.02, newest=False)) is not None:
        found.append(views.images[0])
    assert found == ["0:0", "0:1", "0:2"]
    assert g.overtaken == 0
