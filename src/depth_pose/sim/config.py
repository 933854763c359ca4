"""Settings of the simulation: the person (not the body of the default bank), camera and room."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from depth_pose.core.options import Checked, option

if TYPE_CHECKING:
    from depth_pose.body.body import Body

MAX_CAMERAS = 4
"""Maximum number of cameras in a simulated room."""


@dataclass(frozen=True)
class Person(Checked):
    """Build of the simulated person; its proportions differ from those of the bank's body."""

    stature: float = option(1.68, "Height standing upright", unit="m", low=0.3, high=2.5)
    girth: float = option(1.1, "Thickness of limbs and trunk, 1 for average", low=0.5, high=2.0)
    shoulder_width: float = option(0.96, "Width of the shoulders, 1 for average", low=0.5, high=2.0)
    hip_width: float = option(1.06, "Width of the hips, 1 for average", low=0.5, high=2.0)
    leg_length: float = option(0.97, "Length of the legs, 1 for average", low=0.5, high=2.0)
    arm_length: float = option(1.03, "Length of the arms, 1 for average", low=0.5, high=2.0)
    trunk_length: float = option(1.02, "Length of the trunk, 1 for average", low=0.5, high=2.0)
    head_size: float = option(1.0, "Size of the head, 1 for average, 1.25 for a child", low=0.5, high=2.0)

    def body(self) -> Body:
        """Make the person's body."""
        from depth_pose.body.procedural import BodyShape, make_body

        proportions = asdict(self)
        return make_body(BodyShape(stature_m=proportions.pop("stature"), **proportions))


@dataclass(frozen=True)
class Placement(Checked):
    """The camera's position relative to the spot on the floor that it looks at."""

    distance: float = option(3.8, "Distance on the floor from camera to person", unit="m", low=0.5, high=20.0)
    height: float = option(0.9, "The camera's height above the floor", unit="m", low=0.05, high=10.0)
    azimuth: float = option(
        0.0,
        "View azimuth: 0 front, 90 left, 180 back",
        unit="deg",
        low=-360.0,
        high=360.0,
    )
    pitch: float = option(0.0, "How far the camera looks down", unit="deg", low=-89.0, high=89.0)
    roll: float = option(0.0, "Turn about the optical axis, clockwise", unit="deg", low=-180.0, high=180.0)


@dataclass(frozen=True)
class Room(Checked):
    """Surroundings of the person."""

    floor: bool = option(True, "Put a floor under the person")
    wall: float = option(
        1.6, "Distance of the wall behind the person; 0 for none", unit="m", low=0.0, high=20.0
    )
