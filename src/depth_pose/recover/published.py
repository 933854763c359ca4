"""Whether a person is published: the one place where a found person may be withheld."""

from __future__ import annotations

from depth_pose.track.state import Evidence

_FRAME_SHARE = 0.25
"""Share of each frame in the mean distance of fitted poses."""

_FARTHEST = 1.6
"""Pose distance (standard deviations) from which a frame says no more: one bad fit hides nobody."""

_SURE = 0.75
"""Person probability from which somebody is published even if the fit is refused."""

_STAYS = 0.7
"""Share of the least probability above which somebody who was published stays so."""


def is_published(probability: float, was_published: bool, is_refused: bool, least: float) -> bool:
    """Decide whether a person is published.

    Parameters
    ----------
    probability : float
        That this is a person, from detections, motion and fits (`depth_pose.track.person_odds`), 0 to 1.
    was_published : bool
        In the frame before.
    is_refused : bool
        Whether the frame's fit is refused, with nothing to replace it.
    least : float
        `RecoverConfig.min_probability`.
    """
    if is_refused:
        return probability >= _SURE
    return probability >= (_STAYS * least if was_published else least)


def renew_distance(evidence: Evidence, pose_distance: float) -> float:
    """Update the mean distance of a person's fitted poses from the bank's."""
    pose_distance = min(pose_distance, _FARTHEST)
    if evidence.pose_distance is None:
        return pose_distance
    return evidence.pose_distance + _FRAME_SHARE * (pose_distance - evidence.pose_distance)
