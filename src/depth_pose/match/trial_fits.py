"""Short fits to one frame: poses and sizes are compared by how well they can be made to agree."""

from __future__ import annotations

from depth_pose.body.rendered_depth import DepthComparer
from depth_pose.refine.articulated import ArticulatedFitter, BodyPose, FitTarget
from depth_pose.track.person import Person, thin

_POINTS = 400
"""Half of the points of a fit (`FitConfig.max_points`) tell sizes apart; set by hand, not swept."""


class TrialFits:
    """Fits poses to one frame with fewer points than `depth_pose.refine.refine` does."""

    def __init__(self, fitter: ArticulatedFitter, band: float, view: Person) -> None:
        self._fitter = fitter
        self._comparer = DepthComparer(view.coarse, band)
        self._target = FitTarget.prepare(thin(view.points, _POINTS), view.full, view.coarse)

    def score(self, start: BodyPose) -> float:
        """Fit from a start, and give the rendered-depth score."""
        pose = self._fitter.fit(self._target, start, self._fitter.config.trial)
        body = self._fitter.body
        posed = body.pose(pose.rotations, pose.root, pose.scale)
        return self._comparer.compare(posed.vertices, body.faces).score
