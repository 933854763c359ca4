"""Report damage in recordings, and exit with code 3 unless ``--lenient`` was given."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from depth_pose.cli.console import errors, warn
from depth_pose.io.damage import DAMAGE_LOG, tell_damage

DAMAGED = 3
"""Exit code where part of a recording could not be read."""

LENIENT_HELP = "Damaged recordings are read as far as possible; do not exit with an error for them."


class _DamageLog(logging.Handler):
    """Printer of damage, each line once, that records whether there was any."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []
        self.lenient = False

    def emit(self, record: logging.LogRecord) -> None:
        line = record.getMessage()
        if line not in self.lines:
            self.lines.append(line)
            warn([line])


_damage_log = _DamageLog()


def be_lenient(wanted: bool) -> None:
    """Accept damage if ``--lenient`` was given."""
    _damage_log.lenient = _damage_log.lenient or wanted


def warn_of(lines: Iterable[str], damage: Iterable[str]) -> None:
    """Print warnings, some of which report damage."""
    damage = list(damage)
    warn(line for line in lines if line not in damage)
    tell_damage(damage)


@contextmanager
def exit_on_damage() -> Iterator[None]:
    """Exit with `DAMAGED` when the command inside succeeds on a damaged file."""
    _damage_log.lines.clear()
    _damage_log.lenient = False
    DAMAGE_LOG.addHandler(_damage_log)
    DAMAGE_LOG.propagate = False
    try:
        yield
    except SystemExit as end:
        if end.code or not _damage_log.lines or _damage_log.lenient:
            raise
        count = len(_damage_log.lines)
        what = "a recording is" if count == 1 else f"{count} recordings are"
        errors.print(
            f"[bold red]error:[/bold red] {what} damaged; what could be read was used (--lenient accepts it)",
            highlight=False,
            soft_wrap=True,
        )
        raise SystemExit(DAMAGED) from None
    finally:
        DAMAGE_LOG.removeHandler(_damage_log)
        DAMAGE_LOG.propagate = True
