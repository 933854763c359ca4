"""People and places of simulated clips."""

from __future__ import annotations

import numpy as np

from depth_pose.sim.config import Person, Placement

_AIM_HEIGHT_M = 0.9
"""Height above the floor of the point that the camera looks at. Set by hand."""


def person_of(stature: float, build: np.ndarray) -> Person:
    """Return a person of a stature (m); girth, widths and lengths by five numbers from -1 to 1."""
    return Person(
        stature=stature,
        girth=1.0 + 0.15 * build[0],
        shoulder_width=1.0 + 0.06 * build[1],
        hip_width=1.0 + 0.06 * build[2],
        leg_length=1.0 + 0.05 * build[3],
        arm_length=1.0 + 0.05 * build[4],
    )


def aimed(
    distance: float, elevation: float, azimuth: float, roll: float = 0.0, lowest: float = 0.1
) -> Placement:
    """Return a camera at a distance (m) from the middle of a body, which it looks at; angles in degrees."""
    angle = np.radians(elevation)
    return Placement(
        distance=float(distance * np.cos(angle)),
        height=float(max(lowest, _AIM_HEIGHT_M + distance * np.sin(angle))),
        azimuth=float(azimuth),
        pitch=float(elevation),
        roll=roll,
    )
