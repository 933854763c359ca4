"""Logger for damage in recordings, separate so that commands can act on it."""

from __future__ import annotations

import logging
from collections.abc import Iterable

DAMAGE_LOG = logging.getLogger("depth_pose.damage")
"""Receives one warning for each damaged recording, at the end of reading."""


def tell_damage(lines: Iterable[str]) -> None:
    """Log damage, one line per file."""
    for line in lines:
        DAMAGE_LOG.warning("%s", line)
