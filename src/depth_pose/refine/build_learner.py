"""Everybody's build: learned from fitted frames while they are followed, and kept with their id.

Only the refiner learns builds; they travel on with the fitted bodies. The matcher compares exemplars of the
bank's body; the size that it finds is one more observation.
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
        Settings of the fit whose residuals tell the builds.

    Raises
    ------
    ConfigError
        Where the file of a build cannot be used.
    """

    def __init__(self, space: BuildSpace, config: PersonalConfig, fit: FitConfig) -> None:
        self.space = space
        self._config = config
        self._evidence, self._skin = BuildEvidence(space, config, fit), TrunkSkin(space)
        self._known = load_build(config.file) if config.file else None
        self.reset()

    def reset(self) -> None:
        """Forget whose build was learned from most frames."""
        self._longest: PersonalBuild | None = None

    def best_known(self) -> KnownBuild | None:
        """Give the build that was learned from most frames; None where nobody was followed."""
        return self._longest.known() if self._longest is not None else None

    def of(self, subject: Subject, scale: float, is_given: bool) -> PersonalBuild:
        """Return somebody's build, up to date.

        Parameters
        ----------
        subject : Subject
            Who keeps it.
        scale : float
            Size that the matcher found.
        is_given : bool
            Whether that is given, and kept.
        """
        if subject.build is None:
            subject.build = PersonalBuild(self._config, self.space, self._known)
        subject.build.take_size(scale, is_given)
        return subject.build

    def learn(
        self, personal: PersonalBuild, target: FitTarget, fitted: FittedBody, score: float, stamp_ns: int
    ) -> None:
        """Learn from a fitted frame: from skin if it fits well, from proposed joints in any case.

        Parameters
        ----------
        personal : PersonalBuild
        target : FitTarget
            What the body was fitted to.
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
