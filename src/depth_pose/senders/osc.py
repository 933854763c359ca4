"""Skeletons as OSC, for Unity, TouchDesigner, Max and others.

For each frame::

    /depth_pose/people           BODY BODY ...
    /depth_pose/BODY/centre      x y z vx vy vz     metres and m/s; velocities are 0 while unknown
    /depth_pose/BODY/JOINT       x y z confidence   metres

with x right, y up and z away from the sensor, as in Unity. The messages of a person are one bundle, a UDP
packet of 1.3 kB.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import Any

import numpy as np

from depth_pose.core.errors import ConfigError
from depth_pose.core.extras import require
from depth_pose.core.result import Skeleton
from depth_pose.senders.address import LOCAL

_UP = np.array([1.0, -1.0, 1.0])
"""From the camera frame, y down, to y up."""


class OscSender:
    """Sends the people of each frame by OSC over UDP.

    Parameters
    ----------
    port : int
    host : str
        Name or number of the receiving machine.

    Raises
    ------
    ConfigError
        Where python-osc is not installed, or the host is unknown.

    Examples
    --------
    >>> with OscSender(9000) as sender:  # doctest: +SKIP
    ...     for t, depth in frames:
    ...         sender.send(tracker(depth, camera, time=t))
    """

    def __init__(self, port: int, host: str = LOCAL) -> None:
        require("pythonosc", "OSC")
        from pythonosc.udp_client import UDPClient

        try:
            self._client = UDPClient(host, port)
        except OSError as error:
            raise ConfigError(f"OSC cannot be sent to {host}:{port}: {error.strerror or error}") from error

    def send(self, people: Sequence[Skeleton]) -> None:
        """Send one frame's people; UDP packets that nobody receives are lost."""
        known = [skeleton for skeleton in people if not skeleton.is_lost]
        try:
            self._client.send(_message("/depth_pose/people", *[s.body_id for s in known]))
            for skeleton in known:
                self._client.send(_bundle(skeleton))
        except ConnectionRefusedError:  # nobody listens on this machine
            return

    def close(self) -> None:
        """Close the socket."""
        self._client._sock.close()

    def __enter__(self) -> OscSender:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _message(address: str, *values: Any) -> Any:
    from pythonosc.osc_message_builder import OscMessageBuilder

    built = OscMessageBuilder(address)
    for value in values:
        built.add_arg(value)
    return built.build()


def _bundle(skeleton: Skeleton) -> Any:
    from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder

    built, root = OscBundleBuilder(IMMEDIATELY), f"/depth_pose/{skeleton.body_id}"
    moving = np.nan_to_num(skeleton.velocity)
    centre = np.concatenate([_UP * skeleton.centre, _UP * moving]).tolist()
    built.add_content(_message(f"{root}/centre", *centre))
    places = (_UP * skeleton.positions).tolist()
    for joint, place in zip(skeleton, places, strict=True):
        built.add_content(_message(f"{root}/{joint.name}", *place, joint.confidence))
    return built.build()
