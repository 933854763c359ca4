"""Where ROS writes its logs: elsewhere, where the usual place cannot be written."""

from __future__ import annotations

import os
from pathlib import Path

from depth_pose.core.private_folder import is_writable, private_folder


def ensure_log_folder() -> None:
    """Make a folder for the logs of ROS, without which rclpy does not start.

    It takes ``$ROS_LOG_DIR``, else ``$ROS_HOME/log``, else ``~/.ros/log``; where that cannot be written, a
    private one for temporary files takes its place, for this process and those that it starts.
    """
    given = os.environ.get("ROS_LOG_DIR")
    home = os.environ.get("ROS_HOME") or os.path.expanduser("~/.ros")
    if is_writable(Path(given) if given else Path(home) / "log"):
        return
    own = private_folder("log")
    if own is not None:
        os.environ["ROS_LOG_DIR"] = str(own)
