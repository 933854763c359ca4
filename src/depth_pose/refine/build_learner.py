"""Builds: learned from the fitted frames of each track, and kept with its id.

Only the refiner learns builds; the later stages receive them with the fitted bodies. The matcher compares
exemplars of the bank's body, and the size that it finds is one more observation.
"""

from __future__ import annotations

from depth_pose.body.build import BuildSpace
from depth_pose.body.build_file import KnownBuild, load_build
from depth_pose.body.pose import FittedBody
from depth_pose.core.config import PersonalConfig
from depth_pose.refine.personal import BuildEvidence, PersonalBuilds, Proposed, is_due
from depth_pose.refine.proposed_bones import measure_bones
from depth_pose.refine.proposed_depth import TrunkSkin
from depth_pose.refine.tuning import BuildTuning, FitTuning
from depth_pose.refine.upright_stance import find_standing
from depth_pose.track.state import Shape
from depth_pose.track.target import FitTarget


class BuildLearner:
    """Learns builds of one body.

    Parameters
    ----------
    space : BuildSpace
    config : PersonalConfig
    tuning : BuildTuning
    fit : FitTuning
        Constants of the fit that supplies the residuals.

    Raises
    ------
    ConfigError
        If the file of a build cannot be used.
    """

    def __init__(
        self,
        space: BuildSpace,
        config: PersonalConfig = PersonalConfig(),
        tuning: BuildTuning = BuildTuning(),
        fit: FitTuning = FitTuning(),
    ) -> None:
        self.space = space
        self._config, self._tuning = config, tuning
        self._evidence, self._skin = BuildEvidence(space, tuning, fit), TrunkSkin(space)
        self._builds = PersonalBuilds(tuning, space, load_build(config.file) if config.file else None)
        self.reset()

    def reset(self) -> None:
        """Forget the build that was learned from the most frames."""
        self._longest: Shape | None = None

    def best_known(self) -> KnownBuild | None:
        """Return the build learned from the most frames; None before the first."""
        return self._builds.known(self._longest) if self._longest is not None else None

    def begin(self, shape: Shape, scale: float) -> Shape:
        """Return a person's shape with size and build up to date.

        Parameters
        ----------
        shape : Shape
        scale : float
            Size found by the matcher.
        """
        return self._builds.take_size(shape, scale, is_given=self._config.scale > 0.0)

    def keep(self, shape: Shape) -> None:
        """Remember the shape that was learned from the most frames, for `best_known`."""
        if shape.frames > 0 and (self._longest is None or shape.frames >= self._longest.frames):
            self._longest = shape

    def learn(
        self,
        shape: Shape,
        target: FitTarget,
        fitted: FittedBody,
        score: float,
        stamp_ns: int,
    ) -> Shape:
        """Learn from a fitted frame: from skin if it fits well, and always from measured joints.

        Parameters
        ----------
        shape : Shape
            With which the body was fitted.
        target : FitTarget
            The data that it was fitted to.
        fitted : FittedBody
        score : float
            Rendered-depth disagreement of the fitted body.
        stamp_ns : int
        """
        if not self._config.personal or not is_due(shape, stamp_ns):
            return shape
        evidence = None
        if score <= self._tuning.worst_score:
            evidence = self._evidence.find(self.space.body(shape.build), target, fitted.pose, shape.build)
        standing = find_standing(target.proposals, fitted.nodes)
        proposed = None
        if standing is not None:
            depth = self._skin.measure(standing, fitted, shape.build)
            proposed = Proposed(measure_bones(standing, fitted.nodes), depth)
        return self._builds.add(shape, stamp_ns, score, evidence, proposed)
