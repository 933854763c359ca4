"""The log folder of ROS, with a fallback if the usual one cannot be written."""

from __future__ import annotations

import os
from pathlib import Path

from depth_pose.core.private_folder import is_writable, private_folder


def ensure_log_folder() -> None:
    """Create a folder for the logs of ROS, without which rclpy does not start.

    It is ``$ROS_LOG_DIR``, else ``$ROS_HOME/log``, else ``~/.ros/log``; if that cannot be written, a private
    folder for temporary files, for this process and its children.
    """
    given = os.environ.get("ROS_LOG_DIR")
    home = os.environ.get("ROS_HOME") or os.path.expanduser("~/.ros")
    if is_writable(Path(given) if given else Path(home) / "log"):
        return
    own = private_folder("log")
    if own is not None:
        os.environ["ROS_LOG_DIR"] = str(own)
