"""Shared by the commands: consoles, progress bars, options made from the configuration."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import typer
from rich.markup import escape

from depth_pose.core.options import options
from depth_pose.core.printable import printable, printable_lines
from depth_pose.core.progress import SafeConsole, archive_bar, errors, loading, progress_bar

__all__ = [
    "archive_bar",
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
    "warn",
]

console = SafeConsole()


def setting(config: type, name: str, *flags: str) -> Any:
    """Make the command-line option of a setting, with its help, range and default.

    The default is None, so that a settings file can provide the value.
    """
    found = next(o for o in options(config) if o.name == name)
    unit = f" {found.unit}" if found.unit else ""
    text = found.help + (f" ({', '.join(found.choices)})" if found.choices else "")
    kinds: dict[str, Any] = {}
    if not isinstance(found.default, (str, bool)):
        kinds = {"min": found.low, "max": found.high}
    return typer.Option(
        *(flags or (f"--{name.replace('_', '-')}",)),
        help=escape(text),
        show_default=f"{found.default}{unit}",
        **kinds,
    )


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
