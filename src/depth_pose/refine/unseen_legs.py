"""Legs beyond the image: moved halfway to the mean of legs in similar poses.

Beyond the image's border there are no points, so a leg stays as in the exemplar. The mean leg of the bank's
poses that are most like the rest of the body is too neutral and the exemplar too specific; their midpoint has
the least error. A bone that is mostly visible moves less. Occluded limbs are left unchanged: for those the
mean is worse.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.body.pose import BodyPose, FittedBody
from depth_pose.core.camera import Camera
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES
from depth_pose.refine import _aim_kernels as aim
from depth_pose.refine import _plausible_kernels as kernels

_LEGS = tuple(
    tuple(JOINT_INDEX[f"{side}_{name}"] for name in ("hip", "knee", "ankle", "foot"))
    for side in ("left", "right")
)

_NEIGHBOURS = 40
"""Number of most similar poses that are averaged."""

_POSES = 5000
"""Number of poses, about, among which they are searched; all of a bank's are as good."""

_HALFWAY = 0.5
"""Share of the way to their mean; chosen on development clips."""

_HARDLY_SEEN = 0.5
"""The first bone that leaves the image moves fully if this share of it is outside, and less if less is."""

_UNSEEN = 0.1
"""Weight of joints outside the image that are not the leg's own, relative to 1 for the others."""


_PLACES = (np.arange(8) + 0.5)[:, None] / 8
"""Places along a bone that are tested for being in the image, as shares of its length."""


class UnseenLegs:
    """Corrects legs beyond the image's border.

    Parameters
    ----------
    usual : (N, 19, 3) float64
        `depth_pose.refine.pose_prior.usual_joints` of a bank.
    """

    def __init__(self, usual: NDArray[np.float64]) -> None:
        self._joints = usual[:: max(1, len(usual) // _POSES)].astype(np.float32)
        self._rows = self._joints.reshape(len(self._joints), -1)
        self._squares = (self._joints**2).sum(axis=2)

    def settle(self, body: Body, fitted: FittedBody, camera: Camera) -> FittedBody:
        """Return a fitted body with corrected legs; unchanged if no leg leaves the image.

        Parameters
        ----------
        body : Body
            The body that was fitted.
        fitted : FittedBody
        camera : Camera
            Camera of the whole image.
        """
        joints = fitted.nodes[JOINT_NODES]
        outside = _is_outside(joints, camera)
        if not any(outside[leg[-1]] and not outside[leg[0]] for leg in _LEGS):
            return fitted
        pose = fitted.pose
        local, segments = np.empty(joints.shape), []
        axes = kernels.in_trunk_axes(joints, local)
        local /= pose.scale
        targets, hung = fitted.nodes.copy(), []
        for leg in _LEGS:
            first = next((k for k in (1, 2, 3) if outside[list(leg[k:])].all()), 0)
            if not first or outside[leg[0]]:
                continue
            tail = list(leg[first:])
            usual = self._usual(local, outside, leg[first - 1], tail) @ axes * pose.scale
            share = np.full((len(tail), 1), _HALFWAY)
            unseen = _share_outside(joints[leg[first - 1]], joints[leg[first]], camera)
            share[0] *= min(1.0, unseen / _HARDLY_SEEN)
            nodes = JOINT_NODES[tail]
            hung.append((JOINT_NODES[leg[first - 1]], nodes))
            targets[nodes] += share * (joints[leg[first - 1]] + usual - targets[nodes])
            segments += [JOINT_NODES[list(leg[k - 1 : k + 1])] for k in range(first, 4)]
        rotations = pose.rotations.copy()
        aim.aim_segments(body.nodes, np.array(segments).T, targets, rotations)
        for leg in _LEGS:
            rotations[JOINT_NODES[leg[3]]] = rotations[JOINT_NODES[leg[2]]]
        posed = body.pose(rotations, pose.root, pose.scale)
        settled = fitted.nodes.copy()
        for start, nodes in hung:  # the others stay where they were fitted
            settled[nodes] = fitted.nodes[start] + posed.nodes[nodes] - posed.nodes[start]
        return FittedBody(BodyPose(rotations, pose.root, pose.scale), posed.vertices, settled)

    def _usual(
        self, local: NDArray[np.float64], outside: NDArray[np.bool_], start: int, tail: list[int]
    ) -> NDArray[np.float32]:
        """Compute the usual places of a leg's joints (n, 3) relative to their parent, trunk axes, scale 1."""
        weights = np.where(outside, _UNSEEN, 1.0).astype(np.float32)
        weights[tail] = 0.0
        pull = (weights[:, None] * local).astype(np.float32).ravel()
        distance = self._squares @ weights - 2.0 * (self._rows @ pull)
        count = min(_NEIGHBOURS, len(distance))
        near = self._joints[np.argpartition(distance, count - 1)[:count]]
        return np.asarray((near[:, tail] - near[:, start, None]).mean(axis=0))


def _is_outside(points: NDArray[np.float64], camera: Camera) -> NDArray[np.bool_]:
    """Return which points (n, 3) lie outside the image."""
    u, v = camera.project(points).T
    return np.asarray((u < -0.5) | (v < -0.5) | (u >= camera.width - 0.5) | (v >= camera.height - 0.5))


def _share_outside(start: NDArray[np.float64], end: NDArray[np.float64], camera: Camera) -> float:
    """Compute the share of a bone that lies outside the image."""
    return float(_is_outside(start + _PLACES * (end - start), camera).mean())
