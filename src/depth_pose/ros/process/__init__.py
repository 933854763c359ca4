"""Starting, watching and ending the nodes' processes."""

from __future__ import annotations

from depth_pose.ros import NODES as NODES

READY = "is ready"
"""A node prints this after its name when it is active and connected."""

DONE = "has done its work"
"""A node prints its name and this before it leaves the ROS graph, which Fast DDS does not always end."""

BEAT, BEAT_S = b"\0", 0.25
"""Sign of life in a node's output, and its period in seconds: a tenth of the patience."""
