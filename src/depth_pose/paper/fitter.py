"""Fitting method of the paper: registration and completion (`refine.method: cpd`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.build import build_space
from depth_pose.body.pose import BodyPose, FittedBody
from depth_pose.paper.completion import MeshCompleter
from depth_pose.refine.body_fitter import Vary, keep_limbs
from depth_pose.refine.objective import Objective
from depth_pose.refine.solver import Problem, SingleFits
from depth_pose.track.person_view import PersonView, thin


@dataclass(frozen=True)
class _CompletionFit:
    completer: MeshCompleter
    points: NDArray[np.float64]
    person: PersonView

    def glance(self, start: BodyPose) -> FittedBody:
        posed = self.completer.body.pose(start.rotations, start.root, start.scale)
        return FittedBody(start, posed.vertices, posed.nodes)

    def rough(self, start: BodyPose) -> FittedBody:
        return self.completer.begin(self.points, self.person.coarse, start)

    def finish(self, fitted: FittedBody) -> FittedBody:
        return self.completer.finish(self.points, self.person.coarse, fitted)


class CompletionFitter:
    """Fits by coherent point drift and Laplacian completion (`depth_pose.paper.completion`)."""

    def __init__(self, completer: MeshCompleter) -> None:
        self._completer = completer
        self._space = build_space(completer.body)

    def problem(
        self,
        person: PersonView,
        build: NDArray[np.float32],
        objective: Objective,
        noise: float = 0.0,
        vary: Vary = keep_limbs,
    ) -> Problem:
        """Prepare the fits of a build (13,) to one frame; the registration weighs no joints by ``noise``."""
        del noise
        points = thin(person.points, self._completer.tuning.max_points)
        fit = _CompletionFit(self._completer.of(self._space.body(build)), points, person)
        return SingleFits(fit, lambda body: objective.score(person, body), vary)
