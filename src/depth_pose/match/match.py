"""Find the exemplars that look like the input, from any view, and the person's size (Sec. 5).

`depth_pose.match.exemplars` finds the exemplars at one size, `depth_pose.match.scale` estimates the size over
the first frames, and `depth_pose.match.turns` says when a search is due. Several candidates are passed to the
refinement.
"""

from __future__ import annotations

from depth_pose.bank.bank import Bank
from depth_pose.core.odds import logistic
from depth_pose.core.pose_match import PoseMatch
from depth_pose.match import turns
from depth_pose.match.exemplars import ExemplarSource
from depth_pose.match.scale import SizeFinder, Trial
from depth_pose.match.tuning import MatchTuning
from depth_pose.track.person_view import FramePeople, PersonView
from depth_pose.track.sample_people import sample_people
from depth_pose.track.state import PersonState, PersonStates
from depth_pose.track.time_budget import TimeBudget

_EVEN_SCORE, _SCORE_SPREAD = 0.56, 0.057
"""Centre and scale of a logistic curve fitted to simulated people by ``benchmarks/banks.py score``."""


def match_confidence(score: float) -> float:
    """Compute the probability, 0 to 1, that a best match with this score is right.

    A match is right if its joints are within 100 mm on average, before any refinement, and left and right,
    front and back are not exchanged.
    """
    return float(logistic((_EVEN_SCORE - score) / _SCORE_SPREAD))


class Matcher:
    """The second stage of the pipeline, run by `matcher_node`.

    Parameters
    ----------
    bank : Bank
    trial : Trial
        Short fits of the bank's body, which compare sizes.
    states : PersonStates, optional
        States of all tracks, shared with the other stages of a process.
    scale : float
        Size of every person relative to a 1.75 m adult; 0: estimated.
    tuning : MatchTuning

    Attributes
    ----------
    exemplars : ExemplarSource
    time_budget : TimeBudget
        Selection of people when time is short; no limit by default.
    """

    def __init__(
        self,
        bank: Bank,
        trial: Trial,
        states: PersonStates | None = None,
        scale: float = 0.0,
        tuning: MatchTuning = MatchTuning(),
    ) -> None:
        self.bank = bank
        self.tuning = tuning
        self.exemplars = ExemplarSource(bank, tuning)
        self.time_budget = TimeBudget()
        self._sizes = SizeFinder(trial, scale, tuning.scale_frames)
        self._states = states or PersonStates()

    def reset(self) -> None:
        """Forget all tracks."""
        self._states.reset()

    def warm_up(self) -> None:
        """Compile every kernel; forgets all tracks."""
        self.match(sample_people(self.bank))
        self.reset()

    def match(self, people: FramePeople) -> tuple[PoseMatch, ...]:
        """Find the exemplars nearest to each person.

        Parameters
        ----------
        people : FramePeople

        Returns
        -------
        tuple of PoseMatch
            One for each processed person (`TimeBudget`).
        """
        self._states.begin(people)
        matches = []
        for person in self.time_budget.take(people.persons):
            state, match = self.estimate(self._states[person.body_id], person)
            self._states[person.body_id] = state
            matches.append(match)
        return tuple(matches)

    def estimate(self, state: PersonState, person: PersonView) -> tuple[PersonState, PoseMatch]:
        """Find the exemplars nearest to one person, by a new search or carried along."""
        every, sizes, source = self.tuning.search_every, self._sizes, self.exemplars
        schedule, search = state.schedule, sizes.watch(state.shape.search, person)
        match = None
        if sizes.is_known(search):
            schedule, match = turns.carry(schedule, person, sizes.scale(search), every)
        if match is None:
            scale, placed = source.find(person, sizes.so_far(search))
            if not sizes.is_known(search):
                search = sizes.add(search, person, source.pose(placed, 0, scale))
            found = source.keep_different(placed, is_measured=person.measured is not None)
            match = PoseMatch(person.body_id, self.bank.bank_id, sizes.scale(search), found)
            schedule = turns.keep(schedule, person, match, every)
        return state._replace(schedule=schedule, shape=state.shape._replace(search=search)), match
