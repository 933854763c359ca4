"""Message classes and definitions by type name, e.g. ``sensor_msgs/msg/Image``."""

from __future__ import annotations

import importlib
import os
import re
import sys
from functools import cache
from pathlib import Path
from typing import Any

from depth_pose.core.errors import InputError

_TYPE = re.compile(r"([a-z][a-z0-9_]*)/(?:msg/)?([A-Z][A-Za-z0-9]*)")
"""A message type by the naming rules of ROS."""
_FIELD_TYPE = re.compile(r"^\s*([A-Za-z][A-Za-z0-9_]*(?:/[A-Za-z0-9_]+)*)(?:<=\d+)?(?:\[[^\]]*\])?\s+\w+")
_NUMBERS = [f"{kind}{bits}" for kind in ("int", "uint") for bits in (8, 16, 32, 64)]
"""Whole numbers of the ROS interface definition."""
_PRIMITIVES = frozenset(["bool", "byte", "char", "float32", "float64", "string", "wstring", *_NUMBERS])


def message_class(name: str) -> Any:
    """Import the class of a message type.

    Names come from recordings, so a module is imported only if ROS' index has the type's definition.

    Raises
    ------
    InputError
        If it is not the name of a type, or its package is not installed.
    """
    package, kind = _split(name)
    if not _share(package).joinpath("msg", f"{kind}.msg").is_file():
        raise InputError(f"message type {name} is not in the package {package} that is installed here")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), kind)
    except (ImportError, AttributeError) as e:
        raise InputError(f"message type {name} is not installed here: {e}") from e


@cache
def message_text(name: str) -> str:
    """Return the full definition of a type as in MCAP: its ``.msg`` file and those it refers to.

    The files are joined by a line of 80 ``=`` and ``MSG: package/Type``, each type once.
    """
    done: dict[str, str] = {}
    waiting = [_split(name)]
    while waiting:
        package, kind = waiting.pop(0)
        key = f"{package}/{kind}"
        if key in done:
            continue
        done[key] = _share(package).joinpath("msg", f"{kind}.msg").read_text(encoding="utf-8")
        waiting += _named_types(done[key], package)
    first, *others = done.items()
    return first[1] + "".join(f"\n{'=' * 80}\nMSG: {key}\n{text}" for key, text in others)


def _named_types(text: str, package: str) -> list[tuple[str, str]]:
    found = []
    for line in text.splitlines():
        match = _FIELD_TYPE.match(line.split("#")[0])
        if match is None or match[1] in _PRIMITIVES:
            continue
        parts = match[1].split("/")
        found.append((package if len(parts) == 1 else parts[0], parts[-1]))
    return found


def _split(name: str) -> tuple[str, str]:
    found = _TYPE.fullmatch(name)
    if found is None:
        raise InputError(f"{name[:80]!r} is not a message type; one is written like sensor_msgs/msg/Image")
    return found[1], found[2]


def _share(package: str) -> Path:
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    for prefix in filter(None, prefixes):
        path = Path(prefix, "share", package)
        if path.joinpath("msg").is_dir():
            return path
    raise InputError(
        f"the definitions of package {package} are not in any of {', '.join(filter(None, prefixes))}"
    )
