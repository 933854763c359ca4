"""Selection of the people that later steps process: those in the zone, and of these the nearest."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.rotations import length_of
from depth_pose.core.zone import Zone

_SLACK_M = 0.2
"""Tolerance (m) outside the zone, or beyond a nearer person, for people who are already processed.

It keeps people on the border, or two at the same distance, from alternating. Set by hand: a person's centre
moves by half of it from frame to frame when limbs are hidden.
"""


class PeopleChoice:
    """Selects the people that the user wants.

    Parameters
    ----------
    zone : Zone
    most : int
        Maximum number of people, the nearest; 0 for all.
    R_sensor_upright : (3, 3) float64
        Rotation from the frame of the places to the sensor's.

    Attributes
    ----------
    left_out : Counter of str
        Numbers excluded in the last frame: ``outside the zone`` and ``beyond the most``.
    """

    def __init__(self, zone: Zone, most: int, R_sensor_upright: NDArray[np.float64]) -> None:
        self._zone, self._most, self._rotation = zone, most, R_sensor_upright
        self.left_out: Counter[str] = Counter()
        self.reset()

    def reset(self) -> None:
        """Forget the current selection."""
        self._served: frozenset[str] = frozenset()

    def choose(
        self, names: Sequence[str | None], places: Sequence[NDArray[np.float64]]
    ) -> tuple[str | None, ...]:
        """Replace the ids of excluded people by None.

        Parameters
        ----------
        names : sequence of str or None
            Body ids; None for detections without a track.
        places : sequence of (3,) float64
            Their places, metres.
        """
        self.left_out = Counter()
        distances = {}
        for name, place in zip(names, places, strict=True):
            if name is None:
                continue
            slack = _SLACK_M if name in self._served else 0.0
            x, y, z = (self._rotation @ place).tolist()
            if self._zone.holds(x, y, z, slack):
                distances[name] = length_of(place) - slack
            else:
                self.left_out["outside the zone"] += 1
        nearest = sorted(distances, key=distances.__getitem__)[: self._most or None]
        self.left_out["beyond the most"] += len(distances) - len(nearest)
        self._served = frozenset(nearest)
        return tuple(name if name in self._served else None for name in names)
