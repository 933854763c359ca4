"""Shared by the commands: consoles, progress bars, options made from the configuration."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import typer
from rich.markup import escape

from depth_pose.core.config import SHORT_NAMES, PipelineConfig
from depth_pose.core.errors import ConfigError
from depth_pose.core.options import Sections, options
from depth_pose.core.printable import printable, printable_lines
from depth_pose.core.progress import SafeConsole, archive_bar, errors, loading, progress_bar
from depth_pose.core.reading import parse_json, parse_yaml, read_text

__all__ = [
    "archive_bar",
    "console",
    "errors",
    "given",
    "loading",
    "print_facts",
    "progress_bar",
    "read_settings",
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


def read_settings(path: Path, config: type[Sections] = PipelineConfig) -> dict[str, dict[str, Any]]:
    """Read a settings file: YAML or JSON by step, or a ROS parameter file with those steps.

    Raises
    ------
    InputError
        Where it cannot be read.
    ConfigError
        Where it is not a mapping of mappings.
    """
    text = read_text(path)
    values = parse_json(path, text) if path.suffix.lower() == ".json" else parse_yaml(path, text)
    if values is None:
        return {}
    if isinstance(values, Mapping) and "/**" in values:
        inside = values["/**"]
        everything = inside.get("ros__parameters") if isinstance(inside, Mapping) else None
        if not isinstance(everything, Mapping) or not all(isinstance(name, str) for name in everything):
            raise ConfigError(f"{path}: /** must hold ros__parameters, a mapping of names to values")
        sections = config().as_mapping()
        everything = dict(_long_name(name, value) for name, value in everything.items())
        values = _nested({k: v for k, v in everything.items() if k.partition(".")[0] in sections})
    if not isinstance(values, Mapping) or not all(isinstance(part, Mapping) for part in values.values()):
        raise ConfigError(f"{path} must hold settings by step, for instance 'segment: {{near: 0.5}}'")
    odd = [name for part in values.values() for name in part if not isinstance(name, str)]
    if odd:
        raise ConfigError(f"{path}: {odd[0]!r} is not the name of a setting")
    return {str(name): dict(part) for name, part in values.items()}


def _long_name(name: str, value: Any) -> tuple[str, Any]:
    """Return the full name, SECTION.FIELD, of a ROS parameter that is given without its section."""
    if name in SHORT_NAMES and not isinstance(value, Mapping):
        return ".".join(SHORT_NAMES[name]), value
    return name, value


def _nested(flat: Mapping[str, Any]) -> dict[str, Any]:
    """Convert ``{"a.b": 1}`` to ``{"a": {"b": 1}}``."""
    nested: dict[str, Any] = {}
    for name, value in flat.items():
        section, dot, key = name.partition(".")
        more = {key: value} if dot else value
        before = nested.get(section, {})
        if isinstance(before, Mapping):
            nested[section] = {**before, **more} if isinstance(more, Mapping) else more
    return nested


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
