"""Options for a folder of depth images."""

from __future__ import annotations

import math
from dataclasses import dataclass

from depth_pose.core.errors import ConfigError


@dataclass(frozen=True)
class ImageOptions:
    """Camera, unit and rate of a folder of images.

    Attributes
    ----------
    fx, fy, cx, cy : float, optional
        Intrinsics, pixels.
    depth_scale : float, optional
        Metres per unit; by default 0.001 for integers, 1 for others.
    fps : float, optional
        Frames a second; by default 30, or from file names that are times (``1305031453.374112.png``).
    """

    fx: float | None = None
    fy: float | None = None
    cx: float | None = None
    cy: float | None = None
    depth_scale: float | None = None
    fps: float | None = None

    def __post_init__(self) -> None:
        for name in ("fx", "fy", "depth_scale", "fps"):
            value = getattr(self, name)
            if value is not None and not (1e-6 < value < 1e6):
                raise ConfigError(f"{name} is {value}; it must be a number above 0")

    @staticmethod
    def parse(intrinsics: str | None, depth_scale: float | None, fps: float | None) -> ImageOptions:
        """Parse command-line options; intrinsics are ``FX,FY,CX,CY``."""
        numbers: list[float | None] = [None] * 4
        if intrinsics is not None:
            try:
                numbers = [float(part) for part in intrinsics.split(",")]
            except ValueError:
                numbers = []
            if len(numbers) != 4 or not all(n is not None and math.isfinite(n) for n in numbers):
                raise ConfigError(f"--intrinsics is {intrinsics!r}; it must be FX,FY,CX,CY in pixels")
        fx, fy, cx, cy = numbers
        return ImageOptions(fx, fy, cx, cy, depth_scale, fps)
