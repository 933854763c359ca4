"""Schedule of the joint net: who moves is measured, who is calm keeps the last measurement for a while.

A person is calm while hardly any of their surface has moved since they were measured. Whoever begins to move
is measured in that frame. Of more than two people who move, some take turns: their last measurements are
reused if they were confirmed a moment ago and have not moved away, and count as less exact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.rotations import length_of
from depth_pose.core.stamps import MAX_REUSE_NS
from depth_pose.core.threads import ONE_THREAD, Threads
from depth_pose.detect import _motion_kernels as kernels
from depth_pose.detect.candidates import Candidates
from depth_pose.detect.finder import TorsoDetection

_MOVED_M, _APART_M = 0.15, 0.4
"""Maximum movement (m) of the same person, and least distance (m) of another person."""

_STALE_M = 0.08
"""Standard deviation added to a reused measurement's, metres: limbs move by this. Chosen on the same
recordings of .04, .08 and .2."""

_SURE = 0.9
"""Minimum person probability of a measurement that is reused, or followed by a quick one."""

_WELL_M = 0.08
"""Largest deviation (m), in the image plane, of any joint of somebody who was measured well. In 484 looks of
eleven development recordings joints of the thorough net are 26 mm off where all deviations are below .04, 46
to .06, 60 to .08, 55 to .12 and 86 above; of the quick net 28, 46, 57, 58 and 93."""

_CHANGE_M = 0.04
"""Minimum change of depth of surface that has moved, metres."""


class CalmRule(NamedTuple):
    """Who counts as calm.

    Attributes
    ----------
    moved_m2, moved_first_m2 : float
        Maximum moved area (`depth_pose.detect._motion_kernels.moved_area`), and the same in the frame after
        a measurement, m^2.
    """

    moved_m2: float
    moved_first_m2: float


class Pace(NamedTuple):
    """Who is measured anew.

    Attributes
    ----------
    most_fresh : int
        Number of moving people measured in every frame; others take turns.
    calm : CalmRule or None
        Who keeps the last measurement; None: nobody.
    has_quick_net : bool
        Whether people who were measured well are measured by the quick net next.
    """

    most_fresh: int
    calm: CalmRule | None
    has_quick_net: bool


_PACES = {
    "low": Pace(2, None, False),
    "normal": Pace(2, CalmRule(0.0005, 0.0005), False),
    "high": Pace(0, CalmRule(0.001, 0.025), True),
}
"""The pace of each speed. On the development recordings with several people the error falls from 25.0 to
24.0 mm with two fresh measurements in place of one, and to 23.8 mm without turns. With the normal rule, of
2,160 pairs of frames of forty simulated people, those whose joints move by less than 20 mm are calm in 95 %
with time of flight and in 99 % with structured light, by 50 to 80 mm in 9 and 0 %, by more in .4 and 0 %. At
high speed an arm may move in the first frame."""

_CALM_STALE_M = 0.02
"""Standard deviation added to a calm person's measurement (m), in each frame in which it is kept."""

_CALM_NS, _CALM_FRAMES = 200_000_000, 2
"""Maximum age of a calm person's measurement (ns, frames). With five frames the error is 2 % larger on thirty
simulated clips and 4 % on development postures, and a frame takes no less time."""


@dataclass(frozen=True)
class Look:
    """The measurement of a person in use.

    Attributes
    ----------
    torso : (3,) float64
        Place in the last frame, metres.
    seen : JointMeasurement
        As measured, and moved with the person since.
    stamp_ns : int
        Of the frame in which it was measured.
    age : int
        Frames since then.
    frame : Candidates
        The image in which it was measured.
    label : int
        The person's label there.
    is_good : bool
        Whether the person was measured well: probably a person, no joint doubtful.
    is_calm : bool
        Whether hardly anything of the person has moved since.
    """

    torso: NDArray[np.float64]
    seen: JointMeasurement
    stamp_ns: int
    age: int
    frame: Candidates
    label: int
    is_good: bool = False
    is_calm: bool = False


class JointNetSchedule:
    """Decides who is measured, and keeps the last measurements of the previous frame's people.

    Parameters
    ----------
    every : int
        Frames between two measurements of a person who moves, where they take turns.
    speed : str
        `depth_pose.core.config.SegmentConfig.speed`.

    Attributes
    ----------
    pace : Pace
    """

    def __init__(self, every: int, speed: str = "normal") -> None:
        self._every, self.pace = every, _PACES[speed]
        self.reset()

    def reset(self) -> None:
        """Forget all people."""
        self._looks: list[Look] = []

    @property
    def is_calm(self) -> bool:
        """Whether everybody in the last frame was calm, and somebody was there."""
        return bool(self._looks) and all(look.is_calm for look in self._looks)

    def renew(
        self,
        found: Candidates,
        stamp_ns: int,
        measure: Callable[[TorsoDetection, NDArray[np.float64] | None], JointMeasurement],
        threads: Threads = ONE_THREAD,
    ) -> list[Look]:
        """Measure the people who move and whose turn it is, and reuse the last measurements of the others.

        Parameters
        ----------
        found : Candidates
            All people in the frame.
        stamp_ns : int
        measure : callable
            Measures one person. The joints (19, 3) of the last measurement, moved with the person, are given
            if it was a good one.
        threads : Threads
            Measure several people.

        Returns
        -------
        list of Look
            One for each person.
        """
        people = found.people
        before = [self._before(person) for person in people]
        calm = {
            n for n, last in enumerate(before) if last and self._is_calm(last, people[n], found, stamp_ns)
        }
        resting = sorted(
            (last.age, n)
            for n, last in enumerate(before)
            if last is not None and n not in calm and self._may_rest(last, stamp_ns)
        )
        spare = max(0, self.pace.most_fresh - (len(people) - len(calm) - len(resting)))
        # the oldest measurements are renewed first
        rests = {n for _, n in resting[: max(0, len(resting) - spare)]}
        looks, kept = [], calm | rests
        measured = iter(
            threads.map(
                lambda n: measure(people[n], _expected(people[n], before[n])),
                [n for n in range(len(people)) if n not in kept],
            )
        )
        for n, person in enumerate(people):
            last = before[n]
            if last is not None and n in kept:
                stale_m = _CALM_STALE_M if n in calm else _STALE_M
                moved = last.seen.moved(person.torso - last.torso, stale_m)
                looks.append(
                    replace(last, torso=person.torso, seen=moved, age=last.age + 1, is_calm=n in calm)
                )
            else:
                # the first interval varies, so that not all people are measured in the same frames
                age, seen = 0 if last is not None else n % self._every, next(measured)
                is_good = is_measured_well(seen)
                looks.append(Look(person.torso, seen, stamp_ns, age, found, person.label, is_good))
        self._looks = looks
        return looks

    def _before(self, person: TorsoDetection) -> Look | None:
        """Return the last measurement of a person; None if no one, or more than one, was near that place."""
        near = [k for k in self._looks if length_of(k.torso - person.torso) < _APART_M]
        alone = len(near) == 1 and length_of(near[0].torso - person.torso) < _MOVED_M
        return near[0] if alone else None

    def _may_rest(self, last: Look, stamp_ns: int) -> bool:
        is_recent = 0 < stamp_ns - last.stamp_ns <= MAX_REUSE_NS
        return is_recent and last.age + 1 < self._every and last.seen.probability >= _SURE

    def _is_calm(self, last: Look, person: TorsoDetection, found: Candidates, stamp_ns: int) -> bool:
        rule = self.pace.calm
        is_recent = 0 < stamp_ns - last.stamp_ns <= _CALM_NS and last.age < _CALM_FRAMES
        if (
            rule is None
            or not is_recent
            or last.seen.probability < _SURE
            or last.frame.camera != found.camera
        ):
            return False
        then = (last.frame.depth, last.frame.labels, last.label)
        now = (found.depth, found.labels, person.label)
        area = kernels.moved_area(*then, *now, found.camera, _CHANGE_M)
        return bool(area < (rule.moved_m2 if last.age else rule.moved_first_m2))


def _expected(person: TorsoDetection, last: Look | None) -> NDArray[np.float64] | None:
    """Return a person's joints as last measured, moved with them, if that measurement was a good one."""
    if last is None or not last.is_good:
        return None
    return last.seen.places + (person.torso - last.torso)


def is_measured_well(seen: JointMeasurement) -> bool:
    """Check that it is probably a person, none of whose joints is doubtful."""
    return seen.probability >= _SURE and float(seen.sigma[:, 0].max()) < _WELL_M
