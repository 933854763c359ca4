"""The ROS 2 nodes, and what they are told apart by."""

NODES: tuple[str, ...] = ("denoise", "matcher", "refine", "recovery")
"""The nodes of the suite, in the order that a frame passes them."""

READY = "is ready"
"""A node logs this once it is active and its connections stand; the supervisor waits for it."""
