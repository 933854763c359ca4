"""Sources of frames: a recording that a thread reads ahead, or running nodes."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from depth_pose.core.camera import Camera
from depth_pose.core.errors import DepthPoseError
from depth_pose.core.frame import DepthFrame
from depth_pose.core.result import Skeleton
from depth_pose.rooms.merge import place
from depth_pose.rooms.placed_camera import Answer
from depth_pose.rooms.recorded import RecordedPeople
from depth_pose.viewer.frames import ViewerFrame, keep
from depth_pose.viewer.known_room import KnownRoom
from depth_pose.viewer.playback import Playback

if TYPE_CHECKING:
    from depth_pose.ros.tools.watch import NodeState, Watch

_RECENT_NS = 1_000_000_000
"""Time for which a person is shown without a new answer: busy nodes process people in turn, so that each of
three people is answered in every third frame."""

_NO_IMAGE = Camera(1, 1, 1.0, 1.0, 0.0, 0.0)
"""Camera of the empty depth image, for frames without depth."""


class Recent:
    """The people answered recently."""

    def __init__(self) -> None:
        self._last: dict[str, Skeleton] = {}

    def add(self, skeletons: Iterable[Skeleton]) -> None:
        """Receive the skeletons of a frame."""
        self._last.update({s.body_id: s for s in skeletons})

    def people(self, frame: ViewerFrame) -> tuple[Skeleton, ...]:
        """Return the skeletons of a frame and of the moment before; none if it was not answered."""
        now = frame.stamp_ns
        self._last = {k: s for k, s in self._last.items() if 0 <= now - s.stamp_ns <= _RECENT_NS}
        if frame.skeletons is None:
            return ()
        known = {**self._last, **{s.body_id: s for s in frame.skeletons}}
        return tuple(known[k] for k in sorted(known, key=lambda k: (len(k), k)))


class LiveSource:
    """Running nodes.

    Parameters
    ----------
    watch : Watch
        The running watch on the nodes.
    most_points : int
        Points kept of a frame.
    """

    def __init__(self, watch: Watch, most_points: int) -> None:
        self._watch, self._most_points = watch, most_points
        self._recent = Recent()

    def newest(self) -> ViewerFrame | None:
        """Return the newest frame not returned before."""
        heard = self._watch.newest()
        if heard is None:
            return None
        self._recent.add(heard.skeletons or ())
        return keep(heard.frame, heard.skeletons, self._most_points)

    def people(self, frame: ViewerFrame) -> tuple[Skeleton, ...]:
        """Return the skeletons of a frame and of a moment before."""
        return self._recent.people(frame)

    def nodes(self) -> Sequence[NodeState]:
        """Return the latest diagnostics of each node."""
        return self._watch.nodes()

    def set(self, name: str, value: str | int) -> str:
        """Set ``follow``, ``zone`` or ``people`` of the nodes; return an error text, or an empty one."""
        return self._watch.set(name, value)


class RecordedSource:
    """A recording's frames, read ahead in a thread, and the playback over them.

    Parameters
    ----------
    frames : iterable of DepthFrame
    answer : callable
        Returns the skeletons in a frame: read from a file, or found by the pipeline.
    most_points : int
        Points kept of a frame.
    room : KnownRoom, optional
        The sensor's place in a room; without it, the floor is estimated.

    Attributes
    ----------
    playback : Playback
    error : str
        Error that ended the reading early; empty if there was none.
    room : KnownRoom or None
    """

    def __init__(
        self, frames: Iterable[DepthFrame], answer: Answer, most_points: int, room: KnownRoom | None = None
    ) -> None:
        self.playback = Playback()
        self.room = room
        self.error = ""
        self._frames, self._answer, self._most_points = frames, answer, most_points
        self._kept: list[ViewerFrame] = []
        self._stopping = False
        self._thread = threading.Thread(target=self._read, name="reader", daemon=True)

    def start(self) -> None:
        """Begin to read."""
        self._thread.start()

    def stop(self) -> None:
        """Stop reading, after the current frame."""
        self._stopping = True
        if self._thread.is_alive():
            self._thread.join()

    def wait(self) -> None:
        """Wait until all is read."""
        self._thread.join()

    def frame(self, index: int) -> ViewerFrame:
        """Return a frame."""
        return self._kept[index]

    def _read(self) -> None:
        try:
            for frame in self._frames:
                if self._stopping:
                    return
                self._kept.append(keep(frame, self._answer(frame), self._most_points))
                self.playback.add(frame.stamp_ns)
        except DepthPoseError as error:
            self.error = str(error)
        finally:
            self.playback.finish()


def source_without_depth(people: RecordedPeople, room: KnownRoom) -> RecordedSource:
    """Return the frames of skeletons in the room's frame, without depth."""
    T_sensor_room = np.asarray(np.linalg.inv(room.T_room_sensor), np.float64)

    def frames() -> Iterator[DepthFrame]:
        for stamp_ns in people.stamps_ns:
            yield DepthFrame(stamp_ns, "sensor", np.zeros((1, 1), np.float32), _NO_IMAGE)

    def answer(frame: DepthFrame) -> tuple[Skeleton, ...]:
        return tuple(place(s, T_sensor_room, frame.frame_id) for s in people.answers[frame.stamp_ns])

    return RecordedSource(frames(), answer, 1, room)
