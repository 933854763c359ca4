"""Recorded silhouettes or depth images as sets of views, in order; every drop is reported."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

from depth_pose.core.errors import InputError
from depth_pose.io.messages import ImageMessage, read_image
from depth_pose.io.recording import Recording
from depth_pose.rooms.rigfile import Rig
from depth_pose.volume.config import ViewsConfig
from depth_pose.volume.decode import ViewDecoder
from depth_pose.volume.synchroniser import Synchroniser, ViewSet

_SURE_AHEAD = 3
"""Number of consecutive images after which a later time from a single camera is accepted."""


class ViewReader:
    """The sets of views of a recording; may be iterated again.

    Parameters
    ----------
    path : Path or str
        An MCAP file, or a folder of them.
    rig : Rig
    kind : str
        ``silhouettes`` or ``depth``.
    config : ViewsConfig

    Attributes
    ----------
    incomplete, dropped : int
        Sets, since iteration began, in which a camera was missing, and those that could not be used.
    warnings : list of str
        Problems, one line each with its count.

    Raises
    ------
    InputError
        Where the recording has none of the rig's topics, or (on iteration) not one set can be used.
    """

    def __init__(self, path: Path | str, rig: Rig, kind: str, config: ViewsConfig | None = None) -> None:
        self._recording, self._rig, self._kind = Recording(path), rig, kind
        self._config = config or ViewsConfig()
        self._decoder = self._new_decoder()
        self._index = {t: i for i, t in enumerate(rig.topics) if t in self._recording.topics}
        if not self._index:
            there = ", ".join(sorted(self._recording.topics)) or "none"
            raise InputError(f"{path} has none of the rig's topics; its topics are {there}")
        self._wrong = Counter[str]()
        self.incomplete = self.dropped = 0

    @property
    def damage(self) -> list[str]:
        """Damage of the recording found so far, one line per file."""
        return self._recording.damage

    @property
    def path(self) -> Path:
        """The recording's file or folder."""
        return self._recording.path

    @property
    def warnings(self) -> list[str]:
        """Problems since iteration began."""
        wrong = (f"{count} times: {what}" for what, count in self._wrong.items())
        return [*self.damage, *(f"{self.path}: {line}" for line in self._decoder.doubts().values()), *wrong]

    def _new_decoder(self) -> ViewDecoder:
        return ViewDecoder(self._rig, self._kind, self._config.depth_scale, self._complain)

    def __iter__(self) -> Iterator[ViewSet]:
        """Yield the decoded views in order of stamps; None for a camera without an image."""
        self._wrong.clear()
        self._decoder = self._new_decoder()
        self.incomplete = self.dropped = given = 0
        for views in self._read():
            self.incomplete += any(image is None for image in views.images)
            given += 1
            yield views
        if not given:
            raise InputError(
                f"{self._recording.path}: no frame can be used: {next(iter(self._wrong), 'no images')}"
            )

    def _read(self) -> Iterator[ViewSet]:
        """Yield each set once newer images are later than the time limit for late cameras."""
        held, hold_ns, now = (
            Synchroniser(len(self._rig.topics), self._config),
            self._config.gone_after * 1e9,
            0.0,
        )
        newest_ns: int | None = None
        ahead: list[tuple[int, ImageMessage]] = []
        for message in self._recording.messages(*self._index):
            try:
                image = read_image(message.data)
            except InputError as error:
                self._complain(message.topic, error)
                continue
            now = message.log_time_ns * 1e-9
            arrived = [(self._index[message.topic], image)]
            if newest_ns is not None and image.stamp_ns - newest_ns > hold_ns:
                ahead += arrived
                if len({camera for camera, _ in ahead}) < 2 and len(ahead) < _SURE_AHEAD:
                    continue
                ahead, arrived = [], ahead
            self._refuse_ahead(ahead, newest_ns)
            ahead.clear()
            for camera, image in arrived:
                is_back = held.is_back(image.stamp_ns)
                if is_back:
                    yield from self._decoded(held.take_all(), held, now)
                newest_ns = max(image.stamp_ns, image.stamp_ns if is_back else newest_ns or 0)
                held.add(camera, image.stamp_ns, image, now)
                yield from self._decoded(held.take_all(image.stamp_ns - hold_ns), held, now)
        self._refuse_ahead(ahead, newest_ns)
        yield from self._decoded(held.take_all(), held, now)
        for camera, count in held.late.items():
            self._wrong[f"{self._rig.topics[camera]} came too late for its set of views"] += count

    def _refuse_ahead(self, ahead: Iterable[tuple[int, ImageMessage]], newest_ns: int | None) -> None:
        """Drop images with stamps ahead of the other cameras: a clock is wrong."""
        for camera, image in ahead:
            seconds = (image.stamp_ns - (newest_ns or 0)) * 1e-9
            self._wrong[f"{self._rig.topics[camera]}: its stamp is {seconds:.0f} s ahead of the others"] += 1

    def _decoded(self, sets: Iterable[ViewSet], held: Synchroniser, now: float) -> Iterator[ViewSet]:
        gone = len(held.gone(now))
        return (decoded for views in sets if (decoded := self._decode(views, gone)) is not None)

    def _decode(self, views: ViewSet, gone: int) -> ViewSet | None:
        try:
            return self._decoder.decode(views, gone)
        except InputError as error:
            self.dropped += 1
            self._wrong[f"a frame was dropped: {error}"] += 1
            return None

    def _complain(self, topic: str, error: InputError) -> None:
        self._wrong[f"{topic}: {error}"] += 1
