"""Checks of messages between nodes: duplicate people, invalid ids, impossible numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from depth_pose.core.errors import InputError

_BODY_ID = re.compile("[A-Za-z0-9_]{1,64}")
"""Ids allowed in names of ROS topics and tf2 frames; the denoise node's are ``body_NUMBER``."""

MOST_PEOPLE = 255
"""Maximum number of people in a frame: their labels in the points are 1 to 255."""

FARTHEST_M = 1e3
"""Maximum distance, metres; no depth sensor sees farther, and larger numbers overflow when squared."""


def check_people(what: str, body_ids: Sequence[str]) -> None:
    """Refuse a message with invalid people, before it is read.

    There may be no more people than labels, no duplicates, and only ids valid in names of frames and topics.

    Raises
    ------
    InputError
    """
    if len(body_ids) > MOST_PEOPLE:
        raise InputError(f"the {what} are of {len(body_ids)} people; at most {MOST_PEOPLE} can be in a frame")
    if len(set(body_ids)) < len(body_ids):
        twice = next(b for i, b in enumerate(body_ids) if b in body_ids[:i])
        raise InputError(f"the {what} have {twice!r} twice")
    odd = [b for b in body_ids if not _BODY_ID.fullmatch(b)]
    if odd:
        raise InputError(
            f"the {what} have the id {odd[0][:80]!r}; an id is of letters, digits and _, 1 to 64 of them"
        )


def check_shares(what: str, numbers: ArrayLike) -> NDArray[np.float32]:
    """Return confidences or probabilities as an array.

    Raises
    ------
    InputError
        If one is NaN or not 0 to 1.
    """
    array = np.asarray(numbers, np.float32)
    is_good = (array >= 0.0) & (array <= 1.0)
    if not is_good.all():
        raise InputError(f"{what} has the confidence {array[~is_good].ravel()[0]:g}; it is 0 to 1")
    return array


def check_numbers(what: str, numbers: ArrayLike, most: float = FARTHEST_M) -> NDArray[np.float64]:
    """Return numbers as an array.

    Raises
    ------
    InputError
        If one is NaN or impossibly large.
    """
    array = np.asarray(numbers, np.float64)
    if not (np.abs(array) <= most).all():
        odd = array.ravel()[~(np.abs(array.ravel()) <= most)][0]
        raise InputError(f"{what} has the number {odd:g}")
    return array
