"""Bring together what several cameras saw at one moment, without waiting for those that are gone."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Moment:
    """Images of one moment.

    Attributes
    ----------
    stamp_ns : int
        The earliest of their stamps.
    images : tuple
        One per camera; None for one that brought nothing in time.
    """

    stamp_ns: int
    images: tuple[Any, ...]


class MomentGatherer:
    """Holds images until their moment is whole, or has waited long enough; plain Python, no ROS.

    Times are seconds of any clock that does not go back.

    Parameters
    ----------
    cameras : int
    tolerance_s : float
        Stamps that differ by at most this are of one moment.
    patience_s : float
        How long a moment waits for its missing cameras, from its first image.
    gone_after_s : float
        A camera that brought nothing for this long, while others did, is gone: no moment waits for it.

    Attributes
    ----------
    late, missing : Counter of int
        By camera: images that came after their moment was answered, and moments answered without it.
    overtaken : int
        Moments that a newer one overtook.
    """

    def __init__(self, cameras: int, tolerance_s: float, patience_s: float, gone_after_s: float) -> None:
        self._cameras = cameras
        self._tolerance_ns, self._patience, self._gone_after = tolerance_s * 1e9, patience_s, gone_after_s
        self._heard: list[float | None] = [None] * cameras
        self._behind: list[float | None] = [None] * cameras
        self.late: Counter[int] = Counter()
        self.missing: Counter[int] = Counter()
        self.overtaken = 0
        self.clear()

    def clear(self) -> None:
        """Forget all images that are held."""
        self._held: dict[int, list[Any]] = {}
        self._since: dict[int, float] = {}
        self._done_ns: int | None = None

    @property
    def is_waiting(self) -> bool:
        """Whether images are held that no moment has been made of."""
        return bool(self._held)

    def is_fresh(self, now: float, seconds: float) -> bool:
        """Whether the newest moment began less than so long ago and lacks a camera that is there."""
        if not self._held:
            return False
        stamp = max(self._held)
        if now - self._since[stamp] >= seconds:
            return False
        return any(self._held[stamp][c] is None for c in self._waited_for(now))

    def _waited_for(self, now: float) -> list[int]:
        """Cameras that have not been silent for long *while others were not*: a pause of all is none's."""
        return [c for c, since in enumerate(self._behind) if since is None or now - since <= self._gone_after]

    def gone(self, now: float) -> list[int]:
        """Cameras that bring nothing, or never did."""
        return [c for c, heard in enumerate(self._heard) if heard is None or now - heard > self._gone_after]

    def add(self, camera: int, stamp_ns: int, image: Any, now: float) -> None:
        """Take one image."""
        self._heard[camera] = now
        for c, since in enumerate(self._behind):
            if c == camera:
                self._behind[c] = None
            elif since is None:
                self._behind[c] = now
        if self._done_ns is not None and stamp_ns < self._done_ns - self._gone_after * 1e9:
            self.clear()  # the clock went back
        if self._done_ns is not None and stamp_ns <= self._done_ns + self._tolerance_ns:
            self.late[camera] += 1
            return
        near = [s for s in self._held if abs(s - stamp_ns) <= self._tolerance_ns]
        stamp = min(near, key=lambda s: abs(s - stamp_ns)) if near else stamp_ns
        if not near:
            self._held[stamp] = [None] * self._cameras
            self._since[stamp] = now
        self._held[stamp][camera] = image

    def take(self, now: float) -> Moment | None:
        """Give the newest moment that is whole or has waited long enough; older ones are let go."""
        waited_for = self._waited_for(now)
        ready = [
            stamp
            for stamp, images in self._held.items()
            if all(images[c] is not None for c in waited_for) or now - self._since[stamp] >= self._patience
        ]
        if not ready:
            return None
        stamp = max(ready)
        for old in [s for s in self._held if s < stamp]:
            del self._held[old], self._since[old]
            self.overtaken += 1
        images = self._held.pop(stamp)
        del self._since[stamp]
        self._done_ns = stamp
        for c in range(self._cameras):
            if images[c] is None:
                self.missing[c] += 1
        return Moment(stamp, tuple(images))
