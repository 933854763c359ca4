"""Render the command reference of the manual from the commands themselves; mkdocs calls it as a hook."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "src"))

from typer.main import get_command

from depth_pose.cli.app import app

MARKER = "<!-- commands -->"


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Replace the marker of the page with all commands."""
    return markdown.replace(MARKER, "\n".join(reference())) if MARKER in markdown else markdown


def reference() -> Iterator[str]:
    """Yield the lines of all commands: prose, examples, and a table of the options."""
    yield from _commands(get_command(app), ())


def _commands(command: Any, names: tuple[str, ...]) -> Iterator[str]:
    if not hasattr(command, "commands"):
        yield f"## {' '.join(names)}"
        yield ""
        yield from _prose(command.help or "")
        yield from _table(command.params)
        return
    for name, inner in command.commands.items():
        yield from _commands(inner, (*names, name))


def _prose(text: str) -> Iterator[str]:
    """Yield the paragraphs, and the lines that are commands as a block."""
    paragraphs = [_plain(p) for p in text.split("\n\n")]
    for paragraph in paragraphs:
        if not paragraph.startswith(("depth-pose ", "Examples:")):
            yield from (_escaped(paragraph), "")
    examples = [p for p in paragraphs if p.startswith("depth-pose ")]
    if examples:
        yield from ("```bash", *examples, "```", "")


def _plain(text: str) -> str:
    return " ".join(re.sub(r"\[/?bold\]", "", text).replace("\\[", "[").split())


def _escaped(text: str) -> str:
    """Return text whose placeholders and tables are shown as they are."""
    return text.replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*")


def _table(params: list[Any]) -> Iterator[str]:
    rows = [row for param in params if not getattr(param, "hidden", False) for row in _row(param)]
    if rows:
        yield from ("| argument, option | meaning | default |", "|---|---|---|", *rows, "")


def _row(param: Any) -> Iterator[str]:
    is_argument = param.param_type_name == "argument"
    names = (
        param.metavar or param.name.upper() if is_argument else ", ".join(param.opts + param.secondary_opts)
    )
    if not is_argument and param.metavar:
        names += f" {param.metavar}"
    if param.required:
        default = "required"
    elif isinstance(param.show_default, str):
        default = param.show_default
    else:
        default = "" if param.default in (None, False) or callable(param.default) else str(param.default)
    text = _escaped(_plain(param.help or "")) + _range(param)
    yield f"| `{names}` | {text} | {_escaped(default)} |"


def _range(param: Any) -> str:
    """Return the range of a number, in words."""
    low, high = getattr(param, "min", None), getattr(param, "max", None)
    if low is None and high is None:
        return ""
    if high is None:
        return f" At least {low:g}."
    return f" From {low or 0:g} to {high:g}."
