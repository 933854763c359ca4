"""What a constant is multiplied by, and how."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

FACTORS = (0.5, 2.0)


def environment(constant: str, factor: float) -> dict[str, str]:
    """Return what changes a constant, as ``rooms.watch:MOVED_M``, in processes started with it."""
    paths = [str(Path(__file__).resolve().parent), *filter(None, [os.environ.get("PYTHONPATH")])]
    changed = f"depth_pose.{constant}:{factor}"
    return {"PYTHONPATH": os.pathsep.join(paths), "CHANGED_CONSTANT": changed}


def times(value: Any, factor: float) -> Any:
    """Return a number, or those of a table, times a factor; counts stay whole, all else as it is."""
    match value:
        case tuple():
            parts = [times(part, factor) for part in value]
            return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
        case dict():
            return {name: times(part, factor) for name, part in value.items()}
        case bool():
            return value
        case int():
            return max(1, round(factor * value)) if value else 0
        case float() | np.floating() | np.ndarray():
            return factor * value
        case _:
            return value
