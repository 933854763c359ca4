"""What matching and fitting need of a person cloud, prepared once per frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.errors import InputError
from depth_pose.core.types import PERSON, PersonCloud
from depth_pose.fit.rendered_depth import Observation, observe
from depth_pose.io.decode import camera_from_points
from depth_pose.people import _person_kernels as kernels

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
    points = np.empty((cloud.labels.size, 3))
    depth = np.empty(cloud.labels.shape, np.float32)
    count = kernels.take_person(cloud.points, cloud.labels, PERSON, points, depth)
    if count < MIN_POINTS:
        return None
    try:
        camera = camera_from_points(cloud.points)
    except InputError:  # all points on one row or column: no person
        return None
    return PersonView(
        points=points[:count].copy(),
        camera=camera,
        full=observe(depth, cloud.labels, camera, 1, _MARGIN_M),
        coarse=observe(depth, cloud.labels, camera, 2, _MARGIN_M),
    )


def thin_image(observed: Observation, distance: float, spacing_m: float) -> Observation:
    """Leave out pixels of an image as long as the others lie at most so far apart at the person.

    Parameters
    ----------
    observed : Observation
    distance : float
        Distance of the person, metres.
    spacing_m : float
        Metres at the person.
    """
    camera = observed.camera
    step = int(spacing_m * camera.fx / distance)
    if step < 2:
        return observed
    return Observation(
        depth=np.ascontiguousarray(observed.depth[::step, ::step]),
        labels=np.ascontiguousarray(observed.labels[::step, ::step]),
        camera=camera.strided(step),
    )


def thin(points: NDArray[np.float64], most: int) -> NDArray[np.float64]:
    """Take at most ``most`` points, evenly over their order in the image."""
    if len(points) <= most:
        return points
    return points[np.arange(most) * len(points) // most]
