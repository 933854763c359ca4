"""Builds: learned from the fitted frames of each track, and kept with its id.

Only the refiner learns builds; the later stages receive them with the fitted bodies. The matcher compares
exemplars of the bank's body, and the size that it finds is one more observation.
"""

from __future__ import annotations

from depth_pose.body.build import BuildSpace
from depth_pose.body.build_file import KnownBuild, load_build
from depth_pose.body.pose import FittedBody
from depth_pose.core.config import FitConfig, PersonalConfig
from depth_pose.refine.personal import BuildEvidence, PersonalBuild, Proposed
from depth_pose.refine.proposed_bones import measure_bones
from depth_pose.refine.proposed_depth import TrunkSkin
from depth_pose.refine.upright_stance import find_standing
from depth_pose.track.memory import Subject
from depth_pose.track.target import FitTarget


class BuildLearner:
    """Learns builds of one body.

    Parameters
    ----------
    space : BuildSpace
    config : PersonalConfig
    fit : FitConfig
        Settings of the fit that supplies the residuals.

    Raises
    ------
    ConfigError
        If the file of a build cannot be used.
    """

    def __init__(self, space: BuildSpace, config: PersonalConfig, fit: FitConfig) -> None:
        self.space = space
        self._config = config
        self._evidence, self._skin = BuildEvidence(space, config, fit), TrunkSkin(space)
        self._known = load_build(config.file) if config.file else None
        self.reset()

    def reset(self) -> None:
        """Forget the build that was learned from the most frames."""
        self._longest: PersonalBuild | None = None

    def best_known(self) -> KnownBuild | None:
        """Return the build learned from the most frames; None before the first."""
        return self._longest.known() if self._longest is not None else None

    def of(self, subject: Subject, scale: float, is_given: bool) -> PersonalBuild:
        """Return a person's build, up to date.

        Parameters
        ----------
        subject : Subject
            Holds the build.
        scale : float
            Size found by the matcher.
        is_given : bool
            Whether the size is configured and fixed.
        """
        if subject.build is None:
            subject.build = PersonalBuild(self._config, self.space, self._known)
        subject.build.take_size(scale, is_given)
        return subject.build

    def learn(
        self, personal: PersonalBuild, target: FitTarget, fitted: FittedBody, score: float, stamp_ns: int
    ) -> None:
        """Learn from a fitted frame: from skin if it fits well, and always from proposed joints.

        Parameters
        ----------
        personal : PersonalBuild
        target : FitTarget
            The data that the body was fitted to.
        fitted : FittedBody
        score : float
            Rendered-depth disagreement of the fitted body.
        stamp_ns : int
        """
        if not self._config.personal or not personal.is_due(stamp_ns):
            return
        evidence = None
        if score <= self._config.worst_score:
            body = self.space.body(personal.build)
            evidence = self._evidence.find(body, target, fitted.pose, personal.build)
        standing = find_standing(target.proposals, fitted.nodes)
        proposed = None
        if standing is not None:
            depth = self._skin.measure(standing, fitted, personal.build)
            proposed = Proposed(measure_bones(standing, fitted.nodes), depth)
        personal.add(stamp_ns, score, evidence, proposed)
        if personal.frames > 0 and (self._longest is None or personal.frames >= self._longest.frames):
            self._longest = personal
