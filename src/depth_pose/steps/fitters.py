"""The ways to fit a body to a person's points, under one interface, by the name of the method."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.registration.articulated import ArticulatedFitter, BodyPose, nearest_person_pixels
from depth_pose.registration.completion import MeshCompleter
from depth_pose.steps.view import PersonView, thin


@dataclass(frozen=True)
class FittedBody:
    """A pose, and the mesh (V, 3) and nodes (21, 3) found for it, camera frame, metres."""

    pose: BodyPose
    vertices: NDArray[np.float64]
    nodes: NDArray[np.float64]


Fit = Callable[[BodyPose], FittedBody]
"""Fits one body to one frame from a given start."""


class Fitter(Protocol):
    """What the refiner needs of a method."""

    def fit_to(self, view: PersonView) -> Fit:
        """Prepare one frame, and give the function that fits to it."""


class SkinnedFitter:
    """Joint angles of the skinned body (`depth_pose.registration.articulated`)."""

    def __init__(self, body: Body) -> None:
        self._fitter = ArticulatedFitter(body)

    def fit_to(self, view: PersonView) -> Fit:
        """Prepare one frame, and give the function that fits to it."""
        points = thin(view.points, self._fitter.config.max_points)
        nearest = nearest_person_pixels(view.full)

        def fit(start: BodyPose) -> FittedBody:
            pose = self._fitter.fit(points, view.full, view.coarse, nearest, start)
            posed = self._fitter.body.pose(pose.rotations, pose.root, pose.scale)
            return FittedBody(pose, posed.vertices, posed.nodes)

        return fit


class CompletionFitter:
    """The paper's registration and completion (`depth_pose.registration.completion`)."""

    def __init__(self, body: Body) -> None:
        self._completer = MeshCompleter(body)

    def fit_to(self, view: PersonView) -> Fit:
        """Prepare one frame, and give the function that fits to it."""
        points = thin(view.points, self._completer.config.max_points)

        def fit(start: BodyPose) -> FittedBody:
            found = self._completer.fit(points, view.coarse, start)
            return FittedBody(found.pose, found.vertices, found.nodes)

        return fit


FITTERS: dict[str, Callable[[Body], Fitter]] = {"articulated": SkinnedFitter, "cpd": CompletionFitter}
"""Makers of fitters, by `depth_pose.config.RefineConfig.method`."""
