"""Shared by the commands: consoles, progress bars, options made from the configuration."""

from __future__ import annotations

import inspect
import os
import signal
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import typer
from rich.markup import escape

from depth_pose.cli import STOPPED
from depth_pose.core import progress
from depth_pose.core.errors import ConfigError
from depth_pose.core.options import options
from depth_pose.core.printable import printable, printable_lines
from depth_pose.core.progress import SafeConsole, archive_bar, errors, progress_bar

__all__ = [
    "archive_bar",
    "check_ending",
    "console",
    "errors",
    "given",
    "loading",
    "print_facts",
    "progress_bar",
    "say",
    "setting",
    "tell_error",
    "tell_stopped",
    "unwrap_help",
    "warn",
]

console = SafeConsole()


@contextmanager
def loading(what: str) -> Iterator[None]:
    """Announce loading and compiling; Ctrl-C ends the process, as the compiler loses a KeyboardInterrupt."""

    def stop(*_: object) -> None:
        errors.show_cursor()
        os._exit(STOPPED)

    is_heard = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if is_heard:
        signal.signal(signal.SIGINT, stop)
    try:
        with progress.loading(what):
            yield
    finally:
        if is_heard:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def setting(config: type, name: str, *flags: str) -> Any:
    """Make the command-line option of a setting, with its help, range and default.

    The default is None, so that a settings file can provide the value.
    """
    found = next(o for o in options(config) if o.name == name)
    unit = f" {found.unit}" if found.unit else ""
    text = found.help + (f" ({', '.join(found.choices)})" if found.choices else "")
    text += f" ({found.unit})" if found.unit else ""
    kinds: dict[str, Any] = {}
    if not isinstance(found.default, (str, bool)):
        kinds = {"min": _shortest(found.low), "max": _shortest(found.high)}
    return typer.Option(
        *(flags or (f"--{name.replace('_', '-')}",)),
        help=escape(text),
        show_default=f"{found.default}{unit}" or "empty",
        **kinds,
    )


def _shortest(bound: float | None) -> float | None:
    """Return a bound as an int where it is whole: help prints 360, not 360.0, which would not fit a line."""
    return int(bound) if bound is not None and bound == int(bound) else bound


def unwrap_help(app: typer.Typer) -> None:
    """Join the lines of each paragraph of the commands' help, so that the terminal's width breaks them."""
    for command in app.registered_commands:
        if command.callback is not None:
            paragraphs = inspect.cleandoc(command.help or command.callback.__doc__ or "").split("\n\n")
            command.help = "\n\n".join(paragraph.replace("\n", " ") for paragraph in paragraphs)
    for group in app.registered_groups:
        if group.typer_instance is not None:
            unwrap_help(group.typer_instance)


def check_ending(output: Path | None, ending: str, what: str) -> None:
    """Check the extension of an output, before any work; None for an output that was not requested.

    Raises
    ------
    ConfigError
        If it is another one.
    """
    if output is not None and output.suffix.lower() != ending:
        raise ConfigError(f"{output} must be {what}: its name ends in {ending}")


def given(**values: Any) -> dict[str, Any]:
    """Return the options that were given."""
    return {name: value for name, value in values.items() if value is not None}


def print_facts(title: str, facts: Iterable[tuple[str, str]]) -> None:
    """Print a small table of names and values."""
    from rich.table import Table

    table = Table(title=escape(printable(title)), title_justify="left", title_style="bold", show_header=False)
    table.add_column(style="dim")
    table.add_column()
    for name, value in facts:
        table.add_row(escape(printable(name)), escape(printable(value)))
    console.print(table)


def tell_stopped(stopped: BaseException) -> None:
    """Print the state of the output after Ctrl-C."""
    errors.print(f"stopped; {printable(stopped)}", highlight=False, markup=False, soft_wrap=True)


def say(line: str) -> None:
    """Print one line, for instance the file that was written."""
    console.print(printable(line), highlight=False, markup=False, soft_wrap=True)


def tell_error(error: object) -> None:
    """Print an error."""
    errors.print(
        f"[bold red]error:[/bold red] {escape(printable_lines(error))}", highlight=False, soft_wrap=True
    )


def warn(lines: Iterable[str]) -> None:
    """Print warnings, one line each."""
    for line in lines:
        errors.print(f"[yellow]warning:[/yellow] {escape(printable(line))}", highlight=False, soft_wrap=True)
