"""Files of settings: by step, or as parameters of the nodes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from depth_pose.core.config import SHORT_NAMES, PipelineConfig
from depth_pose.core.errors import ConfigError
from depth_pose.core.options import Sections
from depth_pose.core.reading import parse_json, parse_yaml, read_text


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
