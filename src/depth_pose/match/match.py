"""Find the exemplars that look like the input, from any view, and the person's size (Sec. 5).

`depth_pose.match.exemplars` finds the exemplars at one size, `depth_pose.match.scale` estimates the size over
the first frames, and `depth_pose.match.turns` says when a search is due. Several candidates are passed to the
refinement.
"""

from __future__ import annotations

import numpy as np

from depth_pose.bank.bank import Bank
from depth_pose.core.odds import logistic
from depth_pose.core.types import PoseMatch
from depth_pose.match import turns
from depth_pose.match.exemplars import ExemplarSource
from depth_pose.match.scale import SCALES, SizeFinder, Trial
from depth_pose.match.tuning import MatchTuning
from depth_pose.track.person_view import FramePeople, PersonView
from depth_pose.track.sample_people import sample_people
from depth_pose.track.state import PersonState, PersonStates, SizeSearch
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
        every, sizes = self.tuning.search_every, self._sizes
        search = sizes.watch(state.shape.search, person)
        if sizes.is_known(search):
            schedule, is_due = turns.count_frame(state.schedule, person, every)
            state = state._replace(schedule=schedule, shape=state.shape._replace(search=search))
            if not is_due:
                return state, turns.carried(schedule, person, sizes.scale(search))
        is_new = search.frames == 0
        if not sizes.is_begun(search):
            search = self._begin_size(search, person)
        scale = sizes.scale(search)
        placed = self.exemplars.find(person, scale)
        if not is_new and not sizes.is_known(search):
            search = sizes.add(search, person, self.exemplars.pose(placed, 0, scale))
        match = PoseMatch(person.body_id, self.bank.bank_id, scale, self.exemplars.keep_different(placed))
        schedule = turns.keep(state.schedule, person, match, every)
        return state._replace(schedule=schedule, shape=state.shape._replace(search=search)), match

    def _begin_size(self, search: SizeSearch, person: PersonView) -> SizeSearch:
        """Compare sizes in a person's first frame, by the exemplars that match best at a few of them."""
        few, source = max(4, self.tuning.shortlist // 4), self.exemplars
        sizes = _first_sizes(source.measured_size(person))
        tried = [(s, source.compare_roughly(person, s, few)) for s in sizes]
        scale, rough = min(tried, key=lambda t: float(t[1].scores.min()))
        placed = source.compare_finely(person, scale, rough)
        return self._sizes.add(search, person, source.pose(placed, 0, scale))


def _first_sizes(measured: float | None) -> list[float]:
    """Return the sizes that are compared first: near the measured one, or over the whole range."""
    sizes = SCALES[1::3]
    if measured is None:
        return sizes.tolist()
    nearest = int(np.argmin(np.abs(np.log(sizes / measured))))
    return sizes[max(0, nearest - 1) : nearest + 2].tolist()
