"""Dataclass fields for settings, which carry their unit, range and one line of help.

ROS parameters, command-line options and YAML files are generated from them and validated by them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

from depth_pose.core.errors import ConfigError
from depth_pose.core.removed_options import FORMER_SECTIONS, explain_removed

T = TypeVar("T")


def option(
    default: Any,
    help: str,
    *,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
) -> Any:
    """Make a dataclass field that carries its unit, range and help."""
    return field(
        default=default,
        metadata={"help": help, "unit": unit, "low": low, "high": high, "choices": choices},
    )


@dataclass(frozen=True)
class Option:
    """One setting in the form of a ROS parameter or command-line option."""

    name: str
    default: bool | int | float | str
    help: str
    unit: str
    low: float | None
    high: float | None
    choices: tuple[str, ...]


def options(config: type | object) -> Iterator[Option]:
    """Return every setting of a configuration class, or of an instance with its values."""
    for f in fields(config):  # type: ignore[arg-type]
        default: Any = f.default if isinstance(config, type) else getattr(config, f.name)
        yield Option(name=f.name, default=default, **f.metadata)


class Checked:
    """Base that rejects values of the wrong type or outside their range."""

    def __post_init__(self) -> None:
        for o in options(self):
            _check(type(self).__name__, o)


def _check(owner: str, o: Option) -> None:
    where = f"{owner}.{o.name}"
    value = o.default
    if isinstance(value, float) and value != value:
        raise ConfigError(f"{where} is NaN; give a number")
    if o.low is not None and value < o.low:  # type: ignore[operator]
        raise ConfigError(f"{where} is {value}; the least it may be is {o.low} {o.unit}".rstrip())
    if o.high is not None and value > o.high:  # type: ignore[operator]
        raise ConfigError(f"{where} is {value}; the most it may be is {o.high} {o.unit}".rstrip())
    if o.choices and o.default not in o.choices:
        raise ConfigError(f"{where} is {o.default!r}; it is one of {', '.join(o.choices)}")


def from_mapping(config: type[T], values: Mapping[str, Any]) -> T:
    """Make a configuration from a mapping; an unknown key is an error.

    Raises
    ------
    ConfigError
        Where a key is unknown, or a value is of the wrong type or out of range.
    """
    known = {o.name: o for o in options(config)}
    unknown = sorted(map(str, set(values) - set(known)))
    if unknown:
        raise ConfigError(
            f"{config.__name__} has no setting {', '.join(unknown)}; it has {', '.join(sorted(known))}"
        )
    made: dict[str, Any] = {}
    for name, value in values.items():
        made[name] = _as(type(known[name].default), value, f"{config.__name__}.{name}")
    return config(**made)


def _as(kind: type, value: Any, where: str) -> Any:
    """Convert a value to the type of a setting; whole numbers are accepted for any number."""
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:
            raise ConfigError(f"{where} is larger than any number of its kind") from None
    if type(value) is not kind:
        raise ConfigError(f"{where} is {value!r}; it must be of type {kind.__name__}")
    return value


def _section(name: str, config: type[T], values: Mapping[str, Any]) -> T:
    """Make one section; error messages name the section, as parameter files do."""
    if not isinstance(values, Mapping):
        raise ConfigError(f"{name} is {values!r:.80}; it must be a mapping of settings")
    _refuse_removed(name, set(values) - {o.name for o in options(config)})
    try:
        return from_mapping(config, values)
    except ConfigError as error:
        raise ConfigError(str(error).replace(config.__name__, name)) from None


def _refuse_removed(section: str, unknown: Iterable[str]) -> None:
    reasons = [reason for name in sorted(unknown) if (reason := explain_removed(section, name))]
    if reasons:
        raise ConfigError("\n".join(reasons))


class Sections:
    """Base of configurations that consist of others, one field for each."""

    @classmethod
    def from_mapping(cls: type[T], values: Mapping[str, Mapping[str, Any]]) -> T:
        """Make it from nested mappings, ``{"segment": {"near": 0.5}}``; unknown keys are errors."""
        sections: dict[str, Any] = {f.name: type(f.default) for f in fields(cls)}  # type: ignore[arg-type]
        if not isinstance(values, Mapping):
            given = f"the settings are {values!r:.80}"
            raise ConfigError(f"{given}; give a mapping by step, {{'segment': {{'far': 4.0}}}}")
        unknown = sorted(map(str, set(values) - set(sections)))
        for name in FORMER_SECTIONS.intersection(unknown):
            _refuse_removed(name, values[name])
        if unknown:
            raise ConfigError(f"no such section: {', '.join(unknown)}; there are {', '.join(sections)}")
        return cls(**{name: _section(name, sections[name], part) for name, part in values.items()})

    def as_mapping(self) -> dict[str, dict[str, Any]]:
        """Return every setting, nested by step."""
        return dataclasses.asdict(self)  # type: ignore[call-overload, no-any-return]
