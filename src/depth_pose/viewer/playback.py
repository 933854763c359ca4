"""State of a playback: play, pause, scrub, speed. Plain Python."""

from __future__ import annotations

import bisect


class Playback:
    """A position in a recording that moves with time, over as many frames as are loaded.

    Attributes
    ----------
    playing : bool
    speed : float
        1 is as recorded.
    loop : bool
        Begin again at the end, once all is loaded.
    """

    def __init__(self) -> None:
        self.playing = True
        self.speed = 1.0
        self.loop = True
        self._stamps_ns: list[int] = []
        self._at_ns = 0.0
        self._is_whole = False

    def add(self, stamp_ns: int) -> None:
        """Add a frame; one whose stamp is before the last is placed right after it."""
        if not self._stamps_ns:
            self._at_ns = stamp_ns
        self._stamps_ns.append(max(stamp_ns, self._stamps_ns[-1] + 1) if self._stamps_ns else stamp_ns)

    def finish(self) -> None:
        """Mark the recording as completely loaded."""
        self._is_whole = True

    @property
    def is_whole(self) -> bool:
        """Whether all frames are loaded."""
        return self._is_whole

    def __len__(self) -> int:
        """Return the number of loaded frames."""
        return len(self._stamps_ns)

    @property
    def index(self) -> int:
        """Number of the frame to show."""
        return max(0, bisect.bisect_right(self._stamps_ns, self._at_ns) - 1)

    @property
    def seconds(self) -> float:
        """Time of that frame since the first."""
        return (self._stamps_ns[self.index] - self._stamps_ns[0]) * 1e-9 if self._stamps_ns else 0.0

    def seek(self, index: int) -> None:
        """Move to a frame."""
        if self._stamps_ns:
            self._at_ns = self._stamps_ns[min(max(index, 0), len(self._stamps_ns) - 1)]

    def step(self, frames: int) -> None:
        """Pause, and step some frames forward or back."""
        self.playing = False
        self.seek(self.index + frames)

    def advance(self, seconds: float) -> None:
        """Advance time; wait at the end of the loaded frames, restart at the end of the recording."""
        if not self.playing or not self._stamps_ns:
            return
        self._at_ns += seconds * self.speed * 1e9
        last = self._stamps_ns[-1]
        if self._at_ns > last:
            at_start = self._is_whole and self.loop and len(self._stamps_ns) > 1
            self._at_ns = self._stamps_ns[0] if at_start else last
