"""What the commands share: consoles, progress bars, options made from the configuration."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.text import Text

from depth_pose.core.config import SHORT_NAMES, PipelineConfig
from depth_pose.core.errors import ConfigError
from depth_pose.core.options import Sections, options
from depth_pose.core.printable import printable, printable_lines
from depth_pose.core.reading import parse_json, parse_yaml, read_text

if TYPE_CHECKING:
    from collections.abc import Callable

_OBEYED = {n: ascii(chr(n))[1:-1] for n in (*range(32), *range(127, 160)) if chr(n) not in "\n\t"}
"""Control characters but for line breaks and tabs, and how they are shown."""


class SafeConsole(Console):
    """A console that shows control characters of what it prints; rich would have the terminal obey them."""

    def render_str(self, text: str, **options: Any) -> Text:
        """Make rich's text of a string, which may have rich's markup."""
        return super().render_str(text.translate(_OBEYED), **options)


console = SafeConsole()
errors = SafeConsole(stderr=True)

_LEAST_LINE_GAP_S = 2.0
"""Least time between two lines of progress where the output is no terminal, seconds. Set by hand."""

_LONG_S = 10.0
"""Seconds of loading after which an output that is no terminal is told of it; set by hand."""


def setting(config: type, name: str, *flags: str) -> Any:
    """Make the command-line option of a setting, with its help, range and default.

    An option that is not given is None, so that a file of settings may give it.
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
    """Keep what was given on the command line."""
    return {name: value for name, value in values.items() if value is not None}


def read_settings(path: Path, config: type[Sections] = PipelineConfig) -> dict[str, dict[str, Any]]:
    """Read a file of settings: YAML or JSON, by step, or a ROS parameter file with those steps.

    Raises
    ------
    InputError
        Where it cannot be read.
    ConfigError
        Where it is no mapping of mappings.
    """
    text = read_text(path)
    values = parse_json(path, text) if path.suffix.lower() == ".json" else parse_yaml(path, text)
    if values is None:
        return {}
    if isinstance(values, Mapping) and "/**" in values:
        inside = values["/**"]
        everything = inside.get("ros__parameters") if isinstance(inside, Mapping) else None
        if not isinstance(everything, Mapping) or not all(isinstance(name, str) for name in everything):
            raise ConfigError(f"{path}: /** is to hold ros__parameters, a mapping of names to values")
        sections = config().as_mapping()
        everything = dict(_long_name(name, value) for name, value in everything.items())
        values = _nested({k: v for k, v in everything.items() if k.partition(".")[0] in sections})
    if not isinstance(values, Mapping) or not all(isinstance(part, Mapping) for part in values.values()):
        raise ConfigError(f"{path} is to hold settings by step, for instance 'segment: {{near: 0.5}}'")
    odd = [name for part in values.values() for name in part if not isinstance(name, str)]
    if odd:
        raise ConfigError(f"{path}: {odd[0]!r} is no setting's name")
    return {str(name): dict(part) for name, part in values.items()}


def _long_name(name: str, value: Any) -> tuple[str, Any]:
    """Give the section's name and the field's for a ROS parameter that is named without its section."""
    if name in SHORT_NAMES and not isinstance(value, Mapping):
        return ".".join(SHORT_NAMES[name]), value
    return name, value


def _nested(flat: Mapping[str, Any]) -> dict[str, Any]:
    """Make ``{"a": {"b": 1}}`` of ``{"a.b": 1}``."""
    nested: dict[str, Any] = {}
    for name, value in flat.items():
        section, dot, key = name.partition(".")
        if dot:
            nested.setdefault(section, {})[key] = value
        elif isinstance(value, Mapping):
            nested.setdefault(section, {}).update(value)
        else:
            nested[section] = value
    return nested


@contextmanager
def progress_bar(what: str, total: int | None) -> Iterator[Callable[[int], None]]:
    """Show a progress bar; gives a function that is told how many are done.

    Where the output is no terminal, each tenth is a line.
    """
    with _bar(what, total, lambda done: f"{done}/{total}" if total else str(done)) as update:
        yield lambda done: update(done, done)


@contextmanager
def archive_bar(what: str, size: int, recordings: int) -> Iterator[Callable[[float, int, int], None]]:
    """Show the bar of an archive; gives a function that is told the bytes, recordings and frames done."""
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
    """Show a bar; gives a function that is told how much is done, and of how many the rate is shown."""
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
def loading(what: str) -> Iterator[None]:
    """Tell of loading and compiling kernels: at once on a terminal, else by a line once it takes long."""
    text = f"loading {what} and compiling the kernels: seconds, the first time minutes"
    if console.is_terminal:
        with console.status(text):
            yield
        return
    tell = threading.Timer(_LONG_S, errors.print, [text], {"highlight": False, "soft_wrap": True})
    tell.daemon = True
    tell.start()
    try:
        yield
    finally:
        tell.cancel()


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
    """Say what Ctrl-C has left."""
    errors.print(f"stopped; {printable(stopped)}", highlight=False, markup=False, soft_wrap=True)


def say(line: str) -> None:
    """Print one line, for instance which file was written."""
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
