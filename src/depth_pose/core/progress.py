"""Progress bars, and lines of progress where the output is not a terminal; all on standard error."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.text import Text

_OBEYED = {n: ascii(chr(n))[1:-1] for n in (*range(32), *range(127, 160)) if chr(n) not in "\n\t"}
"""Control characters but for line breaks and tabs, and how they are shown."""


class SafeConsole(Console):
    """A console that escapes control characters in its output; rich would pass them to the terminal."""

    def render_str(self, text: str, **options: Any) -> Text:
        """Return rich's text of a string, which may have rich's markup."""
        return super().render_str(text.translate(_OBEYED), **options)


errors = SafeConsole(stderr=True)
"""Standard error."""

_LEAST_LINE_GAP_S = 2.0
"""Minimum time between two lines of progress on an output that is not a terminal, seconds."""

_LONG_S = 10.0
"""Loading time after which an output that is not a terminal gets a line about it, seconds."""


@contextmanager
def progress_bar(what: str, total: int | None) -> Iterator[Callable[[int], None]]:
    """Show a progress bar; yield a function that takes the number of items done.

    If the output is not a terminal, each tenth is a line.
    """
    with _bar(what, total, lambda done: f"{done}/{total}" if total else str(done)) as update:
        yield lambda done: update(done, done)


@contextmanager
def archive_bar(what: str, size: int, recordings: int) -> Iterator[Callable[[float, int, int], None]]:
    """Show the bar of an archive; yield a function that takes the bytes, recordings and frames done."""
    done_recordings = 0
    with _bar(what, size, lambda _: f"{done_recordings}/{recordings}", " frames") as update:

        def tell(done: float, count: int, frames: int) -> None:
            nonlocal done_recordings
            done_recordings = count
            update(done, frames)

        yield tell


@contextmanager
def _bar(
    what: str, total: int | None, count: Callable[[float], str], unit: str = ""
) -> Iterator[Callable[[float, int], None]]:
    """Show a bar; yield a function that takes the amount done, and the count for the displayed rate."""
    if not errors.is_terminal:
        tell = _line_printer(what, total)
        yield lambda done, _: tell(done)
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=None),
        TextColumn("{task.fields[count]}"),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(compact=True),
    )
    with Progress(*columns, console=errors, transient=True, expand=True) as progress:
        task = progress.add_task(what, total=total, rate="", count="")

        def update(done: float, rated: int) -> None:
            elapsed = progress.tasks[task].elapsed or 0.0
            rate = f"{rated / elapsed:.1f}{unit}/s" if elapsed > 0.5 else ""
            progress.update(task, completed=done, rate=rate, count=count(done))

        yield update


def _line_printer(what: str, total: int | None) -> Callable[[float], None]:
    start = last = time.monotonic()
    told = 0

    def update(done: float) -> None:
        nonlocal last, told
        now = time.monotonic()
        tenth = int(10 * done / total) if total else 0
        if tenth > told and now - last > _LEAST_LINE_GAP_S:
            told, last = tenth, now
            errors.print(f"{what}: {10 * tenth} %, {now - start:.0f} s", highlight=False, markup=False)

    return update


@contextmanager
def loading(what: str, long_s: float = _LONG_S) -> Iterator[None]:
    """Announce loading and compiling: at once on a terminal, else by a line after ``long_s`` seconds."""
    text = f"loading {what} and compiling the kernels: seconds, the first time minutes"
    if errors.is_terminal:
        with errors.status(text):
            yield
        return
    tell = threading.Timer(long_s, errors.print, [text], {"highlight": False, "soft_wrap": True})
    tell.daemon = True
    tell.start()
    try:
        yield
    finally:
        tell.cancel()
