"""Fits of one body, in every build, to one person's frame, with one interface for all methods."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.body.build import BuildSpace, build_space
from depth_pose.body.coarsen import coarsen
from depth_pose.body.pose import BodyPose, FittedBody
from depth_pose.refine.articulated import ArticulatedFitter
from depth_pose.refine.tuning import FitTuning
from depth_pose.track.person_view import PersonView
from depth_pose.track.target import FitTarget

_VERTICES = 1000
"""Number of body vertices used in glances and rough fits, about half of all; no less accurate than all."""


class FrameFit(Protocol):
    """Fits one build to one person in one frame."""

    def glance(self, start: BodyPose) -> FittedBody:
        """Run a short fit, precise enough to rank the starts."""

    def rough(self, start: BodyPose) -> FittedBody:
        """Run a rough fit, precise enough to choose between a few starts."""

    def finish(self, fitted: FittedBody) -> FittedBody:
        """Refine a rough fit to full precision."""


class PersonFitter(Protocol):
    """A method of fitting: the articulated fit, or the paper's registration and completion."""

    def fit_to(self, person: PersonView, build: NDArray[np.float32], noise: float = 0.0) -> FrameFit:
        """Prepare the fits of a build (13,) to one frame; ``noise`` as in `FitTarget`."""


@dataclass(frozen=True)
class _ArticulatedFit:
    fine: ArticulatedFitter
    coarse: ArticulatedFitter
    target: FitTarget

    def glance(self, start: BodyPose) -> FittedBody:
        return self._posed(self.coarse.fit(self.target, start, self.coarse.tuning.glance).pose)

    def rough(self, start: BodyPose) -> FittedBody:
        return self._posed(self.coarse.fit(self.target, start, self.coarse.tuning.rough).pose)

    def finish(self, fitted: FittedBody) -> FittedBody:
        return self._posed(self.fine.fit(self.target, fitted.pose, self.fine.tuning.fine).pose)

    def _posed(self, pose: BodyPose) -> FittedBody:
        posed = self.fine.body.pose(pose.rotations, pose.root, pose.scale)
        return FittedBody(pose, posed.vertices, posed.nodes)


class BodyFitter:
    """The articulated fits of one body; all but the last use a coarse mesh.

    Created once and shared by the stages of a process.

    Attributes
    ----------
    tuning : FitTuning
    space : BuildSpace
        All builds of the body.
    template : ArticulatedFitter
        The fitter of the unchanged body.
    """

    def __init__(self, body: Body, tuning: FitTuning = FitTuning()) -> None:
        self.tuning = tuning
        self.space = build_space(body)
        self.template = ArticulatedFitter(body, tuning)
        self._few = BuildSpace(coarsen(body, _VERTICES))
        self._coarse = ArticulatedFitter(self._few.template, tuning)

    def of(self, build: NDArray[np.float32]) -> ArticulatedFitter:
        """Return the fitter of one build (13,)."""
        return self.template.of(self.space.body(build))

    def target(self, person: PersonView) -> FitTarget:
        """Return the data that a person's body is fitted to."""
        return person.target(self.tuning.max_points)

    def fit_to(self, person: PersonView, build: NDArray[np.float32], noise: float = 0.0) -> FrameFit:
        """Prepare the fits of a build (13,) to one frame; ``noise`` as in `FitTarget`."""
        return _ArticulatedFit(*self.both_of(build), self.target(person)._replace(noise=noise))

    def both_of(self, build: NDArray[np.float32]) -> tuple[ArticulatedFitter, ArticulatedFitter]:
        """Return the fitters of one build (13,), with the whole mesh and with a coarse one."""
        return self.of(build), self._coarse.of(self._few.body(build))
