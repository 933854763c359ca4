"""Carry a body from one frame to the next by the clouds alone (Sec. 6, failure recovery).

The cloud of frame t-1 is registered to that of frame t by coherent point drift. Each visible vertex of the
last mesh corresponds to the points of frame t-1 around it and moves with them. The rest of the mesh follows
by Laplacian completion (Ye et al. eq. 7), and the joints by their control vertices (Ye et al. eq. 8).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.body.build import build_space
from depth_pose.body.pose import BodyPose, Fitted, FittedBody
from depth_pose.body.rendered_depth import Observation
from depth_pose.paper import _cpd_kernels as kernels
from depth_pose.paper.completion import MeshCompleter
from depth_pose.paper.cpd import register
from depth_pose.recover.tuning import TemporalTuning
from depth_pose.track.person_view import PersonView, thin

Array = NDArray[np.float64]


_MAX_POINTS = 450
"""Maximum number of points of each of the two registered clouds; set by hand, for time."""


class CloudTracker:
    """Carries the body of a completer from frame to frame."""

    def __init__(self, completer: MeshCompleter, tuning: TemporalTuning = TemporalTuning()) -> None:
        self._completer = completer
        self._space = build_space(completer.body)
        self.tuning = tuning
        self._cpd = completer.cpd._replace(beta=tuning.beta, stiffness=tuning.stiffness)

    def carry(self, before: PersonView, now: PersonView, last: Fitted) -> BodyPose:
        """Carry the body of frame t-1 to frame t.

        Parameters
        ----------
        before, now : PersonView
            The person at t-1 and t.
        last : Fitted
            The body at t-1.

        Returns
        -------
        BodyPose
            The body at t; unchanged if no vertex was visible.
        """
        points = thin(before.points, _MAX_POINTS), thin(now.points, _MAX_POINTS)
        return self.carry_body(*points, before.coarse, last.pose, self._space.body(last.build)).pose

    def carry_body(
        self, before: Array, now: Array, coarse_before: Observation, pose: BodyPose, body: Body
    ) -> FittedBody:
        """Carry a body from frame t-1 to frame t.

        Parameters
        ----------
        before, now : (M, 3), (N, 3) float64
            The person's points at t-1 and t, metres, camera frame; a few hundred suffice.
        coarse_before : Observation
            Frame t-1 at low resolution, used to determine the visible vertices.
        pose : BodyPose
            The body at t-1.
        body : Body
            The person's build of the completer's body.

        Returns
        -------
        FittedBody
            The body at t; unchanged if no vertex was visible.
        """
        completer = self._completer.of(body)
        found = register(before, now, self._cpd)
        posed = body.pose(pose.rotations, pose.root, pose.scale)
        facing = completer.visible(posed, pose.rotations, coarse_before)
        visible = np.flatnonzero(facing > completer.tuning.min_facing)
        targets, weights = posed.vertices.copy(), np.zeros(len(posed.vertices))
        seen, mass = posed.vertices[visible], np.empty(len(visible))
        kernels.follow(seen, before, found.moved, found.probability, self.tuning.reach, seen, mass)
        targets[visible], weights[visible] = seen, completer.tuning.weight * np.minimum(mass, 1.0)
        return completer.complete(pose, posed, targets, weights)
