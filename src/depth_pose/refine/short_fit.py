"""Short fits to one frame, which compare sizes by their agreement after the fit."""

from __future__ import annotations

from collections.abc import Callable

from depth_pose.body.pose import BodyPose
from depth_pose.refine.articulated import ArticulatedFitter
from depth_pose.track.person_view import PersonView

_POINTS = 400
"""Number of points, half of a full fit (`FitConfig.max_points`); set by hand."""


class ShortFit:
    """Fits poses with fewer points than the solver does, and without measured joints.

    Parameters
    ----------
    fitter : ArticulatedFitter
    band : float
        Depth difference that counts as a full mismatch, metres (`MatchConfig.score_band`).
    """

    def __init__(self, fitter: ArticulatedFitter, band: float) -> None:
        self._fitter, self._band = fitter, band

    def scorer(self, person: PersonView) -> Callable[[BodyPose], float]:
        """Return a function that fits from a start, and returns the rendered-depth disagreement."""
        target, comparer = person.target(_POINTS, with_proposals=False), person.comparer
        body, sigmas = self._fitter.body, self._fitter.config.trial

        def score(start: BodyPose) -> float:
            pose = self._fitter.fit(target, start, sigmas).pose
            posed = body.pose(pose.rotations, pose.root, pose.scale)
            return comparer.compare(posed.vertices, body.faces, self._band).score

        return score
