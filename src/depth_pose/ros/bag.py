"""MCAP recordings to topics and back: `Player` and `play`, `Recorder` and `record`.

`play` and `record` run until they are done or interrupted; the classes do the same from a
program, each with an rclpy context of its own, so both work beside each other and in threads::

    with Recorder("out.mcap", ["/depth_pose/skeleton"]) as recorder:
        played = play("in.mcap", wait_for_subscribers=["/camera/depth/image_raw"])
        recorder.wait_for("/depth_pose/skeleton", count=played.messages["/camera/depth/image_raw"])
"""

from __future__ import annotations

from depth_pose.ros.player import Played, Player, play
from depth_pose.ros.recorder import Recorder, record

__all__ = ["Played", "Player", "Recorder", "play", "record"]
