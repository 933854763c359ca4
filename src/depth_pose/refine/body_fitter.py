"""Fits of one body, in every build, to one person's frame, with one interface for all methods."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.body.build import KEPT, BuildSpace, build_space
from depth_pose.body.coarsen import coarsen
from depth_pose.body.pose import BodyPose, FittedBody
from depth_pose.core.skeleton import NODES, Nodes
from depth_pose.refine._score_kernels import Criteria, Fits, fit_best
from depth_pose.refine.articulated import ArticulatedFitter
from depth_pose.refine.objective import Objective, Score
from depth_pose.refine.solver import Hypothesis, Problem, ScoredFit
from depth_pose.refine.tuning import FitTuning
from depth_pose.track.person_view import PersonView
from depth_pose.track.target import FitTarget

_VERTICES = 1000
"""Number of body vertices used in glances and rough fits, about half of all; no less accurate than all."""

_NO_GLANCE = np.zeros(0)
"""Standard deviations of a glance at a single start: none."""

Vary = Callable[[FittedBody], list[Hypothesis]]


def keep_limbs(_: FittedBody) -> list[Hypothesis]:
    """Return no hypotheses with other limbs."""
    return []


class PersonFitter(Protocol):
    """A method of fitting: the articulated fit, or the paper's registration and completion."""

    def problem(
        self,
        person: PersonView,
        build: NDArray[np.float32],
        objective: Objective,
        noise: float = 0.0,
        vary: Vary = keep_limbs,
    ) -> Problem:
        """Prepare the fits of a build (13,) to one frame; ``noise`` as in `FitTarget`."""


class ArticulatedFits:
    """The articulated fits of one build to one person in one frame: one compiled call for all starts.

    Parameters
    ----------
    fine, coarse : ArticulatedFitter
        With the whole mesh of the build, and with a coarse one, for all but the last fit.
    target : FitTarget
    criteria : Criteria
    vary : callable
        As in `depth_pose.refine.solver.Problem`.
    """

    def __init__(
        self,
        fine: ArticulatedFitter,
        coarse: ArticulatedFitter,
        target: FitTarget,
        criteria: Criteria,
        vary: Vary,
    ) -> None:
        self._fine, self._coarse, self._target, self._criteria = fine, coarse, target, criteria
        self.vary = vary

    def rough(self, start: Hypothesis) -> ScoredFit:
        """Run a rough fit, precise enough to choose between a few starts."""
        return self._fit(self._coarse, [start], _NO_GLANCE, self._coarse.levels.rough, 1)

    def best(self, starts: Sequence[Hypothesis], count: int) -> ScoredFit:
        """Return the best of the rough fits of the ``count`` starts that are best after a glance."""
        levels = self._coarse.levels
        return self._fit(self._coarse, starts, levels.glance, levels.rough, count)

    def fine(self, fitted: ScoredFit) -> ScoredFit:
        """Refine a rough fit to full precision."""
        start = Hypothesis(fitted.body.pose, fitted.source)
        return self._fit(self._fine, [start], _NO_GLANCE, self._fine.levels.fine, 1)

    def _fit(
        self,
        fitter: ArticulatedFitter,
        starts: Sequence[Hypothesis],
        glance: NDArray[np.float64],
        sigmas: NDArray[np.float64],
        count: int,
    ) -> ScoredFit:
        fits, skin, body = self._begin(starts), self._fine.body.skin, fitter.articulation
        s = fit_best(self._target, body, fitter.settings, glance, sigmas, skin, self._criteria, count, fits)
        pose = BodyPose(fits.rotations[s], fits.roots[s], float(fits.scales[s]))
        fitted = FittedBody(pose, fits.vertices[s], Nodes(fits.nodes[s]))
        return ScoredFit(fitted, Score(*fits.scores[s].tolist()), starts[s].source)

    def _begin(self, starts: Sequence[Hypothesis]) -> Fits:
        """Return the arrays of fits, with the starts."""
        whole = self._fine.body
        shapes = (len(NODES), 3, 3), (3,), (), whole.vertices.shape, whole.nodes.shape, (len(Score._fields),)
        fits = Fits(*[np.empty((len(starts), *shape)) for shape in shapes])
        for s, (pose, _) in enumerate(starts):
            fits.rotations[s], fits.roots[s], fits.scales[s] = pose.rotations, pose.root, pose.scale
        return fits


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
        self._both = lru_cache(maxsize=KEPT)(self._both_of)

    def of(self, build: NDArray[np.float32]) -> ArticulatedFitter:
        """Return the fitter of one build (13,)."""
        return self.template.of(self.space.body(build))

    def target(self, person: PersonView) -> FitTarget:
        """Return the data that a person's body is fitted to."""
        return person.target(self.tuning.max_points)

    def problem(
        self,
        person: PersonView,
        build: NDArray[np.float32],
        objective: Objective,
        noise: float = 0.0,
        vary: Vary = keep_limbs,
    ) -> Problem:
        """Prepare the fits of a build (13,) to one frame; ``noise`` as in `FitTarget`."""
        target = self.target(person)._replace(noise=noise)
        return ArticulatedFits(*self.both_of(build), target, objective.criteria(person), vary)

    def both_of(self, build: NDArray[np.float32]) -> tuple[ArticulatedFitter, ArticulatedFitter]:
        """Return the fitters of one build (13,), with the whole mesh and with a coarse one."""
        return self._both(build.tobytes())

    def _both_of(self, values: bytes) -> tuple[ArticulatedFitter, ArticulatedFitter]:
        build = np.frombuffer(values, np.float32)
        return self.of(build), self._coarse.of(self._few.body(build))
