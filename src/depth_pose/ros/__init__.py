"""The four ROS 2 nodes and what serves them. Nothing outside this package imports rclpy.

Importing it names the shipped Fast DDS profile (`fastdds.xml`) in the environment, unless
the user has named one: Fast DDS reads that variable once, so it has to stand there before
the first participant is made, and child processes inherit it.
"""

from __future__ import annotations

import os
from pathlib import Path

PROFILE_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"
"""What Fast DDS reads; a value that the user has set is kept."""

PROFILE_PATH = Path(__file__).with_name("fastdds.xml")
"""Shared memory of 32 MiB with messages up to 8 MiB, beside UDP; quick discovery."""

os.environ.setdefault(PROFILE_VARIABLE, str(PROFILE_PATH))
