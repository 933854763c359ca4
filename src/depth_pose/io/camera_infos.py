"""Find the CameraInfo of an image, on topics with several cameras."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from depth_pose.core.printable import printable


@dataclass(frozen=True)
class _Known:
    info: Any
    stamp_ns: int
    calibration: tuple[Any, ...]


class CameraInfos:
    """The newest CameraInfo of every frame_id on a topic.

    An image uses the one of its own frame_id. A leading slash, as in old recordings, is ignored, and an
    empty name matches any. Some drivers name the two differently: `accept_only` uses the only other name,
    and `warnings` reports it.

    Parameters
    ----------
    topic : str
    """

    def __init__(self, topic: str) -> None:
        self._topic, self._is_only = topic, False
        self._known: dict[str, _Known] = {}
        self._counts: Counter[str] = Counter()
        self._changes: dict[str, tuple[int, str]] = {}
        self._used: dict[str, str] = {}
        self._refused: Counter[str] = Counter()

    def add(self, info: Any, stamp_ns: int, is_ahead: bool = False) -> None:
        """Add a message of rclpy or of a recording; one read ahead is counted when it arrives."""
        name = _name(info)
        known = _Known(info, stamp_ns, _calibration(info))
        if is_ahead:
            self._known.setdefault(name, known)
            return
        before = self._known.get(name)
        if before is not None and before.calibration != known.calibration:
            count, _ = self._changes.get(name, (0, ""))
            self._changes[name] = count + 1, f"{_describe(before.info)} -> {_describe(info)}"
        self._known[name] = known
        self._counts[name] += 1

    def refuse(self, reason: str) -> None:
        """Count a message that cannot be read."""
        self._refused[reason] += 1

    def accept_only(self) -> None:
        """Use the only frame_id for every image."""
        self._is_only = True

    def find(self, frame_id: str) -> Any | None:
        """Return the newest CameraInfo of an image's camera; None if there is none yet."""
        name = self._name_for(frame_id.lstrip("/"))
        return None if name is None else self._known[name].info

    @property
    def count(self) -> int:
        """Number of CameraInfos received."""
        return self._counts.total()

    def has_stamp(self, frame_id: str, stamp_ns: int) -> bool:
        """Whether the one that `find` returns was sent with the image of this stamp."""
        name = self._name_for(frame_id.lstrip("/"))
        return name is not None and self._known[name].stamp_ns == stamp_ns

    def _name_for(self, image: str) -> str | None:
        found = image if image in self._known else None
        if found is None and len(self._known) == 1:
            (only,) = self._known
            if not image or not only or self._is_only:
                found = only
        if found is not None:
            self._used[image] = found
        return found

    @property
    def counts(self) -> dict[str, int]:
        """Number of odd CameraInfos by kind."""
        used = set(self._used.values())
        others = sum(count for name, count in self._counts.items() if name not in used)
        changes = sum(count for name, (count, _) in self._changes.items() if name in used)
        counts = {
            "CameraInfo of another camera": others if used else 0,
            "CameraInfo changed": changes,
            "CameraInfo damaged": self._refused.total(),
        }
        return {what: count for what, count in counts.items() if count}

    @property
    def warnings(self) -> dict[str, str]:
        """Mismatches and changes so far: a line with its count by kind."""
        lines = {}
        used = set(self._used.values())
        counts = self.counts
        if others := counts.get("CameraInfo of another camera"):
            noun = "a CameraInfo" if others == 1 else f"{others} CameraInfos"
            names = _quoted(name for name in self._known if name not in used)
            lines["other"] = f"{self._topic}: {noun} of another camera ignored ({names})"
        for image, name in self._used.items():
            if image and name and image != name:
                lines["name"] = (
                    f"{self._topic} has frame_id {_quoted([name])}, the images {_quoted([image])}; it is "
                    "used, as there is no other: is it this camera's?"
                )
        for name, (count, what) in self._changes.items():
            if name in used:
                times = "" if count == 1 else f" {count} times"
                lines["change"] = f"{self._topic}: the camera {_quoted([name])} changes{times}: {what}"
        for reason, count in self._refused.items():
            times = "" if count == 1 else f" ({count} times)"
            lines["damage"] = f"{self._topic}: {reason}{times}"
        return lines

    def why_none(self, frame_id: str) -> str:
        """Return why `find` returned none."""
        if not self._known:
            return f"nothing has come on {self._topic} yet"
        names = _quoted(self._known)
        return f"{self._topic} has the camera of frame_id {names}, the image is of {_quoted([frame_id])}"


def _quoted(names: Iterable[str]) -> str:
    return ", ".join(repr(printable(name)) for name in names)


def _name(info: Any) -> str:
    return str(info.header.frame_id).lstrip("/")


def _calibration(info: Any) -> tuple[Any, ...]:
    numbers = [np.asarray(values, np.float64).tobytes() for values in (info.k, info.d, info.p)]
    roi = info.roi
    part = (info.binning_x, info.binning_y, roi.x_offset, roi.y_offset, roi.width, roi.height)
    return (info.width, info.height, info.distortion_model, *part, *numbers)


def _describe(info: Any) -> str:
    return f"{info.width} x {info.height}, fx {info.k[0]:.1f}"
