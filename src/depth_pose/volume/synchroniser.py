"""Group the images of several cameras by time, without waiting for lost cameras."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from depth_pose.volume.config import ViewsConfig


@dataclass(frozen=True)
class ViewSet:
    """Images of one time.

    Attributes
    ----------
    stamp_ns : int
        The earliest of their stamps.
    images : tuple
        One per camera; None for a missing or late one.
    """

    stamp_ns: int
    images: tuple[Any, ...]


class Synchroniser:
    """Holds images until their set of views is complete, or has waited long enough; plain Python, no ROS.

    Live, `take` returns the newest set and drops older ones; offline, `take_all` yields every set in order.
    Times are seconds of any clock that does not go back.

    Parameters
    ----------
    cameras : int
    config : ViewsConfig
        May be replaced at any time.

    Attributes
    ----------
    late, missing : Counter of int
        By camera: images that arrived after their set was returned, and sets returned without it.
    overtaken : int
        Number of sets overtaken by a newer one.
    """

    def __init__(self, cameras: int, config: ViewsConfig | None = None) -> None:
        self._cameras, self.config = cameras, config or ViewsConfig()
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
        """Whether images are held."""
        return bool(self._held)

    def is_fresh(self, now: float, seconds: float) -> bool:
        """Whether the newest set began less than this long ago and lacks a live camera."""
        if not self._held:
            return False
        stamp = max(self._held)
        if now - self._since[stamp] >= seconds:
            return False
        return any(self._held[stamp][c] is None for c in self._waited_for(now))

    def _waited_for(self, now: float) -> list[int]:
        """Cameras not silent for long *while others were not*: a pause of all does not count."""
        after = self.config.gone_after
        return [c for c, since in enumerate(self._behind) if since is None or now - since <= after]

    def gone(self, now: float) -> list[int]:
        """Cameras that are silent, or have never sent an image."""
        after = self.config.gone_after
        return [c for c, heard in enumerate(self._heard) if heard is None or now - heard > after]

    def add(self, camera: int, stamp_ns: int, image: Any, now: float) -> None:
        """Add one image."""
        self._heard[camera] = now
        for c, since in enumerate(self._behind):
            if c == camera:
                self._behind[c] = None
            elif since is None:
                self._behind[c] = now
        if self.is_back(stamp_ns):
            self.clear()
        tolerance_ns = self.config.tolerance * 1e9
        if self._done_ns is not None and stamp_ns <= self._done_ns + tolerance_ns:
            self.late[camera] += 1
            return
        near = [s for s in self._held if abs(s - stamp_ns) <= tolerance_ns]
        stamp = min(near, key=lambda s: abs(s - stamp_ns)) if near else stamp_ns
        if not near:
            self._held[stamp] = [None] * self._cameras
            self._since[stamp] = now
        self._held[stamp][camera] = image

    def is_back(self, stamp_ns: int) -> bool:
        """Return whether a stamp is so far back that the cameras' clock was reset."""
        return self._done_ns is not None and stamp_ns < self._done_ns - self.config.gone_after * 1e9

    def take(self, now: float, newest: bool = True) -> ViewSet | None:
        """Return the newest set that is complete or has waited enough, dropping older ones; or the first."""
        waited_for, patience = self._waited_for(now), self.config.patience
        ready = [
            stamp
            for stamp, images in self._held.items()
            if all(images[c] is not None for c in waited_for) or now - self._since[stamp] >= patience
        ]
        if not ready:
            return None
        stamp = max(ready) if newest else min(self._held)
        if stamp not in ready:
            return None
        for old in [s for s in self._held if s < stamp]:
            del self._held[old], self._since[old]
            self.overtaken += 1
        return self._give(stamp)

    def take_all(self, until_ns: float = float("inf")) -> Iterator[ViewSet]:
        """Yield every set with a stamp below a bound, in order of stamps, complete or not."""
        for stamp in sorted(s for s in self._held if s < until_ns):
            yield self._give(stamp)

    def _give(self, stamp: int) -> ViewSet:
        images = self._held.pop(stamp)
        del self._since[stamp]
        self._done_ns = stamp
        for c in range(self._cameras):
            if images[c] is None:
                self.missing[c] += 1
        return ViewSet(stamp, tuple(images))
