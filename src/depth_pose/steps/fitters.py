"""The ways to fit a body to a person's points, under one interface, by the name of the method."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.core.config import FittingConfig
from depth_pose.fit.articulated import ArticulatedFitter, BodyPose, FitTarget, FittedBody
from depth_pose.fit.completion import MeshCompleter
from depth_pose.people.person import Person, thin


class FrameFitter(Protocol):
    """Fits one body to one frame."""

    def glance(self, start: BodyPose) -> FittedBody:
        """Fit just well enough to tell which starts are worth more."""

    def rough(self, start: BodyPose) -> FittedBody:
        """Fit well enough to choose one of a few starts."""

    def finish(self, fitted: FittedBody) -> FittedBody:
        """Fit as well as possible, from a rough fit."""

    def seen(self) -> FitTarget:
        """Give the frame as the articulated fit takes it."""


class Fitter(Protocol):
    """What the refiner needs of a method."""

    def fit_to(self, view: Person, body: Body) -> FrameFitter:
        """Prepare one frame, in which a build of the body is fitted."""


@dataclass(frozen=True)
class _SkinnedFrame:
    fitter: ArticulatedFitter
    target: FitTarget

    def glance(self, start: BodyPose) -> FittedBody:
        return self._fit(start, self.fitter.config.glance)

    def rough(self, start: BodyPose) -> FittedBody:
        return self._fit(start, self.fitter.config.rough)

    def finish(self, fitted: FittedBody) -> FittedBody:
        return self._fit(fitted.pose, self.fitter.config.fine)

    def seen(self) -> FitTarget:
        return self.target

    def _fit(self, start: BodyPose, sigmas: tuple[float, ...]) -> FittedBody:
        pose = self.fitter.fit(self.target, start, sigmas)
        posed = self.fitter.body.pose(pose.rotations, pose.root, pose.scale)
        return FittedBody(pose, posed.vertices, posed.nodes)


class SkinnedFitter:
    """Joint angles of the skinned body (`depth_pose.fit.articulated`)."""

    def __init__(self, body: Body, config: FittingConfig) -> None:
        self._fitter = ArticulatedFitter(body, config.fit)

    def fit_to(self, view: Person, body: Body) -> FrameFitter:
        """Prepare one frame."""
        points = thin(view.points, self._fitter.config.max_points)
        return _SkinnedFrame(self._fitter.of(body), FitTarget.prepare(points, view.full, view.coarse))


@dataclass(frozen=True)
class _CompletionFrame:
    completer: MeshCompleter
    points: NDArray[np.float64]
    view: Person

    def glance(self, start: BodyPose) -> FittedBody:
        posed = self.completer.body.pose(start.rotations, start.root, start.scale)
        return FittedBody(start, posed.vertices, posed.nodes)

    def rough(self, start: BodyPose) -> FittedBody:
        return self.completer.fit(self.points, self.view.coarse, start)

    def finish(self, fitted: FittedBody) -> FittedBody:
        return fitted

    def seen(self) -> FitTarget:
        return FitTarget.prepare(self.points, self.view.full, self.view.coarse)


class CompletionFitter:
    """The paper's registration and completion (`depth_pose.fit.completion`)."""

    def __init__(self, body: Body, config: FittingConfig) -> None:
        self._completer = MeshCompleter(body, config.completion, config.cpd)

    def fit_to(self, view: Person, body: Body) -> FrameFitter:
        """Prepare one frame."""
        points = thin(view.points, self._completer.config.max_points)
        return _CompletionFrame(self._completer.of(body), points, view)


FITTERS: dict[str, Callable[[Body, FittingConfig], Fitter]] = {
    "articulated": SkinnedFitter,
    "cpd": CompletionFitter,
}
"""Makers of fitters, by `depth_pose.core.config.RefineConfig.method`."""
