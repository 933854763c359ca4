"""One body, all points: the pose of one person from every camera that sees them (Ye Sec. 6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.body.pose import BodyPose, FittedBody
from depth_pose.body.rendered_depth import Comparison
from depth_pose.core.config import PipelineConfig
from depth_pose.core.rotations import matrix_to_quat
from depth_pose.core.skeleton import JOINT_NODES, Source
from depth_pose.core.types import Skeleton
from depth_pose.recover.confidence import report_joints, skeleton_confidence
from depth_pose.recover.measurements import weigh_joints
from depth_pose.recover.smooth import JointFilter
from depth_pose.refine.body_fitter import BodyFitter
from depth_pose.refine.build_learner import BuildLearner
from depth_pose.refine.kept_poses import KeptPoses, ScoredFit, by_score, choose_answer
from depth_pose.refine.pose_prior import PosePrior, usual_joints
from depth_pose.refine.proposals import from_proposals
from depth_pose.rooms.room_fit import RoomFit
from depth_pose.rooms.starts import best_limbs
from depth_pose.rooms.view import View
from depth_pose.track.memory import Subject

_ROUGH = 2
"""Number of starts, the best after a glance, that are fitted roughly."""


@dataclass(frozen=True)
class Answer:
    """A camera's own answer for a person, beside what it was fitted to.

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
    """What is remembered of one person of the room.

    Attributes
    ----------
    filter : JointFilter
    subject : Subject
        Holds the build.
    kept : KeptPoses
        The last pose, room frame.
    stamp_ns : int
        Of the last answer.
    turn : int
        The number of answers: the cameras teach the build in turn.
    """

    filter: JointFilter
    subject: Subject = field(default_factory=Subject)
    kept: KeptPoses = field(default_factory=KeptPoses)
    stamp_ns: int = 0
    turn: int = 0


class RoomRefiner:
    """Fits one build to a person's views, and reports the joints.

    Parameters
    ----------
    bank : Bank
    config : PipelineConfig
    """

    def __init__(self, bank: Bank, config: PipelineConfig) -> None:
        self._bank, self._band = bank, config.match.score_band
        self._scale_is_given = config.match.scale > 0.0
        self.bodies = BodyFitter(bank.body, config.fitting)
        self._prior = PosePrior(usual_joints(bank))
        self._builds = BuildLearner(self.bodies.space, config.fitting.build, config.fitting.fit)

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
        weights = np.array([view.area for view in views])
        size = float(np.exp(weights @ np.log([a.pose.scale for a in answers]) / weights.sum()))
        personal = self._builds.of(memory.subject, size, self._scale_is_given)
        fit = RoomFit(*self.bodies.both_of(personal.build), views)
        best = self._best(
            fit, answers, memory, velocity * ((stamp_ns - memory.stamp_ns) * 1e-9), personal.scale
        )
        memory.kept.beam, memory.stamp_ns = (best.body.pose,), stamp_ns
        memory.turn += 1
        teacher = views[memory.turn % len(views)]
        posed = teacher.body_in_camera(best.body)
        score = self._disagreement(teacher, posed).score
        self._builds.learn(personal, teacher.target, posed, score, stamp_ns)
        return self._report(best, personal.build, views, weights, memory, stamp_ns, named)

    def _best(
        self,
        fit: RoomFit,
        answers: Sequence[Answer],
        memory: RoomMemory,
        way: NDArray[np.float64],
        scale: float,
    ) -> ScoredFit:
        """Fit from the cameras' answers and from the last pose, and choose."""
        views = [answer.view for answer in answers]
        poses = [BodyPose(a.pose.rotations, a.pose.root, scale) for a in answers]
        starts = [*poses, best_limbs(poses, [a.confidence for a in answers], scale)]
        glances = sorted((self._compare(views, fit.glance(s)) for s in starts), key=by_score)
        roughs = [self._compare(views, fit.rough(g.body.pose)) for g in glances[:_ROUGH]]
        fresh = self._compare(views, fit.finish(min(roughs, key=by_score).body))
        if not memory.kept.beam:
            return fresh
        last = memory.kept.beam[0]
        kept = fit.rough(BodyPose(last.rotations, last.root + way, scale))
        return choose_answer(memory.kept, fresh, self._compare(views, fit.finish(kept)))

    def _compare(self, views: Sequence[View], body: FittedBody) -> ScoredFit:
        """Compare a body in the room's frame with all views, weighted by the area that each sees."""
        weights = np.array([view.area for view in views])
        weights /= weights.sum()
        posed = [view.body_in_camera(body) for view in views]
        seen = [self._disagreement(view, one) for view, one in zip(views, posed, strict=True)]
        away = [from_proposals(one.nodes, v.person.measured) for v, one in zip(views, posed, strict=True)]
        return ScoredFit(
            body,
            Comparison(float(weights @ [c.score for c in seen]), float(weights @ [c.gap for c in seen])),
            float(weights @ away),
            self._prior.excess(body.nodes, body.pose.scale),
        )

    def _disagreement(self, view: View, posed: FittedBody) -> Comparison:
        return view.person.comparer.compare(posed.vertices, self._bank.body.faces, self._band)

    def _report(
        self,
        best: ScoredFit,
        build: NDArray[np.float32],
        views: Sequence[View],
        weights: NDArray[np.float64],
        memory: RoomMemory,
        stamp_ns: int,
        named: tuple[str, str],
    ) -> Skeleton:
        """Fuse the fitted joints with each camera's proposals; a joint is as sure as its best camera is."""
        fitted, scale = best.body.nodes[JOINT_NODES], best.body.pose.scale
        places, confidence, states, whole = [], [], [], []
        for view in views:
            posed = view.body_in_camera(best.body)
            joints, score = posed.nodes[JOINT_NODES], self._disagreement(view, posed).score
            sure = report_joints(joints, scale, view.person, score)
            measured = weigh_joints(joints, score, sure.confidence, view.person.measured).joints
            report = report_joints(measured, scale, view.person, score)
            places.append(view.to_room(measured))
            confidence.append(report.confidence)
            states.append(report.states)
            whole.append(skeleton_confidence(view.person, measured, report.states, report.confidence))
        share = np.array(confidence) * weights[:, None]
        mean = (share[..., None] * np.array(places)).sum(axis=0) / share.sum(axis=0)[:, None]
        joint_confidence = np.max(confidence, axis=0)
        return Skeleton(
            stamp_ns=stamp_ns,
            frame_id=named[0],
            body_id=named[1],
            source=Source.REFINED,
            confidence=max(whole),
            residual=best.comparison.gap,
            scale=scale,
            positions=memory.filter.filter(mean if np.isfinite(mean).all() else fitted, stamp_ns),
            quats_xyzw=matrix_to_quat(best.body.pose.rotations[JOINT_NODES]),
            joint_confidence=joint_confidence.astype(np.float32),
            joint_states=np.min(states, axis=0),
            build=build,
        )
