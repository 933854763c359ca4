"""Build files: readable JSON with each part's value and uncertainty."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.build import BUILD_NAMES, MOST
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.outputs import new_text_file
from depth_pose.core.reading import parse_json, read_text

FORMAT = "depth_pose build"
FORMAT_VERSION = 1
"""Version of the file; builds of any other are refused."""


@dataclass(frozen=True)
class KnownBuild:
    """Estimate of one person's size and proportions.

    Attributes
    ----------
    scale, scale_spread : float
        Size relative to the bank's body, and the standard deviation of its logarithm.
    build, spread : (13,) float64
        Parts (`depth_pose.body.build.BUILD_NAMES`), and their standard deviations.
    frames : int
        Number of frames that it was learned from.
    """

    scale: float
    scale_spread: float
    build: NDArray[np.float64]
    spread: NDArray[np.float64]
    frames: int


def save_build(path: Path | str, known: KnownBuild) -> None:
    """Write a build."""
    parts = {
        name: {"value": round(float(value), 5), "spread": round(float(spread), 5)}
        for name, value, spread in zip(BUILD_NAMES, known.build, known.spread, strict=True)
    }
    content = {
        "format": FORMAT,
        "version": FORMAT_VERSION,
        "scale": round(known.scale, 5),
        "scale_spread": round(known.scale_spread, 5),
        "frames": known.frames,
        "parts": parts,
    }
    with new_text_file(path) as stream:
        stream.write(json.dumps(content, indent=2) + "\n")


def load_build(path: Path | str) -> KnownBuild:
    """Read a build.

    Raises
    ------
    ConfigError
        Where the file cannot be read, is not a build, lacks a part, or a value is out of range.
    """
    try:
        text = read_text(path)
    except InputError as error:
        raise ConfigError(f"{path}: the build cannot be read: {error}") from error
    content = parse_json(path, text)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ConfigError(f"{path} is not a build file; depth-pose run --save-build FILE writes one")
    if content.get("version") != FORMAT_VERSION:
        raise ConfigError(
            f"{path}: builds of version {content.get('version')} are not known here, only {FORMAT_VERSION}"
        )
    parts = content.get("parts")
    parts = parts if isinstance(parts, dict) else {}
    if set(parts) != set(BUILD_NAMES):
        odd = ", ".join(sorted(set(parts) ^ set(BUILD_NAMES)))
        raise ConfigError(f"{path}: parts that are missing or unknown: {odd}")
    where = [(name, parts[name] if isinstance(parts[name], dict) else {}) for name in BUILD_NAMES]
    most = zip(where, MOST.tolist(), strict=True)
    return KnownBuild(
        scale=_number(path, content, "scale", "scale", 0.3, 2.5),
        scale_spread=_number(path, content, "scale_spread", "scale_spread", 1e-5, 1.0),
        build=np.array([_number(path, p, "value", f"{n}.value", -m, m) for (n, p), m in most]),
        spread=np.array([_number(path, p, "spread", f"{n}.spread", 1e-5, 1.0) for n, p in where]),
        frames=int(_number(path, content, "frames", "frames", 0, 1e9)),
    )


def _number(path: Path | str, values: dict[str, Any], key: str, name: str, low: float, high: float) -> float:
    value = values.get(key)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
        raise ConfigError(f"{path}: {name} is {value!r}; it must be a number from {low:g} to {high:g}")
    return float(value)
