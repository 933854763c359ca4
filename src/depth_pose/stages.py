"""The stages that need the exemplar bank, built from one configuration; each is imported at first use.

A node's process runs one of them, and starts faster and with less memory without the others.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

from depth_pose.bank.bank import Bank
from depth_pose.core.config import PipelineConfig
from depth_pose.track.state import PersonStates
from depth_pose.tuning import Tuning

if TYPE_CHECKING:
    from depth_pose.match.match import Matcher
    from depth_pose.paper.completion import MeshCompleter
    from depth_pose.recover.recover import FailureRecovery
    from depth_pose.refine.body_fitter import BodyFitter
    from depth_pose.refine.objective import Objective
    from depth_pose.refine.refine import Refiner


class StageFactory:
    """Objects shared by the stages of a process: the body with its fits, objective, people's states.

    Parameters
    ----------
    bank : Bank
    config : PipelineConfig
    tuning : Tuning

    Attributes
    ----------
    states : PersonStates
    """

    def __init__(
        self, bank: Bank, config: PipelineConfig = PipelineConfig(), tuning: Tuning = Tuning()
    ) -> None:
        self._bank, self._config, self._tuning = bank, config, tuning
        self._is_paper = config.refine.method == "cpd"
        self.states = PersonStates()

    @cached_property
    def _bodies(self) -> BodyFitter:
        from depth_pose.refine.body_fitter import BodyFitter

        return BodyFitter(self._bank.body, self._tuning.fit)

    @cached_property
    def _objective(self) -> Objective:
        from depth_pose.refine.objective import Objective

        return Objective(self._bank)

    @cached_property
    def _completer(self) -> MeshCompleter:
        from depth_pose.paper.completion import MeshCompleter

        return MeshCompleter(self._bank.body, self._tuning.completion, self._tuning.cpd)

    def make_matcher(self) -> Matcher:
        """Return the second stage."""
        from depth_pose.match.match import Matcher
        from depth_pose.refine.short_fit import ShortFit

        trial, scale = ShortFit(self._bodies.template), self._config.build.scale
        return Matcher(self._bank, trial, self.states, scale, self._tuning.match)

    def make_refiner(self) -> Refiner:
        """Return the third stage, with the method of fitting that is configured."""
        from depth_pose.refine.refine import Refiner

        build, t, fitter = self._config.build, self._tuning, None
        if self._is_paper:
            from depth_pose.paper.fitter import CompletionFitter

            fitter = CompletionFitter(self._completer)
        return Refiner(
            self._bank, self._bodies, fitter, self.states, self._objective, build, t.refine, t.build
        )

    def make_recoverer(self) -> FailureRecovery:
        """Return the fourth stage; with the method cpd it registers clouds, too."""
        from depth_pose.recover.recover import FailureRecovery

        c, t, clouds = self._config, self._tuning, None
        if self._is_paper:
            from depth_pose.recover.temporal import CloudTracker

            clouds = CloudTracker(self._completer, t.temporal)
        return FailureRecovery(
            self._bank, c.recover, c.smooth, self._bodies, self._objective, self.states, clouds, t.recover
        )
