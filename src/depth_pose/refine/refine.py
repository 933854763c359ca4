"""Fit the body to the cloud, starting from the previous pose and the matched exemplars (Sec. 6).

There are two methods with one interface. ``articulated`` fits joint angles of the skinned body
(`depth_pose.refine.articulated`). ``cpd`` is the paper's: non-rigid registration of the exemplar's visible
vertices, Laplacian completion of the mesh, and joints from control vertices (`depth_pose.paper.completion`).
Starts come from `depth_pose.refine.sources`, are fitted by `depth_pose.refine.solver`, and compared by
`depth_pose.refine.objective`.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from depth_pose.bank.bank import Bank
from depth_pose.body.pose import Fitted
from depth_pose.core.config import PersonalConfig
from depth_pose.core.errors import BankError
from depth_pose.core.pose_match import Candidate, PoseMatch
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL
from depth_pose.core.skeleton import Source
from depth_pose.refine.body_fitter import BodyFitter, PersonFitter
from depth_pose.refine.build_learner import BuildLearner
from depth_pose.refine.noise import renew_noise, skin_noise
from depth_pose.refine.objective import Objective
from depth_pose.refine.solver import Problem, solve
from depth_pose.refine.sources import from_exemplars, from_joints, from_previous
from depth_pose.refine.tuning import BuildTuning, RefineTuning
from depth_pose.refine.unseen_legs import UnseenLegs
from depth_pose.track.person_view import FramePeople, PersonView
from depth_pose.track.sample_people import SAMPLE_DISTANCE_M, sample_people
from depth_pose.track.state import PersonState, PersonStates, Shape


class Refiner:
    """The third stage of the pipeline, run by `refine_node`.

    Parameters
    ----------
    bank : Bank
    bodies : BodyFitter
    fitter : PersonFitter, optional
        The method; the articulated fit of ``bodies`` if not given.
    states : PersonStates, optional
        States of all tracks, shared with the other stages of a process.
    objective : Objective, optional
        Shared with the other stages of a process.
    build : PersonalConfig
    tuning : RefineTuning
    build_tuning : BuildTuning

    Attributes
    ----------
    builds : BuildLearner
        Learned builds of all tracks.
    """

    def __init__(
        self,
        bank: Bank,
        bodies: BodyFitter,
        fitter: PersonFitter | None = None,
        states: PersonStates | None = None,
        objective: Objective | None = None,
        build: PersonalConfig = PersonalConfig(),
        tuning: RefineTuning = RefineTuning(),
        build_tuning: BuildTuning = BuildTuning(),
    ) -> None:
        self.bank = bank
        self.tuning = tuning
        self._bodies = bodies
        self._fitter = fitter or bodies
        self._states = states or PersonStates()
        self._objective = objective or Objective(bank)
        self._unseen_legs = UnseenLegs(self._objective.usual)
        self.builds = BuildLearner(bodies.space, build, build_tuning, bodies.tuning)

    def reset(self) -> None:
        """Forget all tracks."""
        self._states.reset()
        self.builds.reset()

    def warm_up(self) -> None:
        """Compile every kernel; forgets all tracks."""
        people = sample_people(self.bank)
        place = np.array([0.0, 0.0, SAMPLE_DISTANCE_M])
        start = Candidate(
            0, 0, R_CAMERA_FACING_MODEL, place, 0.0, 0.0
        )  # fits so well that its build is learned
        matches = [PoseMatch(p.body_id, self.bank.bank_id, 1.0, (start,)) for p in people.persons]
        for fitted in self.refine(people, matches):
            if fitted.body is not None:  # as if the image ended above the legs
                waist = people.camera._replace(height=5 * people.camera.height // 8)
                self._unseen_legs.settle(self.bank.body, fitted.body, waist)
        self.reset()

    def refine(self, people: FramePeople, matches: Iterable[PoseMatch]) -> tuple[Fitted, ...]:
        """Fit the body to every matched person.

        Parameters
        ----------
        people : FramePeople
        matches : iterable of PoseMatch
            The matcher's answers for the same people; people without one are skipped.

        Returns
        -------
        tuple of Fitted
            Source REFINED, or LOST without a candidate.

        Raises
        ------
        BankError
            If a match refers to another bank.
        """
        self._states.begin(people)
        persons = {p.body_id: p for p in people.persons}
        answers = []
        for match in matches:
            if (person := persons.get(match.body_id)) is not None:
                state, fitted = self.estimate(self._states[match.body_id], person, match)
                self._states[match.body_id] = state
                self.builds.keep(state.shape)
                answers.append(fitted)
        return tuple(answers)

    def estimate(
        self, state: PersonState, person: PersonView, match: PoseMatch
    ) -> tuple[PersonState, Fitted]:
        """Fit the body to one person; return the person's new state, and the fit."""
        self._check_bank(match)
        if not match.candidates:
            state = state._replace(answer=state.answer._replace(pose=None))
            return state, Fitted.lost(person.stamp_ns, person.body_id)
        shape = self.builds.begin(state.shape, match.scale)
        # the previous answer, and exemplars of the bank (Sec. 5)
        starts = from_previous(state.answer.pose, shape.scale) if self.tuning.track else []
        starts += from_exemplars(match, shape.scale, self.bank)
        best = solve(
            starts,
            self._problem(person, shape, state.answer.noise),
            is_measured=person.measured is not None,
            is_calm=person.found.is_calm,
        )
        body = self._unseen_legs.settle(self._bodies.space.body(shape.build), best.body, person.camera)
        target = self._bodies.target(person)
        learned = self.builds.learn(shape, target, best.body, best.terms.depth, person.stamp_ns)
        noise = renew_noise(state.answer.noise, skin_noise(person, best.terms.mean_depth_error))
        answer = state.answer._replace(pose=best.body.pose, noise=noise)
        state = state._replace(answer=answer, shape=learned)
        return state, Fitted(
            person.body_id,
            person.stamp_ns,
            Source.REFINED,
            body,
            shape.build,
            best.terms.depth,
            best.terms.mean_depth_error,
        )

    def _problem(self, person: PersonView, shape: Shape, noise: float) -> Problem:
        """Return what the solver needs to know of one person in one frame."""
        return self._fitter.problem(
            person,
            shape.build,
            self._objective,
            noise,
            lambda body: from_joints(self.bank.body, body.pose, person.measured),
        )

    def _check_bank(self, match: PoseMatch) -> None:
        if match.bank_id != self.bank.bank_id:
            raise BankError(
                f"the match refers to bank {match.bank_id}, but {self.bank.bank_id} is loaded here; "
                "give the nodes one bank file, and start all of them again where it was replaced"
            )
