"""Picture files: written completely or not at all, with the format checked before the work."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from depth_pose.core.errors import ConfigError
from depth_pose.core.extras import require
from depth_pose.core.outputs import check_targets, new_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LONGEST_NAME = 100
"""Maximum number of letters drawn of a name."""

FORMATS = ("png", "jpg", "jpeg", "webp", "tif", "tiff", "pdf", "svg")


def check_picture(path: Path | str | None, inputs: Iterable[Path | str | None] = ()) -> None:
    """Refuse a picture that cannot be written, before any work; does nothing if the path is None.

    Parameters
    ----------
    path : path, optional
    inputs : iterable of path
        As for `depth_pose.core.outputs.check_targets`.

    Raises
    ------
    ConfigError
        Where its extension is not a known format, or matplotlib is not installed.
    InputError
        As for `depth_pose.core.outputs.check_targets`.
    """
    if path is not None:
        _format_of(Path(path))
        check_targets([path], inputs)
        require("matplotlib", "a picture")


def save_picture(figure: Figure, path: Path | str, **options: Any) -> None:
    """Write a figure; the format is inferred from the file extension, PNG without one.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    path : path
        The file; folders are made.
    **options
        Of ``Figure.savefig``.
    """
    ending = _format_of(Path(path))
    with new_file(path) as stream:
        figure.savefig(stream, format=ending, **options)


def plain_text(name: str) -> str:
    """Return a file or person name for drawing: no formula, printable, shortened."""
    shown = name.encode("utf-8", "backslashreplace").decode()
    shown = "".join(letter if letter.isprintable() else " " for letter in shown)
    shown = shown if len(shown) <= _LONGEST_NAME else f"{shown[:_LONGEST_NAME]}…"
    return shown.replace("$", r"\$")


def _format_of(path: Path) -> str:
    ending = path.suffix[1:].lower() or "png"
    if ending not in FORMATS:
        raise ConfigError(f"{path}: pictures are of the formats {', '.join(FORMATS)}, not {ending}")
    return ending
