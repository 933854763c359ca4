"""Export while the skeletons are read: the memory is that of `PART_FRAMES` frames, for any length.

Tables of rows need nothing of what follows a frame, if the frames come in order.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.result import Skeleton
from depth_pose.export.tracks import Presence, Tracks, check_chosen, read_frames, tracks_of

PART_FRAMES = 250
"""Frames in memory at a time: four people in them take 8 MB; larger parts are no faster."""


class FramesOutOfOrder(Exception):
    """A frame belongs before those that were passed on; the recording must be read whole."""


class PartsReader:
    """Reads a recording's tracks in parts, and notes who is there when.

    Parameters
    ----------
    path : Path or str
    topic : str
    people : sequence of str
        Only these ``body_id`` in the parts; all if empty.

    Attributes
    ----------
    frame_id : str
        Name of the frame that positions are in, once the first part is read.
    """

    def __init__(self, path: Path | str, topic: str, people: Sequence[str]) -> None:
        self.frame_id = ""
        self._path, self._topic, self._people = path, topic, people
        self._stamps_ns = array("q")
        self._rows: dict[str, array[int]] = {}

    def parts(self) -> Iterator[Tracks]:
        """Yield the parts, in order.

        Raises
        ------
        InputError
            As of `depth_pose.export.tracks.read_tracks`.
        FramesOutOfOrder
            Where a frame belongs into an earlier part.
        """
        frames: dict[int, tuple[Skeleton, ...]] = {}
        for message in read_frames(self._path, self._topic):
            self.frame_id = self.frame_id or message.frame_id
            frames[message.stamp_ns] = message.skeletons
            if len(frames) == PART_FRAMES:
                yield self._part(frames)
                frames = {}
        if frames:
            yield self._part(frames)

    def _part(self, frames: dict[int, tuple[Skeleton, ...]]) -> Tracks:
        part = tracks_of(frames, self.frame_id)
        first = len(self._stamps_ns)
        if first and part.stamps_ns[0] <= self._stamps_ns[-1]:
            raise FramesOutOfOrder
        self._stamps_ns.extend(part.stamps_ns.tolist())
        for track in part.people:
            start = first + int(np.searchsorted(part.stamps_ns, track.stamps_ns[0]))
            rows = start + np.flatnonzero(track.present)
            self._rows.setdefault(track.body_id, array("q")).extend(rows.tolist())
        if not self._people:
            return part
        return replace(part, people=tuple(t for t in part.people if t.body_id in self._people))

    def check(self, source: Path | str) -> None:
        """Check that the chosen people were there; ``source`` is named in errors.

        Raises
        ------
        InputError
            As of `depth_pose.export.tracks.chosen`.
        """
        check_chosen(list(self._rows), self._people, source, len(self._stamps_ns))

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Stamps of all frames so far."""
        return np.array(self._stamps_ns, np.int64)

    def presences(self, frame_id: str) -> tuple[Presence, ...]:
        """Return when the chosen people are there; ``frame_id`` is that of their positions."""
        stamps_ns = self.stamps_ns
        return tuple(_presence(body_id, frame_id, rows, stamps_ns) for body_id, rows in self._chosen())

    def _chosen(self) -> Iterable[tuple[str, array[int]]]:
        return (item for item in self._rows.items() if not self._people or item[0] in self._people)


def _presence(body_id: str, frame_id: str, rows: array[int], stamps_ns: NDArray[np.int64]) -> Presence:
    present = np.zeros(rows[-1] - rows[0] + 1, np.bool_)
    present[np.array(rows) - rows[0]] = True
    return Presence(body_id, frame_id, stamps_ns[rows[0] : rows[-1] + 1], present)
