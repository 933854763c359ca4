"""Decode the image messages of several cameras, live and offline alike."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import InputError
from depth_pose.io._messages import ImageMessage
from depth_pose.io.decode import decode_depth
from depth_pose.volume.rigfile import Rig
from depth_pose.volume.synchroniser import ViewSet


def decode_silhouette(
    data: bytes | memoryview, height: int, width: int, step: int, encoding: str
) -> NDArray[np.uint8]:
    """Read a silhouette image: ``mono8`` or ``8UC1``, not 0 where the person is.

    Raises
    ------
    InputError
        Where the encoding is another, or the data are too short.
    """
    if encoding not in ("mono8", "8UC1"):
        raise InputError(f"the silhouette's encoding is {encoding!r}; it must be mono8 or 8UC1")
    if min(height, width) < 1 or step < width or len(data) < height * step:
        raise InputError(
            f"the silhouette is {width} x {height} with rows of {step} bytes, but has {len(data)} bytes"
        )
    return np.frombuffer(data, np.uint8, height * step).reshape(height, step)[:, :width]


def decode_views(
    views: ViewSet, rig: Rig, kind: str, gone: int, complain: Callable[[str, InputError], None]
) -> ViewSet:
    """Decode the messages of a set of views; one that is damaged or of another size counts as missing.

    Parameters
    ----------
    views : ViewSet
        Of `ImageMessage`, or None.
    rig : Rig
    kind : str
        ``silhouettes`` or ``depth``.
    gone : int
        Cameras that nothing is expected of.
    complain : callable
        Called with the topic of an image that cannot be used, and why.

    Raises
    ------
    InputError
        Where fewer than half of the cameras that are there brought a usable image.
    """
    images: list[NDArray[np.generic] | None] = []
    for message, camera, topic in zip(views.images, rig.cameras, rig.topics, strict=True):
        images.append(None)
        if message is None:
            continue
        try:
            camera.check_size(message.height, message.width)
            images[-1] = _decode(message, kind)
        except InputError as error:
            complain(topic, error)
    there, live = sum(i is not None for i in images), len(images) - gone
    if 2 * there < live or there == 0:
        raise InputError(f"only {there} of {live} live cameras brought a usable image in time")
    return ViewSet(views.stamp_ns, tuple(images))


def _decode(image: ImageMessage, kind: str) -> NDArray[np.generic]:
    layout = (image.height, image.width, image.step, image.encoding)
    if kind == "depth":
        return decode_depth(image.data, *layout, bool(image.is_bigendian))
    return decode_silhouette(image.data, *layout)
