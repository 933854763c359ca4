"""The stages that need the exemplar bank, built from one configuration; each is imported at first use.

A node's process runs one of them, and starts faster and with less memory without the others.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

from depth_pose.bank.bank import Bank
from depth_pose.core.config import PipelineConfig
from depth_pose.track.memory import Subjects

if TYPE_CHECKING:
    from depth_pose.match.match import Matcher
    from depth_pose.paper.completion import MeshCompleter
    from depth_pose.paper.fitter import CompletionFitter
    from depth_pose.recover.recover import Recoverer
    from depth_pose.refine.body_fitter import BodyFitter
    from depth_pose.refine.refine import Refiner


class Shared:
    """State shared by the stages of one process: the body with its fits, and the memory of all people.

    Parameters
    ----------
    bank : Bank
    config : PipelineConfig

    Attributes
    ----------
    subjects : Subjects
    """

    def __init__(self, bank: Bank, config: PipelineConfig = PipelineConfig()) -> None:  # noqa: B008
        self._bank, self._config = bank, config
        self.subjects = Subjects()

    @cached_property
    def _bodies(self) -> BodyFitter:
        from depth_pose.refine.body_fitter import BodyFitter

        return BodyFitter(self._bank.body, self._config.fitting)

    @cached_property
    def _completer(self) -> MeshCompleter:
        from depth_pose.paper.completion import MeshCompleter

        return MeshCompleter(self._bank.body, self._config.completion, self._config.cpd)

    def make_matcher(self) -> Matcher:
        """Return the second stage."""
        from depth_pose.match.match import Matcher

        return Matcher(self._bank, self._config.match, self._bodies.template, self.subjects)

    def make_refiner(self) -> Refiner:
        """Return the third stage, with the method of fitting that is configured."""
        from depth_pose.refine.refine import Refiner

        c = self._config
        fitter = self._make_completion_fitter() if c.refine.method == "cpd" else self._bodies
        return Refiner(self._bank, c.refine, c.match, self._bodies, fitter, self.subjects)

    def _make_completion_fitter(self) -> CompletionFitter:
        from depth_pose.paper.fitter import CompletionFitter

        return CompletionFitter(self._completer)

    def make_recoverer(self) -> Recoverer:
        """Return the fourth stage."""
        from depth_pose.recover.recover import Recoverer

        c = self._config
        return Recoverer(
            self._bank, c.recover, c.smooth, c.match, self._bodies, self._completer, self.subjects
        )
