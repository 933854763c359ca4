"""Damage of recordings is told on a logger of its own, so that who runs a command can act on it."""

from __future__ import annotations

import logging
from collections.abc import Iterable

DAMAGE_LOG = logging.getLogger("depth_pose.damage")
"""Gets one warning for each recording that could not be read as a whole, when reading it has ended."""


def tell_damage(lines: Iterable[str]) -> None:
    """Tell what could not be read, one line a file."""
    for line in lines:
        DAMAGE_LOG.warning("%s", line)
