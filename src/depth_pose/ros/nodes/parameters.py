"""ROS parameters of the nodes, declared from the core's configuration classes.

A setting ``near`` of the section ``segment`` is the parameter ``segment.near``, with the default,
range and help of `depth_pose.core.config`. Those of `SHORT_NAMES` have no section in their name.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from difflib import get_close_matches
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterAlreadyDeclaredException,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from depth_pose.core.config import SHORT_NAMES, PipelineConfig
from depth_pose.core.errors import ConfigError
from depth_pose.core.options import Sections, options
from depth_pose.core.printable import printable
from depth_pose.core.removed_options import explain_removed
from depth_pose.ros.setting import Setting

SECTIONS: tuple[str, ...] = tuple(f.name for f in fields(PipelineConfig))
"""Sections of `PipelineConfig`."""


FIXED_SECTIONS: tuple[str, ...] = ("mount",)
"""Sections shared by several nodes; they can be set only at start-up."""

COMMON: tuple[Setting, ...] = (
    Setting("queue", 1, "Length of the frame queue; 1: the newest wins", 1, 10000),
    Setting(
        "reliable",
        False,
        "Reliable inputs and outputs, every frame in turn: for replays that wait, not for sensors",
    ),
    Setting("autostart", True, "Configure and activate at once; false: wait for the lifecycle services"),
    Setting("consumers", 0, "Subscribers that every output must have before the node reports ready", 0, 100),
    Setting("producers", False, "Whether every input from the suite must have a publisher before that, too"),
)
"""Parameters of every node."""

BANK = Setting("bank", "", "Exemplar bank file; empty: the default one")

MATCHER: tuple[Setting, ...] = (
    BANK,
    Setting(
        "time_budget",
        0.06,
        "Time for all people of a frame, seconds; people left out come first in the next one; 0: no limit",
        0.0,
        10.0,
    ),
)
"""Parameters of the matcher node."""

TF: tuple[Setting, ...] = (
    Setting("tf", False, "Broadcast every joint on /tf, and the floor on /tf_static"),
    Setting("tf_prefix", "", "Prefix of the joints' names on /tf, for several cameras"),
)

LEVEL: tuple[Setting, ...] = (
    Setting("imu_topic", "", "sensor_msgs/Imu of the sensor: the direction of up, for the floor"),
    Setting(
        "level_frame",
        "",
        "Frame on /tf whose z axis points up, such as odom: the direction of up from transforms",
    ),
)
"""Parameters for the direction of up."""

DENOISE: tuple[Setting, ...] = (
    *TF,
    *LEVEL,
    Setting(
        "image_topic",
        "/camera/depth/image_raw",
        "Depth image, 16UC1 millimetres or 32FC1 metres; or compressed depth (PNG or RVL) of any name",
    ),
    Setting("info_topic", "/camera/depth/camera_info", "CameraInfo of the depth image"),
    Setting("cloud_topic", "", "PointCloud2 in the optical frame; if set, it is used instead of images"),
    Setting(
        "depth_scale",
        0.0,
        "Metres per unit of the depth; 0: 0.001 for 16UC1, 1 for 32FC1 and clouds",
        0.0,
        1e3,
    ),
)
REFINE: tuple[Setting, ...] = (
    BANK,
    Setting("mesh_rate", 2.0, "Meshes per second, published with a subscriber; 0: none", 0.0, 100.0, False),
)
"""Parameters of the refine node."""
REP155 = Setting("rep155", False, "Publish all people by REP-155: /humans/bodies/..., and frames on /tf")

OTHERS: tuple[Setting, ...] = (
    REP155,
    Setting("vision_msgs", False, "Publish each person's box as vision_msgs/Detection3DArray on detections"),
    Setting("people_msgs", False, "Publish centres and velocities as people_msgs/People on /people"),
)
"""Parameters for messages of other packages."""

RECOVERY: tuple[Setting, ...] = (BANK, *TF, *OTHERS)
EVERYWHERE: frozenset[str] = frozenset(s.name for s in (*COMMON, *DENOISE, *MATCHER, *REFINE, *RECOVERY)) | {
    "use_sim_time",
    "start_type_description_service",
}
"""Parameters, besides the sections, that a file shared by all nodes may contain."""


def declare(
    node: Node, settings: Sequence[Setting], sections: Sequence[str], config: type[Sections] = PipelineConfig
) -> None:
    """Declare a node's own settings and those of its sections of a configuration class.

    Raises
    ------
    ConfigError
        If the values given at the start are unknown, of the wrong type, or out of range.
    """
    # rclpy has no public function for parameters from the command line or a file
    given: dict[str, Parameter] = getattr(node, "_parameter_overrides", {})
    _refuse_unknown(given, settings, sections, config)
    for s in settings:
        _declare(node, given, s.name, s.default, describe(s.help, s.default, s.low, s.high, s.read_only))
    for section in sections:
        for o in options(_section_class(section, config)):
            fixed = section in FIXED_SECTIONS
            descriptor = describe(o.help, o.default, o.low, o.high, fixed, o.unit, o.choices)
            _declare(node, given, parameter_name(section, o.name), o.default, descriptor)


def parameter_name(section: str, field: str) -> str:
    """Name the ROS parameter of a setting."""
    short = (name for name, setting in SHORT_NAMES.items() if setting == (section, field))
    return next(short, f"{section}.{field}")


def describe(
    help: str,
    default: object,
    low: float | None,
    high: float | None,
    read_only: bool,
    unit: str = "",
    choices: tuple[str, ...] = (),
) -> ParameterDescriptor:
    """Descriptor with range, unit and help."""
    made = ParameterDescriptor(description=f"{help} [{unit}]" if unit else help, read_only=read_only)
    if choices:
        made.additional_constraints = "one of " + ", ".join(choices)
    if low is None or high is None or isinstance(default, bool):
        return made
    if isinstance(default, int):
        made.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=0)]
    elif isinstance(default, float):
        made.floating_point_range = [
            FloatingPointRange(from_value=float(low), to_value=float(high), step=0.0)
        ]
    return made


def _declare(
    node: Node, given: dict[str, Parameter], name: str, default: Any, descriptor: ParameterDescriptor
) -> None:
    value = given.get(name)
    if isinstance(default, float) and value is not None and value.type_ == Parameter.Type.INTEGER:
        given[name] = Parameter(name, Parameter.Type.DOUBLE, float(value.value))  # "near: 1" means 1.0
    try:
        node.declare_parameter(name, default, descriptor)
    except InvalidParameterTypeException as e:
        kind = type(default).__name__
        raise ConfigError(f"parameter {name} is {value.value if value else None!r}; give a {kind}") from e
    except InvalidParameterValueException as e:
        raise ConfigError(f"parameter {name}: {e}") from e
    except ParameterAlreadyDeclaredException:
        raise ConfigError(f"parameter {name} is declared twice by this node") from None


def _refuse_unknown(
    given: Iterable[str], settings: Sequence[Setting], sections: Sequence[str], config: type[Sections]
) -> None:
    known = {*_known_somewhere(), *(s.name for s in settings), *_names(sections, config)}
    unknown = sorted(n for n in given if n not in known and not n.startswith("qos_overrides."))
    if unknown:
        raise ConfigError(explain_unknown("no node of depth_pose", unknown, known))


def explain_unknown(who: str, unknown: Sequence[str], known: Iterable[str]) -> str:
    """Return the error line for unknown parameters: their names, and suggestions.

    Parameters
    ----------
    who : str
        The node or file that does not have them.
    unknown : sequence of str
    known : iterable of str
        The valid names.
    """
    renamed = {".".join(setting): name for name, setting in SHORT_NAMES.items()}
    known, elsewhere, hints = sorted(known), _known_somewhere(), []
    for name in unknown:
        near = get_close_matches(name, known, n=1)
        section, _, field = name.partition(".")
        if removed := explain_removed(section, field):
            hints.append(removed)
        elif name in renamed:
            hints.append(f"{name} is named {renamed[name]}")
        elif name in elsewhere:
            hints.append(f"{name} is a parameter of another node")
        elif near:
            hints.append(f"is {near[0]} meant?")
    hints = hints or [f"settings are named SECTION.NAME with the sections {', '.join(SECTIONS)}"]
    has = "has" if who.startswith("no ") else "does not have"
    return printable(f"{who} {has} the parameter {', '.join(unknown)}; {', '.join(hints)}")


def _known_somewhere() -> set[str]:
    """Return the names of all parameters of the four nodes."""
    return {*EVERYWHERE, *_names(SECTIONS, PipelineConfig)}


def _names(sections: Sequence[str], config: type[Sections]) -> Iterator[str]:
    for section in sections:
        yield from (parameter_name(section, o.name) for o in options(_section_class(section, config)))


def holds_setting(names: Iterable[str], sections: Sequence[str], config: type[Sections]) -> bool:
    """Whether one of the parameters is a setting of the sections."""
    return not set(names).isdisjoint(_names(sections, config))


def _section_class(section: str, config: type[Sections]) -> type:
    return type(getattr(config(), section))


def read_config(
    node: Node,
    sections: Sequence[str],
    changes: Mapping[str, Any] | None = None,
    config: type[Sections] = PipelineConfig,
) -> Any:
    """Build the configuration from a node's parameters, with some of them changed.

    Raises
    ------
    ConfigError
        If a value is out of its range.
    """
    values: dict[str, dict[str, Any]] = {}
    for section in sections:
        values[section] = {
            o.name: (changes or {}).get(name, node.get_parameter(name).value)
            for o in options(_section_class(section, config))
            for name in (parameter_name(section, o.name),)
        }
    return config.from_mapping(values)
