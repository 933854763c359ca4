"""Messages of the matcher's results, with the people they are of."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from depth_pose_msgs.msg import Packed

from depth_pose.core.errors import InputError
from depth_pose.core.pose_match import Candidate, PoseMatch
from depth_pose.ros.messages.checks import check_numbers, check_people
from depth_pose.ros.messages.people import people_to_msg, read_people, text_of
from depth_pose.track.person_view import FramePeople

_MATCH = np.dtype([("body_id", "S64"), ("bank_id", "S64"), ("scale", "<f8"), ("count", "<u4")])
_CANDIDATE = np.dtype(
    [
        ("exemplar", "<u4"),
        ("view", "<u4"),
        ("rotation", "<f8", (3, 3)),
        ("translation", "<f8", 3),
        ("distance", "<f8"),
        ("score", "<f8"),
    ]
)
"""One match, and one of its candidates; those of all matches follow one another."""

MATCH_KINDS = (_MATCH, _CANDIDATE)
"""Types of the arrays of a match message behind those of its people."""


def matches_to_msg(matches: Sequence[PoseMatch], people: FramePeople) -> Packed:
    """Build the message of a frame's people and their matches."""
    records = np.array(
        [(m.body_id.encode(), m.bank_id.encode(), m.scale, len(m.candidates)) for m in matches], _MATCH
    )
    candidates = np.array(
        [
            (c.exemplar, c.view, c.rotation, c.translation, c.distance, c.score)
            for m in matches
            for c in m.candidates
        ],
        _CANDIDATE,
    )
    return people_to_msg(people, [records, candidates])


def msg_to_matches(message: Packed) -> tuple[FramePeople, tuple[PoseMatch, ...]]:
    """Return the people of a message and their matches, equal to those that were sent.

    Raises
    ------
    InputError
        If a number is not valid in a match.
    """
    people, (records, candidates) = read_people(message, MATCH_KINDS)
    ids, banks = text_of(records["body_id"]), text_of(records["bank_id"])
    check_people("matches", ids)
    for body_id, scale, count in zip(ids, records["scale"], records["count"], strict=True):
        if count and not 0.01 < scale < 100.0:
            raise InputError(f"the scale of {body_id} is {scale:g}")
    ends = np.cumsum(records["count"].astype(np.int64))
    if len(candidates) != (ends[-1] if len(ends) else 0):
        raise InputError(f"there are {len(candidates)} candidates, not {records['count'].sum()}")
    check_numbers("the place of a match", candidates["translation"])
    turns = candidates["rotation"]
    check_numbers("the turn of a match", turns, 1.1)
    lengths = np.linalg.norm(turns, axis=1)
    if not (np.abs(lengths - 1.0) < 0.1).all():
        raise InputError("the turn of a match is no rotation")
    parts = np.split(candidates, ends[:-1]) if len(ends) else []
    return people, tuple(
        PoseMatch(body_id, bank_id, float(scale), tuple(map(_candidate, part)))
        for body_id, bank_id, scale, part in zip(ids, banks, records["scale"], parts, strict=True)
    )


def _candidate(record: np.void) -> Candidate:
    return Candidate(
        exemplar=int(record["exemplar"]),
        view=int(record["view"]),
        rotation=record["rotation"].copy(),
        translation=record["translation"].copy(),
        distance=float(record["distance"]),
        score=float(record["score"]),
    )
