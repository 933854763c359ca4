"""Short fits to one frame, which compare poses and sizes by their agreement after the fit."""

from __future__ import annotations

from typing import TYPE_CHECKING

from depth_pose.body.pose import BodyPose
from depth_pose.track.person_view import PersonView

if TYPE_CHECKING:
    from depth_pose.refine.articulated import ArticulatedFitter

_POINTS = 400
"""Number of points, half of a full fit (`FitConfig.max_points`); set by hand."""


class TrialFits:
    """Fits poses to one frame with fewer points than `depth_pose.refine.refine` does."""

    def __init__(self, fitter: ArticulatedFitter, band: float, view: PersonView) -> None:
        self._fitter, self._band = fitter, band
        self._comparer = view.comparer
        self._target = view.target(_POINTS, with_proposals=False)

    def score(self, start: BodyPose) -> float:
        """Fit from a start, and return the rendered-depth score."""
        pose = self._fitter.fit(self._target, start, self._fitter.config.trial).pose
        body = self._fitter.body
        posed = body.pose(pose.rotations, pose.root, pose.scale)
        return self._comparer.compare(posed.vertices, body.faces, self._band).score
