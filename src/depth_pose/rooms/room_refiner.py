"""One body, all points: the pose of one person from every camera that sees them (Ye Sec. 6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.body.pose import BodyPose, Fitted, FittedBody
from depth_pose.core.config import PipelineConfig
from depth_pose.core.result import Skeleton
from depth_pose.core.rotations import matrix_to_quat
from depth_pose.core.skeleton import JOINT_NODES, Source
from depth_pose.recover.report import to_skeleton
from depth_pose.recover.smooth import low_pass, with_motion
from depth_pose.refine.body_fitter import BodyFitter
from depth_pose.refine.build_learner import BuildLearner
from depth_pose.refine.objective import Objective, Score
from depth_pose.refine.solver import Hypothesis, ScoredFit, SingleFits, solve
from depth_pose.rooms.merge import place
from depth_pose.rooms.room_fit import RoomFit
from depth_pose.rooms.starts import best_limbs
from depth_pose.rooms.view import View
from depth_pose.track.state import PersonState


@dataclass(frozen=True)
class Answer:
    """A camera's own answer for a person, with the data that it was fitted to.

    Attributes
    ----------
    view : View
    pose : BodyPose
        Room frame.
    confidence : (19,) float
        Of its joints.
    """

    view: View
    pose: BodyPose
    confidence: NDArray[np.floating]


@dataclass
class RoomMemory:
    """State of one person of the room.

    Attributes
    ----------
    state : PersonState
        With the last pose in the room's frame.
    stamp_ns : int
        Of the last answer.
    turn : int
        Number of answers; the cameras take turns in learning the build.
    """

    state: PersonState = field(default_factory=PersonState)
    stamp_ns: int = 0
    turn: int = 0

    def follow(self, pose: BodyPose, stamp_ns: int) -> None:
        """Remember an answer, from which the next fit starts."""
        answer = self.state.answer._replace(pose=pose)
        self.state, self.stamp_ns = self.state._replace(answer=answer), stamp_ns


class RoomRefiner:
    """Fits one build to a person's views, and reports the joints.

    Parameters
    ----------
    bank : Bank
    config : PipelineConfig
    """

    def __init__(self, bank: Bank, config: PipelineConfig) -> None:
        self._smooth, self.bodies = config.smooth, BodyFitter(bank.body)
        self._objective = Objective(bank)
        self._builds = BuildLearner(self.bodies.space, config.build)

    def refine(
        self,
        answers: Sequence[Answer],
        memory: RoomMemory,
        velocity: NDArray[np.float64],
        stamp_ns: int,
        named: tuple[str, str],
    ) -> Skeleton:
        """Return a person's skeleton in the room's frame.

        Parameters
        ----------
        answers : sequence of Answer
            One for each camera that sees the person.
        memory : RoomMemory
            Updated.
        velocity : (3,) float64
            Room frame, m/s.
        stamp_ns : int
        named : tuple of str
            Frame id and body id of the skeleton.
        """
        views = [answer.view for answer in answers]
        shares = np.array([view.area for view in views])
        shares /= shares.sum()
        size = float(np.exp(shares @ np.log([a.pose.scale for a in answers])))
        shape = self._builds.begin(memory.state.shape, size)
        way = velocity * ((stamp_ns - memory.stamp_ns) * 1e-9)
        starts = _starts(answers, memory.state, way, shape.scale)
        problem = SingleFits(
            RoomFit(*self.bodies.both_of(shape.build), views),
            lambda body: self._score(views, body, shares),
        )
        best = solve(starts, problem, is_measured=False)
        memory.follow(best.body.pose, stamp_ns)
        memory.turn += 1
        seen = [self._see(view, best.body) for view in views]
        teacher, (posed, score) = views[memory.turn % len(views)], seen[memory.turn % len(views)]
        learned = self._builds.learn(shape, teacher.target, posed, score.depth, stamp_ns)
        memory.state = memory.state._replace(shape=learned)
        told = []
        for view, (posed, score) in zip(views, seen, strict=True):
            terms = score.depth, score.mean_depth_error
            answer = Fitted(named[1], stamp_ns, Source.REFINED, posed, shape.build, *terms)
            own = place(to_skeleton(view.person, answer), view.T_room_camera, named[0])
            told.append(replace(own, stamp_ns=stamp_ns, body_id=named[1]))
        return self._fuse(best, told, shares, memory)

    def _see(self, view: View, body: FittedBody) -> tuple[FittedBody, Score]:
        """Return a body in a camera's frame, and its score there."""
        posed = view.body_in_camera(body)
        return posed, self._objective.score(view.person, posed)

    def _score(self, views: Sequence[View], body: FittedBody, shares: NDArray[np.float64]) -> Score:
        """Score a body in the room's frame, each view weighted by the area that it sees."""
        posed = [view.body_in_camera(body) for view in views]
        return self._objective.score_views([view.person for view in views], posed, shares)

    def _fuse(
        self, best: ScoredFit, told: Sequence[Skeleton], shares: NDArray[np.float64], memory: RoomMemory
    ) -> Skeleton:
        """Fuse the cameras' joints in the room's frame; each has its best camera's confidence."""
        first = told[0]
        places = np.array([t.positions for t in told])
        confidence = np.array([t.joint_confidence for t in told], np.float64)
        weight = confidence * shares[:, None]
        mean = (weight[..., None] * places).sum(axis=0) / weight.sum(axis=0)[:, None]
        before = memory.state.filter
        filtered = low_pass(
            before,
            mean if np.isfinite(mean).all() else best.body.nodes[JOINT_NODES],
            first.stamp_ns,
            self._smooth,
        )
        memory.state = memory.state._replace(filter=filtered)
        surest = confidence.argmax(axis=0), np.arange(len(mean))
        fused = Skeleton(
            stamp_ns=first.stamp_ns,
            frame_id=first.frame_id,
            body_id=first.body_id,
            source=Source.REFINED,
            confidence=max(t.confidence for t in told),
            residual=best.terms.mean_depth_error,
            scale=best.body.pose.scale,
            positions=mean,
            quats_xyzw=matrix_to_quat(best.body.pose.rotations[JOINT_NODES]),
            joint_confidence=confidence.max(axis=0).astype(np.float32),
            joint_states=np.min([t.joint_states for t in told], axis=0),
            build=first.build,
            covariances=np.array([t.covariances for t in told])[surest],
        )
        return with_motion(fused, before, filtered)


def _starts(
    answers: Sequence[Answer], state: PersonState, way: NDArray[np.float64], scale: float
) -> list[Hypothesis]:
    """Return the cameras' answers, the best limbs of all, and the last pose, moved by ``way``, metres."""
    poses = [BodyPose(a.pose.rotations, a.pose.root, scale) for a in answers]
    poses.append(best_limbs(poses, [a.confidence for a in answers], scale))
    starts, last = [Hypothesis(p, "camera") for p in poses], state.answer.pose
    if last is not None:
        starts.append(Hypothesis(BodyPose(last.rotations, last.root + way, scale), "previous"))
    return starts
