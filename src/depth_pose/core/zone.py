"""The zone that limits the people: a range of distances from the sensor, or a box in its frame."""

from __future__ import annotations

from dataclasses import dataclass

from depth_pose.core.errors import ConfigError

_INF = float("inf")
"""No limit."""
_AXES = {1: ("distance",), 2: ("x", "z"), 3: ("x", "y", "z")}
"""Names of the ranges, by the number of them in the text."""


@dataclass(frozen=True)
class Zone:
    """A region in the sensor's optical frame.

    Attributes
    ----------
    distance, x, y, z : (float, float)
        Least and greatest, metres; infinite where there is no limit.
    """

    distance: tuple[float, float] = (0.0, _INF)
    x: tuple[float, float] = (-_INF, _INF)
    y: tuple[float, float] = (-_INF, _INF)
    z: tuple[float, float] = (-_INF, _INF)

    def holds(self, x: float, y: float, z: float, slack: float = 0.0) -> bool:
        """Whether a point in the sensor's frame is inside, or outside by at most ``slack``; metres."""
        away = (x * x + y * y + z * z) ** 0.5
        ranges = ((away, self.distance), (x, self.x), (y, self.y), (z, self.z))
        return all([low - slack <= value <= high + slack for value, (low, high) in ranges])


def parse_zone(text: str) -> Zone:
    """Read a zone.

    Parameters
    ----------
    text : str
        ``1.0:4.5``, distances from the sensor; ``-1:1,0.5:3``, a box in x and z; or
        ``-1:1,-2:0.5,0.5:3``, in x, y and z; metres. A side left out has no limit (``:4.5``). Empty:
        everywhere.

    Raises
    ------
    ConfigError
        Where it is none of these.
    """
    if not text.strip():
        return Zone()
    parts = text.split(",")
    try:
        ranges = [_range(part) for part in parts]
        return Zone(**dict(zip(_AXES[len(parts)], ranges, strict=True)))
    except (KeyError, ValueError):
        raise ConfigError(
            f"zone is {text!r}; give a range of distances, 1.0:4.5, or a box, X0:X1,Z0:Z1 or "
            "X0:X1,Y0:Y1,Z0:Z1, in metres"
        ) from None


def _range(part: str) -> tuple[float, float]:
    low, high = (side.strip() for side in part.split(":"))
    found = (float(low) if low else -_INF, float(high) if high else _INF)
    if not found[0] < found[1]:
        raise ValueError
    return found
