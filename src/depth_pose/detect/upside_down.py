"""A hint that images are upside down: the floor is above the sensor, and nobody is found."""

from __future__ import annotations

from depth_pose.core.config import MountConfig, SegmentConfig
from depth_pose.core.mount import rotate_upright
from depth_pose.core.types import DepthFrame
from depth_pose.detect.floor import FloorFinder

_EVERY_NS = 1_000_000_000
"""Time between two looks (ns)."""

_LOOKS = 3
"""Looks with a floor above and none below after which it is said; set by hand."""

_MOST_LOOKS = 30
"""Looks at a stream at most, each about 20 ms; set by hand."""


class UpsideDownWatch:
    """Looks for a floor above the sensor as long as nobody was found.

    A mirrored image cannot be told from depth: it shows a mirrored room.

    Parameters
    ----------
    config : SegmentConfig
    setting : str
        The option or parameter that turns the image.
    """

    def __init__(self, config: SegmentConfig, setting: str) -> None:
        self._finder, self._setting = FloorFinder(config), setting
        self._looked_ns: int | None = None
        self._looks = self._above = 0

    def look(self, frame: DepthFrame, is_anybody: bool) -> None:
        """Take a frame into account.

        Parameters
        ----------
        frame : DepthFrame
            As the stages take it.
        is_anybody : bool
            Whether somebody was found in it.
        """
        if is_anybody:
            self._looks = _MOST_LOOKS
        last = self._looked_ns
        if self._looks >= _MOST_LOOKS or (last is not None and 0 <= frame.stamp_ns - last < _EVERY_NS):
            return
        self._looked_ns, self._looks = frame.stamp_ns, self._looks + 1
        is_below = self._finder.find(frame) is not None
        is_above = not is_below and self._finder.find(rotate_upright(frame, _TURNED)) is not None
        self._above = self._above + 1 if is_above else 0
        if self._above >= _LOOKS:
            self._looks = _MOST_LOOKS

    @property
    def hint(self) -> str:
        """What may be wrong, and what sets it; empty where nothing is."""
        if self._above < _LOOKS:
            return ""
        return (
            "the floor seems to be above the sensor, and nobody is found: the images may be upside down; "
            f"{self._setting} turns them"
        )


_TURNED = MountConfig(roll=180.0)
"""Of an image that is upside down."""
