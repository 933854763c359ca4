"""Colours of people, joints and points; red, green, blue, 0 to 255."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_PEOPLE = np.array(
    [
        (66, 135, 245),
        (240, 138, 36),
        (122, 201, 67),
        (214, 84, 178),
        (36, 193, 188),
        (235, 200, 50),
        (150, 110, 235),
        (235, 95, 85),
    ],
    np.uint8,
)
"""Colours of people by number, repeated from the first; for readability."""
_DOUBT, _HALF, _SURE = np.array([215, 48, 39]), np.array([254, 224, 90]), np.array([26, 190, 90])
"""Colours of confidences 0, one half and 1; for readability."""
_NEAR, _FAR = np.array([196, 201, 210]), np.array([74, 82, 96])
"""Greys of the nearest and of the farthest points; for readability."""
_SPAN_M = (1.0, 6.0)
"""Range of distances over which points go from light to dark. It suits rooms."""


def of_person(body_id: str) -> NDArray[np.uint8]:
    """Colour of a person, by the number that their id ends with: the same while they are followed."""
    digits = body_id.rpartition("_")[2]
    number = int(digits) if digits.isdigit() else sum(body_id.encode())
    colour: NDArray[np.uint8] = _PEOPLE[number % len(_PEOPLE)]
    return colour


def of_confidence(confidence: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Red over yellow to green of confidences (N,), 0 to 1; (N, 3)."""
    share = np.clip(np.nan_to_num(confidence), 0, 1)[:, None]
    low = _DOUBT + np.minimum(2 * share, 1) * (_HALF - _DOUBT)
    return np.asarray(np.where(share < 0.5, low, _HALF + (2 * share - 1) * (_SURE - _HALF))).astype(np.uint8)


def of_distance(points: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Grey of points (N, 3) by their distance along the optical axis; (N, 3)."""
    share = np.clip((points[:, 2:] - _SPAN_M[0]) / (_SPAN_M[1] - _SPAN_M[0]), 0, 1)
    return np.asarray(_NEAR + share * (_FAR - _NEAR)).astype(np.uint8)


def as_light(colour: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Convert screen colours (sRGB) to linear light, which lines and repeated shapes need."""
    light = np.power(colour / 255.0, 2.2)
    return np.asarray(np.rint(255 * light)).astype(np.uint8)
