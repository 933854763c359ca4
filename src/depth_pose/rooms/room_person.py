r"""A person of the room: each camera's last view of them, their velocity and size.

The gain (nats) of linking a camera's sighting to a person is a log-likelihood ratio against a newcomer,

.. math::

    g = -\log(2 \pi s^2 \nu) - \frac{d^2}{2 s^2} - \frac{1}{2} \Big(\frac{\Delta}{\sigma}\Big)^2
        + b\,[\text{the camera's id is linked to this person}]

with the distance :math:`d` of the trunks (median over joints that both know, horizontal) to where the *other*
cameras see the person, or to where the person was seen last, moved by their velocity; the spread :math:`s`,
which grows with the time since; the density :math:`\nu` of newcomers; and the difference :math:`\Delta` of
the logarithms of size. That accepts a distance of 0.5 m, 2 m after five seconds unseen, and 0.8 m for ids
that are linked already.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from depth_pose.rooms.sightings import RoomSighting

FRESH_NS = 300_000_000
"""Maximum age of a sighting that gives a person's current position (ns); set by hand."""

_SPREAD_M, _SPREAD_M_S = 0.155, 0.16
"""Spread of a person's position between cameras (m), and its growth while unseen (m/s). With `_NEWCOMERS`, it
accepts distances up to 0.5 m at once and up to 2 m after five seconds; set by hand."""

_NEWCOMERS = 0.02
"""Density of newcomers, 1/m^2; set by hand."""

_LINKED = 7.5
"""Log-odds (nats) that a camera keeps its id for one person: 0.8 m are accepted; set by hand."""

_ALONE = 40.0
"""The same where no other camera sees the person and this one saw them a moment ago; set by hand."""

_SIZE_SD, _WORST_SIZE = 0.1, -4.0
"""Spread of the logarithm of size, and the minimum of its term (nats); set by hand."""

_SIZE_SHARE = 0.05
"""Weight of a new size in the running one; set by hand."""

_SURE, _TRUST_SHARE = 0.3, 0.1
"""Minimum of the running mean of confidences of a person whom only one camera has seen, and the weight of a
new one; set by hand on simulated rooms."""

_FASTEST_M_S, _COASTING_S = 3.0, 0.7
"""Maximum speed of a person (m/s), and time constant (s) with which an unseen person stops; set by hand."""

_VELOCITY_SHARE, _VELOCITY_S = 0.2, 0.04
"""Weight of a new velocity in a frame, and the length of that frame (s); set by hand."""


@dataclass(frozen=True, eq=False)
class View:
    """The last sighting of a person by one camera."""

    stamp_ns: int
    sighting: RoomSighting


@dataclass(eq=False)
class RoomPerson:
    """One person in the room, with each camera's last view.

    Attributes
    ----------
    number : int
        Number in the id; older people have smaller ones.
    views : dict of int to View
        By the camera's number.
    velocity : (3,) float64
        Room frame, m/s.
    log_size : float or None
        Logarithm of the size relative to the bank's body.
    split_from : RoomPerson or None
        The person that a camera had confused with this one until then.
    shared : bool
        Whether two cameras have seen them at once.
    trust : float
        Running mean of the sightings' confidences.
    """

    number: int
    views: dict[int, View] = field(default_factory=dict)
    velocity: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    log_size: float | None = None
    split_from: RoomPerson | None = None
    shared: bool = False
    trust: float = 0.0

    @property
    def room_id(self) -> str:
        """The id in the room."""
        return f"person_{self.number}"

    @property
    def seen_ns(self) -> int:
        """Stamp of the last sighting by any camera."""
        return max((view.stamp_ns for view in self.views.values()), default=0)

    @property
    def is_sure(self) -> bool:
        """Whether this is a person with enough confidence, not an object that one camera mistakes for one."""
        return self.shared or self.trust >= _SURE

    def offset(self, view: View, stamp_ns: int) -> NDArray[np.float64]:
        """Return the displacement (3,), metres, from a view to a stamp; an unseen person comes to rest."""
        span = (stamp_ns - view.stamp_ns) * 1e-9
        if span > 0.0:
            span = _COASTING_S * (1.0 - math.exp(-span / _COASTING_S))
        return self.velocity * span

    def fresh(self, stamp_ns: int, without: int = -1) -> list[View]:
        """Return the recent views of all cameras but one."""
        return [v for c, v in self.views.items() if c != without and abs(stamp_ns - v.stamp_ns) <= FRESH_NS]

    def has(self, camera: int, body_id: str) -> bool:
        """Whether a camera's id is linked to this person."""
        return camera in self.views and self.views[camera].sighting.body_id == body_id

    def is_in(self, camera: int, stamp_ns: int) -> bool:
        """Whether a camera's frame of a stamp shows this person."""
        return camera in self.views and self.views[camera].stamp_ns == stamp_ns

    def distance(self, sighting: RoomSighting, views: Sequence[View], stamp_ns: int) -> float:
        """Return the distance (m) of a sighting from the nearest of some views of the person."""
        return min(sighting.distance(v.sighting, self.offset(v, stamp_ns)) for v in views)

    def gain(self, camera: int, stamp_ns: int, sighting: RoomSighting) -> float:
        """Compute the gain (nats) of linking a sighting to this person."""
        linked, others = self.has(camera, sighting.body_id), self.fresh(stamp_ns, without=camera)
        last = min(self.views.values(), key=lambda v: abs(stamp_ns - v.stamp_ns))
        unseen_s = 0.0 if others else abs(stamp_ns - last.stamp_ns) * 1e-9
        spread = _SPREAD_M + _SPREAD_M_S * unseen_s
        distance = self.distance(sighting, others or [last], stamp_ns)
        gain = -math.log(2.0 * math.pi * spread**2 * _NEWCOMERS) - 0.5 * (distance / spread) ** 2
        if self.log_size is not None and sighting.scale > 0.0:
            apart = (math.log(sighting.scale) - self.log_size) / _SIZE_SD
            gain += max(-0.5 * apart**2, _WORST_SIZE)
        if not linked:
            return gain
        alone = not others and abs(stamp_ns - self.views[camera].stamp_ns) <= FRESH_NS
        return max(gain, 0.0) + _ALONE if alone else gain + _LINKED

    def see(self, camera: int, stamp_ns: int, sighting: RoomSighting) -> None:
        """Update with a sighting; the velocity comes from pairs of views by the same camera."""
        last = self.views.get(camera)
        if last is not None and last.sighting.body_id == sighting.body_id:
            seconds = (stamp_ns - last.stamp_ns) * 1e-9
            if 0.0 < seconds <= FRESH_NS * 1e-9:
                self._steer(last.sighting.shift_to(sighting) / seconds, seconds)
        share = _TRUST_SHARE if self.views else 1.0
        self.trust += share * (sighting.confidence - self.trust)
        self.shared |= bool(self.fresh(stamp_ns, without=camera))
        self.views[camera] = View(stamp_ns, sighting)
        if sighting.scale > 0.0:
            size = math.log(sighting.scale)
            before = size if self.log_size is None else self.log_size
            self.log_size = before + _SIZE_SHARE * (size - before)

    def _steer(self, velocity: NDArray[np.float64], seconds: float) -> None:
        """Update the velocity (3,), m/s, with one measured over some seconds."""
        share = 1.0 - (1.0 - _VELOCITY_SHARE) ** (seconds / _VELOCITY_S)
        self.velocity = self.velocity + share * (velocity - self.velocity)
        self.velocity *= min(1.0, _FASTEST_M_S / max(float(np.linalg.norm(self.velocity)), 1e-6))

    def sees_with(self, other: RoomPerson, stamp_ns: int) -> bool:
        """Whether a camera shows both in one recent frame."""
        return any(
            other.is_in(camera, view.stamp_ns)
            for camera, view in self.views.items()
            if abs(stamp_ns - view.stamp_ns) <= FRESH_NS
        )
