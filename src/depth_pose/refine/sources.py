"""Sources of hypotheses: from the state of a person, the matched exemplars, and the joints in view."""

from __future__ import annotations

from depth_pose.bank.bank import Bank
from depth_pose.body.pose import BodyPose, FittedBody
from depth_pose.core.types import PoseMatch
from depth_pose.refine.hypotheses import Hypothesis
from depth_pose.refine.limbs import LimbSearch
from depth_pose.refine.proposals import aim_at_proposals
from depth_pose.track.person_view import PersonView
from depth_pose.track.state import PersonState


def from_previous(state: PersonState) -> list[Hypothesis]:
    """Return the poses that are followed, at the size in use: the previous answer first."""
    poses = [BodyPose(p.rotations, p.root, state.shape.scale) for p in state.answer.followed]
    return [Hypothesis(p, "carried" if k else "previous") for k, p in enumerate(poses)]


def from_exemplars(match: PoseMatch, state: PersonState, bank: Bank) -> list[Hypothesis]:
    """Return the matched exemplars, at the size in use."""
    return [Hypothesis(bank.pose(c, state.shape.scale), "exemplar") for c in match.candidates]


def from_limbs(body: FittedBody, person: PersonView, limbs: LimbSearch, bank: Bank) -> list[Hypothesis]:
    """Return a fitted body with other arms or legs: those of exemplars, and turned to the measured joints."""
    found = [Hypothesis(pose, "limb") for pose in limbs.propose(body, person.comparer)]
    aimed = aim_at_proposals(bank.body, body.pose, person.measured)
    return found + [Hypothesis(pose, "joints") for pose in aimed]
