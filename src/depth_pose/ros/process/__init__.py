"""Starting, watching and ending the nodes' processes."""

from __future__ import annotations

NODES: tuple[str, ...] = ("denoise", "matcher", "refine", "recovery")
"""The nodes, in the order that a frame passes them."""

READY = "is ready"
"""A node logs this once it is active and its connections stand."""

EVENT = "\x1e"
"""A line of the host's that begins with this (ASCII's record separator) holds JSON."""
