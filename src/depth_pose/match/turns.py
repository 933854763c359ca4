"""Carry matched exemplars along between searches.

A match is a start for the fit, which itself turns arms and legs to the measured joints; a
search in every frame is needed only for people who do not keep their pose. A matched person keeps the
candidates for some frames, moved along with the person's points. Searches for several people are spread over
the frames: the first interval may be shorter, so that people with consecutive ids take turns.
"""

from __future__ import annotations

from dataclasses import replace

from depth_pose.core.pose_match import PoseMatch
from depth_pose.core.stamps import MAX_REUSE_NS
from depth_pose.track.person_view import PersonView
from depth_pose.track.state import Schedule

_CALM_TIMES = 3
"""Searches for a calm person are rarer by this factor."""


def carry(
    schedule: Schedule, person: PersonView, scale: float, every: int
) -> tuple[Schedule, PoseMatch | None]:
    """Count a frame of a person; return the last match moved along, None where a search is due.

    Parameters
    ----------
    schedule : Schedule
    person : PersonView
    scale : float
        Current estimate of the size.
    every : int
        Frames from one search to the next.
    """
    if schedule.match is None:
        return schedule, None
    times = _CALM_TIMES if person.found.is_calm else 1  # what was found still holds
    age = schedule.match_age + 1
    if age >= times * every or person.stamp_ns - schedule.match_ns > times * MAX_REUSE_NS:
        return schedule._replace(match_age=0), None
    shift = person.centre - schedule.match_centre
    candidates = (replace(c, translation=c.translation + shift) for c in schedule.match.candidates)
    moved = replace(schedule.match, scale=scale, candidates=tuple(candidates))
    return schedule._replace(match_age=age), moved


def keep(schedule: Schedule, person: PersonView, match: PoseMatch, every: int) -> Schedule:
    """Return the schedule with the result of a search."""
    age = sum(person.body_id.encode()) % every if schedule.match is None else schedule.match_age
    return schedule._replace(match=match, match_age=age, match_ns=person.stamp_ns, match_centre=person.centre)
