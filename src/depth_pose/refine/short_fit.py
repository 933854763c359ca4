"""Short fits to one frame, which compare sizes by their agreement after the fit."""

from __future__ import annotations

from collections.abc import Callable

from depth_pose.body.pose import BodyPose
from depth_pose.refine.articulated import ArticulatedFitter
from depth_pose.track.person_view import PersonView


class ShortFit:
    """Fits poses with half of the points that the solver uses, and without measured joints.

    Parameters
    ----------
    fitter : ArticulatedFitter
    """

    def __init__(self, fitter: ArticulatedFitter) -> None:
        self._fitter = fitter

    def scorer(self, person: PersonView) -> Callable[[BodyPose], float]:
        """Return a function that fits from a start, and returns the rendered-depth disagreement."""
        body, tuning, comparer = self._fitter.body, self._fitter.tuning, person.comparer
        target = person.target(tuning.max_points // 2, with_proposals=False)

        def score(start: BodyPose) -> float:
            pose = self._fitter.fit(target, start, tuning.trial).pose
            posed = body.pose(pose.rotations, pose.root, pose.scale)
            return comparer.compare(posed.vertices, body.faces).score

        return score
