"""The bank and the stages that the host makes before it forks the nodes.

A node finds them here if it asks for the same. A process that was started by itself makes its own.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar, cast

from depth_pose.bank import Bank, default_bank_path
from depth_pose.core.config import PipelineConfig
from depth_pose.core.errors import BankError
from depth_pose.denoise.extract import PeopleExtractor
from depth_pose.match.match import Matcher
from depth_pose.recover.recover import Recoverer
from depth_pose.refine.refine import Refiner
from depth_pose.track.sample_people import sample_people

T = TypeVar("T")

_made: dict[type, tuple[tuple[Any, ...], Any]] = {}


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


def make_ahead(bank_path: str | Path = "") -> None:
    """Make the stages with the default settings, and use every kernel once, so that it is loaded.

    Without a bank there is only the first stage; the nodes that need it refuse it, and say why.
    """
    config = PipelineConfig()
    _keep(PeopleExtractor, config.segment, config.denoise, config.mount).warm_up()
    try:
        bank = load_bank(bank_path)
    except BankError:
        return
    people = sample_people(bank)
    matcher = _keep(Matcher, bank, config.match, config.fit)
    matches = matcher.match(people)  # its `warm_up` makes it a second time, as the refiner's does
    matcher.reset()
    refiner = _keep(Refiner, bank, config.refine, config.match, config.fitting)
    refiner.refine(people, matches)
    refiner.reset()
    _keep(Recoverer, bank, config.recover, config.smooth, config.match, config.fitting).warm_up()


def _keep(kind: type[T], *arguments: Any) -> T:
    _made[kind] = arguments, kind(*arguments)
    return cast(T, _made[kind][1])


def make(kind: type[T], *arguments: Any) -> T:
    """Make a stage, or take the one that was made ahead with equal arguments, as if it were new."""
    known, stage = _made.get(kind, ((), None))
    if stage is None or known != arguments:
        return kind(*arguments)
    stage.reset()
    return cast(T, stage)


def is_warm(stage: Any) -> bool:
    """Whether a stage was made ahead."""
    return any(stage is made for _, made in _made.values())
