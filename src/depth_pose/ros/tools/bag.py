"""MCAP recordings to topics and back: `Player` and `play`, `Recorder` and `record`.

`play` and `record` run until they are done or interrupted; the classes do the same from a
program, each with its own rclpy context, so both work side by side and in threads::

    with Recorder("out.mcap", ["/depth_pose/skeleton"]) as recorder:
        played = play("in.mcap", wait_for_subscribers=["/camera/depth/image_raw"])
        recorder.wait_for("/depth_pose/skeleton", count=played.messages["/camera/depth/image_raw"])
"""

from __future__ import annotations

import struct

from depth_pose.ros.tools.player import Played, Player, play
from depth_pose.ros.tools.recorder import Recorder, record

__all__ = ["Played", "Player", "Recorder", "header_stamp_ns", "play", "record"]


def header_stamp_ns(data: bytes) -> int:
    """Stamp of a serialised message that begins with a header, nanoseconds.

    With the `on_message` of `Player` and `Recorder`, which pass serialised messages and wall
    times, it gives the latency of every frame without decoding any.
    """
    sec, nanosec = struct.unpack_from("<iI" if data[1] & 1 else ">iI", data, 4)
    return int(sec) * 1_000_000_000 + int(nanosec)
