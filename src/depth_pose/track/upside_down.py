"""Images that look upside down: the floor is above the camera, and people stand on it or nobody is found."""

from __future__ import annotations

from depth_pose.core.config import MountConfig, SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.core.mount import rotate_upright
from depth_pose.detect.floor import FloorFinder, stands_on
from depth_pose.track.person_view import FramePeople

_HALF_TURN = MountConfig(roll=180.0)

_DROP_M = (0.5, 2.5)
"""Range of the camera's distance (m) from a floor above it. Set by hand."""

_FEWEST = 3
"""Looks after which images are called upside down. Set by hand."""


class UpsideDownWatch:
    """Checks some frames of a stream for people who stand on a plane above the camera.

    Frames 1, 2, 4, 8 and so on are looked at, so that it costs nothing over time.

    Parameters
    ----------
    config : SegmentConfig
        Settings of the working grid.
    """

    def __init__(self, config: SegmentConfig) -> None:
        self._below, self._above = FloorFinder(config), FloorFinder(config)
        self.reset()

    def reset(self) -> None:
        """Forget all earlier frames."""
        self._frames = self._looks = self._doubtful = 0

    def look(self, frame: DepthFrame, people: FramePeople) -> None:
        """Add a frame.

        Parameters
        ----------
        frame : DepthFrame
            As it is processed: of a sensor with a known roll, turned upright.
        people : FramePeople
            The people found in it.
        """
        self._frames += 1
        if self._frames & (self._frames - 1):
            return
        self._looks += 1
        above = self._above.find(rotate_upright(frame, _HALF_TURN))
        if above is None or not _DROP_M[0] < above.height < _DROP_M[1]:
            return
        below = self._below.find(frame)
        points = [person.points for person in people.persons]
        if not points:
            self._doubtful += below is None
        elif any(stands_on(p * [-1.0, -1.0, 1.0], above) for p in points):
            self._doubtful += below is None or not any(stands_on(p, below) for p in points)

    @property
    def doubt(self) -> str:
        """Why the images look upside down, and what to do; empty where they do not."""
        if self._doubtful < _FEWEST or 2 * self._doubtful <= self._looks:
            return ""
        return (
            "the images look upside down: there is a floor above the camera, and none that people stand on "
            "below; mount.roll: 180 is for a sensor that hangs so; flipped images must be flipped back"
        )
