"""Limits of the sizes of images and clouds, for readers, nodes and cameras."""

from __future__ import annotations

from depth_pose.core.errors import InputError

MAX_SIDE = 8192
"""Maximum rows or columns of an image or cloud."""

MAX_PIXELS = 16_777_216
"""Maximum pixels of an image, or points of a cloud: 4096 x 4096."""

_MOST_ELONGATED = 16
"""Maximum ratio of an image's sides; a frame of 8192 x 2 pixels would take 20 s."""


def check_size(what: str, height: int, width: int, max_width: int = MAX_SIDE) -> None:
    """Refuse images and clouds that are empty or too large."""
    if height < 1 or width < 1:
        raise InputError(f"{what} is empty: width is {width}, height is {height}")
    if height > MAX_SIDE or width > max_width or height * width > MAX_PIXELS:
        raise InputError(
            f"{what} is too large: width is {width}, height is {height}; "
            f"the maximum is {max_width} x {MAX_SIDE} and {MAX_PIXELS} in all"
        )


def check_shape(what: str, height: int, width: int) -> None:
    """Refuse images that are too elongated for a camera."""
    if max(height, width) > _MOST_ELONGATED * min(height, width):
        raise InputError(
            f"{what}: width is {width}, height is {height}; the sides of a camera "
            f"image differ by at most a factor of {_MOST_ELONGATED}"
        )
