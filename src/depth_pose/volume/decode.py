"""Decode the image messages of several cameras, live and offline alike."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import InputError
from depth_pose.io.decode import decode_depth
from depth_pose.io.depth_unit import UnitWatch, unit_of
from depth_pose.io.messages import ImageMessage
from depth_pose.rooms.rigfile import Rig
from depth_pose.volume.synchroniser import ViewSet


def decode_silhouette(
    data: bytes | memoryview, height: int, width: int, step: int, encoding: str
) -> NDArray[np.uint8]:
    """Read a silhouette image: ``mono8`` or ``8UC1``, nonzero on the person.

    Raises
    ------
    InputError
        Where the encoding is a different one, or the data is too short.
    """
    if encoding not in ("mono8", "8UC1"):
        raise InputError(f"the silhouette's encoding is {encoding!r}; it must be mono8 or 8UC1")
    if min(height, width) < 1 or step < width or len(data) < height * step:
        raise InputError(
            f"the silhouette is {width} x {height} with rows of {step} bytes, but has {len(data)} bytes"
        )
    return np.frombuffer(data, np.uint8, height * step).reshape(height, step)[:, :width]


class ViewDecoder:
    """Decodes sets of views; checks whether the depths look like another unit.

    Parameters
    ----------
    rig : Rig
    kind : str
        ``silhouettes`` or ``depth``.
    depth_scale : float
        Metres per unit of depth; 0: that of the encoding.
    complain : callable
        Called with the topic of an unusable image, and the reason.
    """

    def __init__(
        self, rig: Rig, kind: str, depth_scale: float, complain: Callable[[str, InputError], None]
    ) -> None:
        self._rig, self._kind, self._unit_m = rig, kind, depth_scale or None
        self._complain = complain
        self._units = {topic: UnitWatch("views.depth_scale") for topic in rig.topics}

    def doubts(self, *, live: bool = False) -> dict[str, str]:
        """Return why depths look like another unit, by topic; live only where enough were seen to judge."""
        units = {t: unit for t, unit in self._units.items() if unit.is_decided or not live}
        return {topic: f"{topic}: {unit.doubt}" for topic, unit in units.items() if unit.doubt}

    def decode(self, views: ViewSet, gone: int) -> ViewSet:
        """Decode the messages of a set; one that is damaged or of another size counts as missing.

        Parameters
        ----------
        views : ViewSet
            Of `ImageMessage`, or None.
        gone : int
            Number of cameras that are lost.

        Raises
        ------
        InputError
            Where fewer than half of the live cameras brought a usable image.
        """
        images: list[NDArray[np.generic] | None] = []
        for message, camera, topic in zip(views.images, self._rig.cameras, self._rig.topics, strict=True):
            images.append(None)
            if message is None:
                continue
            try:
                camera.check_size(message.height, message.width)
                images[-1] = self._decode(message, topic)
            except InputError as error:
                self._complain(topic, error)
        there, live = sum(i is not None for i in images), len(images) - gone
        if 2 * there < live or there == 0:
            raise InputError(f"only {there} of {live} live cameras brought a usable image in time")
        return ViewSet(views.stamp_ns, tuple(images))

    def _decode(self, image: ImageMessage, topic: str) -> NDArray[np.generic]:
        layout = (image.height, image.width, image.step, image.encoding)
        if self._kind != "depth":
            return decode_silhouette(image.data, *layout)
        depth = decode_depth(image.data, *layout, bool(image.is_bigendian), self._unit_m)
        if self._unit_m is None:
            self._units[topic].look(depth, unit_of(image.encoding))
        return depth
