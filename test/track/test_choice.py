"""Who is served: in the zone, the nearest few, and not by turns."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.core.config import SegmentConfig
from depth_pose.core.errors import ConfigError
from depth_pose.core.mount import rotation_sensor_upright
from depth_pose.core.options import options
from depth_pose.core.zone import Zone, parse_zone
from depth_pose.track.choice import PeopleChoice

NAMES = ("near", "middle", None, "far")
PLACES = [np.array(p) for p in ([0.5, 0.0, 1.5], [-1.0, 0.2, 3.0], [0.0, 0.0, 1.0], [0.0, 0.0, 6.0])]


def make(zone: str = "", most: int = 0, roll: float = 0.0) -> PeopleChoice:
    return PeopleChoice(parse_zone(zone), most, rotation_sensor_upright(roll))


@pytest.mark.parametrize(
    ("text", "inside", "outside"),
    [
        ("1.0:4.5", [(0, 0, 1.1), (3, 0, 3)], [(0, 0, 0.9), (3.2, 0, 3.2)]),
        (":4.5", [(0, 0, 0.1)], [(0, 0, 4.6)]),
        ("2:", [(0, 0, 99)], [(1, 1, 1)]),
        ("-1:1,0.5:3", [(-0.9, 50, 0.6)], [(-1.1, 0, 1), (0, 0, 3.1)]),
        (" -1:1 , -2:0.5 , : ", [(0, 0, 99)], [(0, 0.6, 1)]),
        ("", [(9, -9, 99)], []),
    ],
)
def test_zones(text: str, inside: list, outside: list) -> None:
    zone = parse_zone(text)
    assert all(zone.holds(*point) for point in inside)
    assert not any(zone.holds(*point) for point in outside)


@pytest.mark.parametrize("text", ["4.5", "4:1", "a:b", "1:2:3", "1:2,", "1:2,3:4,5:6,7:8", "nan:1"])
def test_bad_zones_are_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="range of distances"):
        SegmentConfig(zone=text)


def test_everybody_by_default() -> None:
    defaults = {o.name: o.default for o in options(SegmentConfig)}
    assert parse_zone(defaults["zone"]) == Zone()
    assert make(defaults["zone"], defaults["most_people"]).choose(NAMES, PLACES) == NAMES


def test_who_is_outside_is_ignored_and_counted() -> None:
    choice = make("1:4.5")
    assert choice.choose(NAMES, PLACES) == ("near", "middle", None, None)
    assert choice.left_out == {"outside the zone": 1, "beyond the most": 0}


def test_the_nearest_are_served() -> None:
    choice = make(most=1)
    assert choice.choose(NAMES, PLACES) == ("near", None, None, None)
    assert choice.choose(NAMES[::-1], PLACES[::-1]) == (None, None, None, "near")
    assert choice.left_out["beyond the most"] == 2


def test_the_zone_is_in_the_sensors_frame() -> None:
    """A sensor upside down: what is on its left in the upright image is on its right."""
    left = [np.array([-1.0, 0.0, 2.0])]
    assert make("-2:0,0:9").choose(["a"], left) == ("a",)
    assert make("-2:0,0:9", roll=180.0).choose(["a"], left) == (None,)


def test_people_on_the_border_do_not_come_and_go() -> None:
    choice = make("1:3", most=1)
    walk = [2.9, 3.1, 2.95, 3.15, 3.3, 3.1, 2.9]
    served = [choice.choose(["a"], [np.array([0, 0, z])])[0] for z in walk]
    assert served == ["a", "a", "a", "a", None, None, "a"]
    two = (["a", "b"], [np.array([0, 0, 2.9]), np.array([0, 0, 2.8])])
    assert choice.choose(*two) == ("a", None)  # b is nearer, but not by much
    choice.reset()
    assert choice.choose(*two) == (None, "b")
