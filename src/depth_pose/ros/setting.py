"""A parameter of a node that is not a setting of the core."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Setting:
    """A parameter of a node that is not a setting of the core; fixed once the node runs."""

    name: str
    default: bool | int | float | str | list[str] | list[float]
    help: str
    low: float | None = None
    high: float | None = None
    read_only: bool = True
