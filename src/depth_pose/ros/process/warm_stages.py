"""The bank and the stages that the fork server makes before the nodes are there.

A node finds them here if it asks for the same. A process that was started by itself makes its own.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar, cast

from depth_pose.bank import Bank, default_bank_path

T = TypeVar("T")

_made: dict[type, tuple[tuple[Any, ...], Any]] = {}
_given: list[Any] = []


def load_bank(path: str | Path = "") -> Bank:
    """Read a bank, empty for the set-up's, or give the one that was read from this file before.

    Raises
    ------
    BankError
        If the file is missing, damaged or foreign.
    """
    file = Path(path) if path else default_bank_path()
    return _load(file, file.stat().st_mtime_ns if file.is_file() else 0)


@lru_cache(maxsize=1)
def _load(file: Path, changed_ns: int) -> Bank:
    return Bank.load(file)


def make_ahead(kind: type[Any], *arguments: Any) -> None:
    """Make a stage, compile or load all it needs, and keep it for the first `make` that asks for it."""
    stage = kind(*arguments)
    stage.warm_up()
    _made[kind] = arguments, stage


def make(kind: type[T], *arguments: Any) -> T:
    """Make a stage, or take the one that was made ahead with equal arguments, which is given once."""
    known, stage = _made.pop(kind, ((), None))
    if stage is None or known != arguments:
        return kind(*arguments)
    _given.append(stage)
    return cast(T, stage)


def is_warm(stage: Any) -> bool:
    """Whether a stage was made ahead."""
    return any(stage is given for given in _given)
