"""Input files: only ordinary ones of plausible size are read, as text, JSON or YAML.

Files are not trusted: a pipe or a device is refused and not waited for, sizes are limited before anything
is allocated, and any error of a parser becomes one line.
"""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from depth_pose.core.errors import ConfigError, DepthPoseError, InputError
from depth_pose.core.system import open_flags

MOST_SETTINGS_BYTES = 1 << 20
"""Size limit of settings, rig and build files (bytes): a hundred times a rig of 100 cameras."""

MOST_VALUES = 20_000
"""Maximum number of values of a YAML file, with aliases expanded; one of 100 cameras has 4,000."""

_DEEPEST = 100
"""Maximum nesting depth of YAML written by programs; rosbag2's has 6."""

_PARSER_ERRORS = (ValueError, LookupError, TypeError, AttributeError, OverflowError, RecursionError)
"""Errors of parsers besides their own types: invalid dates, numbers too long, nesting too deep."""


@contextmanager
def open_ordinary(path: Path | str, most_bytes: int | None = None) -> Iterator[BinaryIO]:
    """Open an ordinary file to be read, no pipe and no device.

    Parameters
    ----------
    path : path
    most_bytes : int, optional
        A larger file is refused.

    Yields
    ------
    binary stream

    Raises
    ------
    InputError
        Where it is missing, unreadable, not an ordinary file, or too large.
    """
    try:
        number = os.open(path, os.O_RDONLY | open_flags("O_NONBLOCK", "O_CLOEXEC"))
    except (OSError, ValueError) as error:  # ValueError: a name with a zero byte in it
        raise InputError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}") from error
    found = os.fstat(number)
    if not stat.S_ISREG(found.st_mode):
        os.close(number)
        kind = "a folder" if stat.S_ISDIR(found.st_mode) else "a device or a pipe"
        raise InputError(f"{path} cannot be read: it is {kind}, not a file")
    with os.fdopen(number, "rb") as stream:
        if most_bytes is not None and found.st_size > most_bytes:
            size, most = found.st_size / 1e6, most_bytes / 1e6
            raise InputError(f"{path} cannot be read: it has {size:.1f} MB; at most {most:.1f} MB are read")
        yield stream


def read_text(path: Path | str, most_bytes: int = MOST_SETTINGS_BYTES, errors: str = "strict") -> str:
    """Read a whole file of UTF-8 text.

    Parameters
    ----------
    path : path
    most_bytes : int
        A larger file is refused.
    errors : str
        As for ``bytes.decode``: ``strict``, or ``replace`` if wrong characters are harmless.

    Raises
    ------
    InputError
        As of `open_ordinary`, or where it is not UTF-8.
    """
    try:
        with open_ordinary(path, most_bytes) as stream:
            return stream.read().decode("utf-8-sig", errors)
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not UTF-8 text: {error.reason} at byte {error.start}") from error
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from error


def parse_json(path: Path | str, text: str, error: type[DepthPoseError] = ConfigError) -> Any:
    """Parse a file's JSON; ``error`` is raised if it is invalid."""
    try:
        return json.loads(text)
    except _PARSER_ERRORS as found:
        raise error(f"{path} is not JSON: {_one_line(found)}") from found


def parse_yaml(path: Path | str, text: str) -> Any:
    """Parse a file's YAML.

    Aliases (``*name``) count with all values that they expand to, up to `MOST_VALUES`.

    Raises
    ------
    ConfigError
        Where it is not YAML, or too large.
    """
    import yaml

    class Loader(yaml.SafeLoader):  # type: ignore[misc]
        """Loader that counts the values of each node with aliases expanded, and rejects too many."""

        def compose_node(self, parent: Any, index: Any) -> Any:
            sizes = self.__dict__.setdefault("sizes", {})
            is_alias, mark = self.check_event(yaml.AliasEvent), self.peek_event().start_mark
            node = super().compose_node(parent, index)
            if is_alias and id(node) not in sizes:
                raise yaml.composer.ComposerError(None, None, "an alias refers to its own ancestor", mark)
            inside = node.value if isinstance(node, yaml.CollectionNode) else ()
            parts = [part for value in inside for part in (value if isinstance(value, tuple) else (value,))]
            sizes[id(node)] = 1 + sum(sizes[id(part)] for part in parts)
            if sizes[id(node)] > MOST_VALUES:
                raise yaml.composer.ComposerError(None, None, f"it holds over {MOST_VALUES} values", mark)
            return node

    try:
        return yaml.load(text, Loader)
    except (yaml.YAMLError, *_PARSER_ERRORS) as error:
        raise ConfigError(f"{path} is not YAML: {_one_line(error)}") from error


def parse_long_yaml(path: Path | str, text: str) -> Any:
    """Parse YAML written by programs, of any length; if it has aliases, as `parse_yaml` does.

    Raises
    ------
    ConfigError
        Where it is not YAML, or its aliases expand to too many values.
    """
    import yaml

    loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        depth = 0
        for event in yaml.parse(text, loader):
            if isinstance(event, yaml.AliasEvent):
                return parse_yaml(path, text)
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > _DEEPEST:  # its time grows as the square of the depth
                raise RecursionError
        return yaml.load(text, loader)
    except (yaml.YAMLError, *_PARSER_ERRORS) as error:
        raise ConfigError(f"{path} is not YAML: {_one_line(error)}") from error


def _one_line(error: Exception) -> str:
    text = " ".join(str(error).split()) or type(error).__name__
    return "its nesting is too deep" if isinstance(error, RecursionError) else text
