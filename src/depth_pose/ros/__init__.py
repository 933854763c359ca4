"""The four ROS 2 nodes and their tools. Nothing outside this package imports rclpy.

Importing it sets the shipped Fast DDS profile (`fastdds.xml`) in the environment, unless
the user has set one: Fast DDS reads that variable once, so it must be set before the first
participant is made, and child processes inherit it. `stay_local` sets the profile for this
machine alone.
"""

from __future__ import annotations

import os
from pathlib import Path

from depth_pose.core.errors import ConfigError

PROFILE_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"
"""Environment variable that Fast DDS reads; a value set by the user is kept."""

PROFILE_PATH = Path(__file__).with_name("fastdds.xml")
"""Shared memory of 16 MiB with messages up to 8 MiB, beside UDP with buffers of 4 MiB; quick discovery."""

LOCAL_PROFILE_PATH = Path(__file__).with_name("fastdds_local.xml")
"""The same on the loopback interface alone, without multicast: nothing outside this machine can reach it."""

UDP_PROFILE_PATH = Path(__file__).with_name("fastdds_udp.xml")
"""UDP alone: connects programs of two accounts of one machine."""

PRIVATE_UMASK = 0o077
"""File mode mask of processes with depth images: other accounts may not read their files."""

NODES: tuple[str, ...] = ("denoise", "matcher", "refine", "recovery")
"""The nodes, in the order in which they process a frame."""

_RANGE_VARIABLE = "ROS_AUTOMATIC_DISCOVERY_RANGE"

os.environ.setdefault(PROFILE_VARIABLE, str(PROFILE_PATH))


def stay_local() -> None:
    """Restrict this process and its children to the loopback interface; call before rclpy is initialised.

    Raises
    ------
    ConfigError
        If the user has set a profile, which would conflict.
    """
    if os.environ[PROFILE_VARIABLE] not in (str(PROFILE_PATH), str(LOCAL_PROFILE_PATH)):
        raise ConfigError(
            f"{PROFILE_VARIABLE} names a profile of yours; unset it to stay local, or restrict that profile"
        )
    os.environ[PROFILE_VARIABLE] = str(LOCAL_PROFILE_PATH)
    os.environ[_RANGE_VARIABLE] = "SYSTEM_DEFAULT"  # any other value opens further sockets
