"""Settings: one frozen dataclass per step, each field with its unit, range and one line of help.

ROS parameters, command-line options and YAML files are made from these fields, so every
default stands here and nowhere else.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

from depth_pose.core.errors import ConfigError

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
    """One setting as ROS parameters and command lines need it."""

    name: str
    default: bool | int | float | str
    help: str
    unit: str
    low: float | None
    high: float | None
    choices: tuple[str, ...]


def options(config: type | object) -> Iterator[Option]:
    """Give every setting of a configuration class, or of an instance with its values."""
    for f in fields(config):  # type: ignore[arg-type]
        default: Any = f.default if isinstance(config, type) else getattr(config, f.name)
        yield Option(name=f.name, default=default, **f.metadata)


class _Checked:
    """Base that refuses values of the wrong type or outside their range."""

    def __post_init__(self) -> None:
        for o in options(self):
            _check(type(self).__name__, o)


def _check(owner: str, o: Option) -> None:
    where = f"{owner}.{o.name}"
    if isinstance(o.default, float) and o.default != o.default:
        raise ConfigError(f"{where} is NaN; give a number")
    if o.low is not None and o.default < o.low:  # type: ignore[operator]
        raise ConfigError(f"{where} is {o.default}; the least it may be is {o.low} {o.unit}".rstrip())
    if o.high is not None and o.default > o.high:  # type: ignore[operator]
        raise ConfigError(f"{where} is {o.default}; the most it may be is {o.high} {o.unit}".rstrip())
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
    unknown = sorted(set(values) - set(known))
    if unknown:
        raise ConfigError(
            f"{config.__name__} has no setting {', '.join(unknown)}; it has {', '.join(sorted(known))}"
        )
    made: dict[str, Any] = {}
    for name, value in values.items():
        kind = type(known[name].default)
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if type(value) is not kind:
            raise ConfigError(f"{config.__name__}.{name} is {value!r}; it must be of type {kind.__name__}")
        made[name] = value
    return config(**made)


@dataclass(frozen=True)
class MountConfig(_Checked):
    """How the sensor is mounted."""

    roll: float = option(
        0.0,
        "How far the sensor is turned about its optical axis, clockwise as it looks; 180: upside down",
        unit="deg",
        low=-360.0,
        high=360.0,
    )


@dataclass(frozen=True)
class SegmentConfig(_Checked):
    """Finding the person in the depth image (Sec. 4, first paragraph)."""

    near: float = option(0.4, "Ignore anything nearer than this", unit="m", low=0.0, high=20.0)
    far: float = option(8.0, "Ignore anything farther than this", unit="m", low=0.1, high=50.0)
    working_height: int = option(
        144, "Images with more rows than this are reduced to about it", unit="px", low=48, high=1080
    )
    depth_jump: float = option(
        0.08,
        "Neighbouring pixels this far apart in depth are different surfaces",
        unit="m",
        low=0.01,
        high=1.0,
    )
    min_support: int = option(
        7, "Keep a pixel if this many of its 24 neighbours are on its surface", low=0, high=24
    )
    min_height: float = option(0.4, "The least visible extent of a person", unit="m", low=0.1, high=2.0)


@dataclass(frozen=True)
class DenoiseConfig(_Checked):
    """Modified locally optimal projection (Sec. 4, eqs. 1 to 5)."""

    support_radius: float = option(
        0.2, "Support h of the weight theta(r) = exp(-16 r^2 / h^2)", unit="m", low=0.01, high=1.0
    )
    repulsion: float = option(0.35, "Repulsion weight mu of eq. 3", low=0.0, high=0.499)
    iterations: int = option(
        1, "Number of steps in all; the first is eqs. 1 and 2, each further one eqs. 3 to 5", low=0, high=20
    )
    outlier_distance: float = option(
        0.06, "Drop points whose nearest neighbour is farther than this", unit="m", low=0.01, high=1.0
    )


@dataclass(frozen=True)
class MatchConfig(_Checked):
    """Matching with the exemplar bank (Sec. 5)."""

    shortlist: int = option(
        128, "Nearest exemplars in the subspace that are compared by rendered depth", low=1, high=4096
    )
    keep: int = option(3, "Candidates handed to the refinement", low=1, high=64)
    score_band: float = option(
        0.12, "Depth difference that counts as a full mismatch", unit="m", low=0.01, high=1.0
    )
    scale_frames: int = option(
        10, "Frames over which the person's size is estimated before it is held", low=1, high=1000
    )
    scale: float = option(0.0, "The person's size relative to a 1.75 m adult; 0 finds it", low=0.0, high=2.0)


@dataclass(frozen=True)
class RefineConfig(_Checked):
    """Fitting the body to the cloud (Sec. 6)."""

    method: str = option(
        "articulated",
        "articulated: joint angles of a skinned body; cpd: the paper's registration and completion",
        choices=("articulated", "cpd"),
    )
    track: bool = option(True, "Try the previous frame's pose beside the fresh candidates")


@dataclass(frozen=True)
class RecoverConfig(_Checked):
    """Failure detection and temporal registration (Sec. 6, last part)."""

    enabled: bool = option(True, "Look for failures and recover from them")
    bone_change: float = option(
        0.25, "Relative change of a bone's length between frames that counts as a failure", low=0.01, high=2.0
    )
    angle_excess: float = option(
        60.0, "Degrees beyond a joint's limit that count as a failure", unit="deg", low=0.0, high=360.0
    )
    joint_speed: float = option(
        6.0, "A joint that seems to move faster than this has jumped", unit="m/s", low=0.5, high=100.0
    )
    score_rise: float = option(
        0.06,
        "Sudden rise of the fit's rendered-depth disagreement (0 to 1) that counts as a failure",
        low=0.005,
        high=1.0,
    )
    min_confidence: float = option(
        0.25, "Skeletons less certain than this count as failures", low=0.0, high=1.0
    )
    max_time: float = option(
        2.0, "How long poses are carried over before the person counts as lost", unit="s", low=0.0, high=60.0
    )


@dataclass(frozen=True)
class SmoothConfig(_Checked):
    """Low-pass filter on the published joints (Sec. 6): One-Euro filter, Casiez et al., CHI 2012."""

    enabled: bool = option(True, "Filter the joint positions over time")
    min_cutoff: float = option(0.5, "Cut-off frequency at rest", unit="Hz", low=0.01, high=100.0)
    beta: float = option(24.0, "Cut-off frequency gained per speed", unit="Hz s/m", low=0.0, high=100.0)


@dataclass(frozen=True)
class FollowConfig(_Checked):
    """Whom ``/depth_pose/skeleton`` shows; everybody is on ``/depth_pose/skeletons``."""

    whom: str = option(
        "first",
        "first: who came first; nearest: to the camera; centre: of the image",
        choices=("first", "nearest", "centre"),
    )
    patient: bool = option(False, "Wait for the one who is followed for 2 s before another is taken")


class Sections:
    """Base of configurations that are made of others, one field for each."""

    @classmethod
    def from_mapping(cls: type[T], values: Mapping[str, Mapping[str, Any]]) -> T:
        """Make it from nested mappings, ``{"segment": {"near": 0.5}}``; unknown keys are errors."""
        sections: dict[str, Any] = {f.name: type(f.default) for f in fields(cls)}  # type: ignore[arg-type]
        unknown = sorted(set(values) - set(sections))
        if unknown:
            raise ConfigError(f"no such section: {', '.join(unknown)}; there are {', '.join(sections)}")
        return cls(**{name: from_mapping(sections[name], part) for name, part in values.items()})

    def as_mapping(self) -> dict[str, dict[str, Any]]:
        """Give every setting, nested by step."""
        return dataclasses.asdict(self)  # type: ignore[call-overload, no-any-return]


@dataclass(frozen=True)
class PipelineConfig(Sections):
    """All steps' settings."""

    mount: MountConfig = MountConfig()
    segment: SegmentConfig = SegmentConfig()
    denoise: DenoiseConfig = DenoiseConfig()
    match: MatchConfig = MatchConfig()
    refine: RefineConfig = RefineConfig()
    recover: RecoverConfig = RecoverConfig()
    smooth: SmoothConfig = SmoothConfig()
    follow: FollowConfig = FollowConfig()


MAX_STAMP_GAP_NS = 500_000_000
"""Temporal state is dropped when stamps jump back, or ahead by more than this."""
