"""``depth-pose settings``: the settings with their defaults, and the constants beside them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import fields
from typing import Annotated, Any

import typer
import yaml

from depth_pose import __version__
from depth_pose.core.config import PipelineConfig
from depth_pose.core.options import Option, Sections, options


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(settings)


def settings(
    everything: Annotated[
        bool,
        typer.Option(
            "--all", help="Also print the version, the weights, and all constants that are not settings."
        ),
    ] = False,
) -> None:
    """Print all settings with their defaults, units and ranges, as a file for --params.

    With --all the constants are printed, too. They are chosen together with the weights and the bank, and
    no file can change them.

    [bold]Examples:[/bold]

    depth-pose settings > my.yaml

    depth-pose settings --all
    """
    if everything:
        typer.echo(yaml.safe_dump(all_values(), sort_keys=False, width=110), nl=False)
    else:
        typer.echo("\n".join(settings_file(PipelineConfig)))


def settings_file(config: type[Sections]) -> Iterator[str]:
    """Yield the lines of a YAML file of a configuration's defaults, with comments."""
    for section in fields(config):  # type: ignore[arg-type]
        yield f"{section.name}:"
        for o in options(section.default):
            value = yaml.safe_dump(o.default, default_flow_style=True).split("\n")[0]
            yield f"  {o.name}: {value}  # {describe(o)}"


def describe(o: Option) -> str:
    """Return a setting's help with its unit and range."""
    if o.low is None or o.high is None:
        return o.help
    return f"{o.help} ({o.low:g} to {o.high:g}{f' {o.unit}' if o.unit else ''})"


def all_values() -> dict[str, Any]:
    """Return version, weights, settings and constants, nested by name."""
    from depth_pose.detect.net import read_weights
    from depth_pose.tuning import Tuning
    from depth_pose.volume.config import VolumeConfig
    from depth_pose.volume.tuning import VolumeTuning

    nets = ("people_finder.onnx", "joint_finder.onnx", "quick_joint_finder.onnx")
    return {
        "version": __version__,
        "weights": {name: hashlib.sha256(read_weights(name)).hexdigest()[:16] for name in nets},
        "settings": PipelineConfig().as_mapping(),
        "constants": as_mapping(Tuning()),
        "volume": {"settings": VolumeConfig().as_mapping(), "constants": as_mapping(VolumeTuning())},
    }


def as_mapping(tuning: Any) -> dict[str, Any]:
    """Return the constants of a named tuple of named tuples, by name."""
    plain: dict[str, Any] = {}
    for name, value in tuning._asdict().items():
        if hasattr(value, "_asdict"):
            plain[name] = as_mapping(value)
        else:
            plain[name] = list(value) if isinstance(value, tuple) else value
    return plain
