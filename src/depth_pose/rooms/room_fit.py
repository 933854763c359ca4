r"""The articulated fit of one body to the points of several cameras at once.

The E-step and the equations of each camera's points, free space and proposals are those of
`depth_pose.refine.articulated`, in that camera's frame. The equations of a segment's rigid motion,
:math:`(\omega, t)` about the root, turn with the axes, so the sum in the room's frame is

.. math:: I = \sum_c \mathrm{diag}(R_c, R_c)^T\, I_c\, \mathrm{diag}(R_c, R_c), \qquad
   f = \sum_c \mathrm{diag}(R_c, R_c)^T f_c,

with the camera's rotation :math:`R_c`, and one Gauss-Newton step is taken from the sum.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from depth_pose.body.pose import BodyPose, FittedBody
from depth_pose.refine import _articulated_kernels as kernels
from depth_pose.refine._tree_kernels import take_step
from depth_pose.refine.articulated import ArticulatedFitter
from depth_pose.rooms import _room_kernels
from depth_pose.rooms.view import View


class RoomFit:
    """Fits one build to one person's views in one frame; poses are in the room's frame.

    Parameters
    ----------
    fine, coarse : ArticulatedFitter
        With the whole mesh of the build, and with a coarse one.
    views : sequence of View
        At least one.
    """

    def __init__(self, fine: ArticulatedFitter, coarse: ArticulatedFitter, views: Sequence[View]) -> None:
        self._fine, self._coarse, self._views = fine, coarse, views

    def glance(self, start: BodyPose) -> FittedBody:
        """Run a short fit, precise enough to rank the starts."""
        return self._fit(self._coarse, start, self._coarse.tuning.glance)

    def rough(self, start: BodyPose) -> FittedBody:
        """Run a rough fit, precise enough to choose between a few starts."""
        return self._fit(self._coarse, start, self._coarse.tuning.rough)

    def finish(self, fitted: FittedBody) -> FittedBody:
        """Refine a rough fit to full precision."""
        return self._fit(self._fine, fitted.pose, self._fine.tuning.fine)

    def _fit(self, fitter: ArticulatedFitter, start: BodyPose, sigmas: Sequence[float]) -> FittedBody:
        body, settings = fitter.articulation, fitter.settings
        works = [kernels.make_workspace(view.target, body) for view in self._views]
        own, total = kernels.make_equations(body), kernels.make_equations(body)
        moved = np.zeros(len(body.above))
        rotations, root = start.rotations.copy(), start.root.copy()
        nodes = np.empty(works[0].nodes.shape)
        for k, sigma in enumerate(sigmas):
            total.inertia[:] = 0.0
            total.force[:] = 0.0
            amount = 0.0
            for view, work in zip(self._views, works, strict=True):
                seen = view.pose_in_camera(BodyPose(rotations, root, start.scale))
                amount += kernels.add_view(
                    view.target, body, settings, sigma, k, start.scale, seen.rotations, seen.root, work, own
                )
                _room_kernels.add_turned(own, view.rotation, total)
            nodes[:] = self._views[0].to_room(works[0].nodes)
            take_step(total, body, settings, amount, nodes, moved, rotations, root)
        posed = self._fine.body.pose(rotations, root, start.scale)
        return FittedBody(BodyPose(rotations, root, start.scale), posed.vertices, posed.nodes)
