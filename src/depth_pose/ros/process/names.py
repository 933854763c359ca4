"""What the processes of a suite are called, and the words that they say to their supervisor."""

from __future__ import annotations

NODES: tuple[str, ...] = ("denoise", "matcher", "refine", "recovery")
"""The nodes, in the order that a frame passes them."""

LOADED = "fork server is loaded"
"""The fork server prints this when it forks at once."""

WAITS = "waits to become a node"
"""A forked process prints this when it has imported what a node needs, and has joined the graph."""

READY = "is ready"
"""A node logs this once it is active and its connections stand."""

PROCESS_ID, EXIT_CODE = "process id: ", "exit code: "
"""What the first and the last line of a forked process begin with."""
