"""SROS2: where it is asked for and ROS does not start, say what to do in one line."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

from depth_pose.core.errors import ConfigError


def init_context(context: Any = None, args: Sequence[str] | None = None, **options: Any) -> None:
    """Initialise rclpy, as `rclpy.init`.

    Raises
    ------
    ConfigError
        Where ROS does not start and ``ROS_SECURITY_ENABLE`` asks for SROS2.
    """
    import rclpy

    try:
        rclpy.init(args=args, context=context, **options)
    except RuntimeError as error:
        if os.environ.get("ROS_SECURITY_ENABLE", "").lower() != "true":
            raise
        raise ConfigError(
            f"ROS does not start, and ROS_SECURITY_ENABLE asks for SROS2 ({_keystore()}): set "
            "ROS_SECURITY_KEYSTORE to a keystore of `ros2 security create_keystore`, or unset "
            "ROS_SECURITY_ENABLE; ROS 2 from the Python package index has no SROS2"
        ) from error


def _keystore() -> str:
    """Describe the keystore that the environment names."""
    path = os.environ.get("ROS_SECURITY_KEYSTORE", "")
    if not path:
        return "ROS_SECURITY_KEYSTORE is not set"
    known = "names the keystore" if os.path.isdir(os.path.join(path, "enclaves")) else "is no keystore:"
    return f"ROS_SECURITY_KEYSTORE {known} {path}"
