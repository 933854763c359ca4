"""The ways to fit a body to a person's points, under one interface, by the name of the method."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.body.build import BuildSpace
from depth_pose.body.coarsen import coarsen
from depth_pose.core.config import FittingConfig
from depth_pose.paper.completion import MeshCompleter
from depth_pose.refine.articulated import ArticulatedFitter, BodyPose, FitTarget, FittedBody
from depth_pose.track.person import Person, thin

_VERTICES = 1000
"""Vertices of the body that glances and rough fits take, about half of all. On eight development clips: all
22.7 mm, 1000 22.2, 700 22.6; a glance takes .40, .27 and .22 ms."""


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

    def fit_to(self, view: Person, body: Body, build: NDArray[np.float32]) -> FrameFitter:
        """Prepare one frame, in which a build, (13,), of the body is fitted: ``body``."""


@dataclass(frozen=True)
class _SkinnedFrame:
    fine: ArticulatedFitter
    coarse: ArticulatedFitter
    target: FitTarget

    def glance(self, start: BodyPose) -> FittedBody:
        return self._posed(self.coarse.fit(self.target, start, self.coarse.config.glance))

    def rough(self, start: BodyPose) -> FittedBody:
        return self._posed(self.coarse.fit(self.target, start, self.coarse.config.rough))

    def finish(self, fitted: FittedBody) -> FittedBody:
        return self._posed(self.fine.fit(self.target, fitted.pose, self.fine.config.fine))

    def seen(self) -> FitTarget:
        return self.target

    def _posed(self, pose: BodyPose) -> FittedBody:
        posed = self.fine.body.pose(pose.rotations, pose.root, pose.scale)
        return FittedBody(pose, posed.vertices, posed.nodes)


class SkinnedFitter:
    """Fit joint angles of the skinned body (`refine.articulated`); of a coarse one until the last fit."""

    def __init__(self, body: Body, config: FittingConfig) -> None:
        self._fine = ArticulatedFitter(body, config.fit)
        self._few = BuildSpace(coarsen(body, _VERTICES))
        self._coarse = ArticulatedFitter(self._few.template, config.fit)

    def fit_to(self, view: Person, body: Body, build: NDArray[np.float32]) -> FrameFitter:
        """Prepare one frame."""
        points = thin(view.points, self._fine.config.max_points)
        return _SkinnedFrame(
            self._fine.of(body),
            self._coarse.of(self._few.body(build)),
            FitTarget.prepare(points, view.full, view.coarse, view.found),
        )


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
    """The paper's registration and completion (`depth_pose.paper.completion`)."""

    def __init__(self, body: Body, config: FittingConfig) -> None:
        self._completer = MeshCompleter(body, config.completion, config.cpd)

    def fit_to(self, view: Person, body: Body, build: NDArray[np.float32]) -> FrameFitter:
        """Prepare one frame."""
        points = thin(view.points, self._completer.config.max_points)
        return _CompletionFrame(self._completer.of(body), points, view)


FITTERS: dict[str, Callable[[Body, FittingConfig], Fitter]] = {
    "articulated": SkinnedFitter,
    "cpd": CompletionFitter,
}
"""Makers of fitters, by `depth_pose.core.config.RefineConfig.method`."""
