"""What matching and fitting need of a person cloud, prepared once per frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.errors import InputError
from depth_pose.io.decode import camera_from_points
from depth_pose.render import Observation, observe
from depth_pose.types import PERSON, Camera, PersonCloud

MIN_POINTS = 100
"""With fewer points than this nobody is taken to be in view."""

_MARGIN_M = 0.35


@dataclass(frozen=True)
class PersonView:
    """A person cloud as points and as images.

    Attributes
    ----------
    points : (N, 3) float64
        The person's points, metres, camera frame.
    camera : Camera
        Camera of the whole working grid, found from the points.
    full, coarse : Observation
        A window around the person, at full and at half resolution.
    """

    points: NDArray[np.float64]
    camera: Camera
    full: Observation
    coarse: Observation


def view_person(cloud: PersonCloud) -> PersonView | None:
    """Prepare a cloud; None where it shows nobody."""
    person = cloud.labels == PERSON
    if int(person.sum()) < MIN_POINTS:
        return None
    try:
        camera = camera_from_points(cloud.points)
    except InputError:  # all points on one row or column: no person
        return None
    depth = np.where(person, cloud.points[..., 2], np.float32(0))
    return PersonView(
        points=cloud.points[person].astype(np.float64),
        camera=camera,
        full=observe(depth, cloud.labels, camera, 1, _MARGIN_M),
        coarse=observe(depth, cloud.labels, camera, 2, _MARGIN_M),
    )


def thin(points: NDArray[np.float64], most: int) -> NDArray[np.float64]:
    """Take at most ``most`` points, evenly over their order in the image."""
    if len(points) <= most:
        return points
    return points[np.arange(most) * len(points) // most]
