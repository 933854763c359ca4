"""Starting, watching and ending the nodes' processes."""

from __future__ import annotations

NODES: tuple[str, ...] = ("denoise", "matcher", "refine", "recovery")
"""The nodes, in the order that a frame passes them."""

HOST, SECOND_HOST = "host", "second host"
"""The process that forks the others, and one that waits to take its place."""

SPARES: tuple[str, ...] = tuple(f"spare {number + 1}" for number in range(len(NODES)))
"""Those that wait to take a node's place, as many as there are nodes."""

READY = "is ready"
"""A process prints this once it can do its work: a node when it is active and its connections stand."""

DONE = "has done its work"
"""A node prints this before it says goodbye to others: now and then Fast DDS does not return from that."""

PID = "\x1e"
"""A forked process' first line: this (ASCII's record separator), and its process id."""

BEAT, BEAT_S = b"\0", 0.25
"""Sign of life among what a process prints, and the seconds between two: a tenth of the patience, by hand."""
