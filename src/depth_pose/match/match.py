"""Find the exemplars that look like the input, from any view (Sec. 5).

The cloud is transformed to canonical axes, drawn as a small depth image, projected into the bank's PCA
subspace, and compared with every view of every exemplar there (Ye et al. eq. 6, exact search). The paper
takes the nearest one. Here the nearest few dozen, and those nearest to the proposed joints, are posed, placed
at the input and rendered as small images, and the best of them as larger ones. The disagreement of rendered
and observed depth ranks them, and several are passed to the refinement, one of which faces as the proposed
joints do. The same score determines the person's size over the first frames.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.bank.canonical import describe
from depth_pose.bank.views import AXES
from depth_pose.body.pose import BodyPose
from depth_pose.core.config import MatchConfig
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.odds import logistic
from depth_pose.core.skeleton import JOINT_NODES, NODE_INDEX, NODES
from depth_pose.core.types import Candidate, PoseMatch
from depth_pose.match import turns
from depth_pose.match._match_kernels import keep_different
from depth_pose.match.placing import (
    ExemplarRenderer,
    ExemplarViews,
    Placed,
    better,
    join,
    place_exemplars,
)
from depth_pose.match.proposed_exemplars import ProposedExemplars
from depth_pose.match.scale import SCALES, SizeFinder, Trial
from depth_pose.match.search import SubspaceSearch
from depth_pose.match.upright_exemplars import UprightExemplars, head_axes
from depth_pose.track.person_view import FramePeople, PersonView
from depth_pose.track.sample_people import sample_people
from depth_pose.track.state import PersonState, PersonStates, SizeSearch
from depth_pose.track.time_budget import TimeBudget

_ROUGH_M, _FINE_M = 0.08, 0.04
"""Maximum pixel spacing at the person (m) of the coarse comparison, and of the fine one."""

_FINALISTS = 16
"""Number of exemplars compared in the fine image, as placed and corrected."""

_CORRECTED = 8
"""Number of the best of them that are corrected once more."""

_NEARLY = 0.04
"""Score difference below which best matches that face opposite ways are distinguished by fits."""

_LEFT, _RIGHT = ([NODE_INDEX[f"{side}_{n}"] for n in ("shoulder", "hip")] for side in ("left", "right"))

_SAME_POSE_M = 0.05
"""Candidates with a mean node distance below this (m) are the same pose."""


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
    config : MatchConfig
    trial : Trial
        Short fits of the bank's body, which compare sizes.
    states : PersonStates, optional
        States of all tracks, shared with the other stages of a process.

    Attributes
    ----------
    time_budget : TimeBudget
        Selection of people when time is short; no limit by default.
    """

    def __init__(
        self, bank: Bank, config: MatchConfig, trial: Trial, states: PersonStates | None = None
    ) -> None:
        self.bank = bank
        self.config = config
        self.time_budget = TimeBudget()
        self._search = SubspaceSearch(bank.coefficients.reshape(-1, bank.coefficients.shape[-1]))
        self._views = ExemplarViews(np.arange(bank.poses), bank.view_quats, bank.view_origins)
        self._renderer = ExemplarRenderer(bank, config.score_band)
        self._upright = UprightExemplars(bank)
        self._proposed = ProposedExemplars(bank)
        self._trial, self._sizes = trial, SizeFinder(config, trial)
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
        every, sizes = self.config.search_every, self._sizes
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
        rough = self.compare_roughly(person, scale, self.config.shortlist)
        placed = self._compare_finely(person, scale, rough)
        if not is_new and not sizes.is_known(search):
            search = sizes.add(search, person, self._pose(placed, 0, scale))
        match = PoseMatch(
            person.body_id, self.bank.bank_id, scale, self._keep_different(placed, person.measured)
        )
        schedule = turns.keep(state.schedule, person, match, every)
        return state._replace(schedule=schedule, shape=state.shape._replace(search=search)), match

    def _begin_size(self, search: SizeSearch, person: PersonView) -> SizeSearch:
        """Compare sizes in a person's first frame, by the exemplars that match best at a few of them."""
        few = max(4, self.config.shortlist // 4)
        tried = [(s, self.compare_roughly(person, s, few)) for s in self._first_sizes(person)]
        scale, rough = min(tried, key=lambda t: float(t[1].scores.min()))
        return self._sizes.add(
            search, person, self._pose(self._compare_finely(person, scale, rough), 0, scale)
        )

    def _first_sizes(self, person: PersonView) -> list[float]:
        """Return the sizes that are compared first: near the proposals' size, or over the whole range."""
        sizes = SCALES[1::3]
        if (guess := self._proposed.size(person.measured)) is None:
            return sizes.tolist()
        nearest = int(np.argmin(np.abs(np.log(sizes / guess))))
        return sizes[max(0, nearest - 1) : nearest + 2].tolist()

    def _pose(self, placed: Placed, row: int, scale: float) -> BodyPose:
        """Return the pose of one placed exemplar in the camera frame."""
        rotations = placed.rotations[row] @ self.bank.rotations(int(placed.exemplars[row]))
        return BodyPose(rotations, placed.translations[row], scale)

    def compare_roughly(self, person: PersonView, scale: float, shortlist: int) -> Placed:
        """Search with each of the input's axes at one size, and compare all results coarsely.

        Parameters
        ----------
        person : PersonView
        scale : float
            Size of the body, relative to the bank's.
        shortlist : int
            Maximum number of results of the search.

        Returns
        -------
        Placed
            Not ranked.
        """
        axes = AXES[self.bank.view_scheme](person.points)
        share = max(1, shortlist // len(axes))
        parts = []
        for a in axes:
            descriptor = describe(person.points, a, scale).astype(np.float32)
            nearest = self._search.find(self.bank.components @ (descriptor - self.bank.mean), share)
            parts.append(place_exemplars(self._views, nearest, a, scale))
        if person.is_cut_below:
            hung, upright = head_axes(person.points, scale), self._upright
            parts.append(place_exemplars(upright.views, upright.all, hung, scale))
        if (proposed := self._proposed.find(person.measured, scale)) is not None:
            parts.append(proposed)
        return self._renderer.compare(join(parts), scale, person.thinned(_ROUGH_M))

    def _compare_finely(self, person: PersonView, scale: float, rough: Placed) -> Placed:
        """Compare the best of the shortlist in a finer image, and sort them by score."""
        image = person.thinned(_FINE_M)
        ranking = rough.ranking()
        there = rough.take(_with_facing(ranking, _FINALISTS, _faces_alike(rough, person.measured)))
        # a correction from few pixels is only tried
        pairs = (self._renderer.compare(p, scale, image) for p in (there, there.moved()))
        compared = better(*pairs)
        ranking = compared.ranking()
        best = compared.take(_with_facing(ranking, _CORRECTED, _faces_alike(compared, person.measured)))
        best = better(best, self._renderer.compare(best.moved(), scale, image))
        return self.settle_facing(best.take(best.ranking()), person, scale)

    def settle_facing(self, placed: Placed, person: PersonView, scale: float) -> Placed:
        """Move the best exemplar that faces the other way to the front if it agrees better after a fit.

        From behind people look much as from the front. Where the bank has no near pose, one that faces the
        wrong way may agree as well as one that faces the right way.

        Parameters
        ----------
        placed : Placed
            Ranked, the best first.
        person : PersonView
        scale : float

        Returns
        -------
        Placed
        """
        across = _across(placed.nodes)
        close = placed.scores < placed.scores[0] + _NEARLY
        turned = np.flatnonzero(close & (across @ across[0] < 0.0))
        if turned.size == 0:
            return placed
        score, other = self._trial.scorer(person), turned[0]
        if score(self._pose(placed, 0, scale)) <= score(self._pose(placed, other, scale)):
            return placed
        rows = np.arange(len(placed.scores))
        return placed.take(np.insert(rows[rows != other], 0, other))

    def _keep_different(self, placed: Placed, measured: JointMeasurement | None) -> tuple[Candidate, ...]:
        """Return the best few candidates with different poses, one of them facing as is proposed."""
        different = keep_different(placed.nodes, _SAME_POSE_M, len(placed.scores))
        kept = _with_facing(different, self.config.keep, _faces_alike(placed, measured))
        return tuple(
            Candidate(
                exemplar=int(placed.exemplars[k]),
                view=int(placed.views[k]),
                rotation=placed.rotations[k],
                translation=placed.translations[k],
                distance=float(placed.distances[k]),
                score=float(placed.scores[k]),
            )
            for k in kept
        )


def _faces_alike(placed: Placed, measured: JointMeasurement | None) -> NDArray[np.bool_]:
    """Return which exemplars (K,) face as the proposed joints do; all without proposals."""
    if measured is None:
        return np.ones(len(placed.scores), np.bool_)
    proposed = np.empty((len(NODES), 3))
    proposed[JOINT_NODES] = measured.places
    return np.asarray(_across(placed.nodes) @ _across(proposed[None])[0] > 0.0)


def _across(nodes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return vectors (K, 3) to the persons' left."""
    return np.asarray(nodes[:, _LEFT].sum(axis=1) - nodes[:, _RIGHT].sum(axis=1))


def _with_facing(rows: NDArray[np.int64], most: int, alike: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the first ``most`` rows; if none faces alike, the last gives way to the first that does."""
    taken, others = rows[:most], rows[most:]
    if alike[taken].any() or not alike[others].any():
        return taken
    return np.append(taken[:-1], others[alike[others]][0])
