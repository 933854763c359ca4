"""Data of one person in one frame for the articulated fit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.rendered_depth import Observation
from depth_pose.core.skeleton import JOINT_NODES, JOINTS, MIRROR_JOINTS
from depth_pose.core.types import FoundPerson
from depth_pose.track import _target_kernels as kernels

_NO_HEELS = np.zeros((2, 0, 5))


class Proposals(NamedTuple):
    """Joints proposed by the finder's second look, under both namings of left and right.

    Attributes
    ----------
    nodes : (J,) int64
        The body's node of each joint.
    places : (2, J, 3) float64
        Camera frame, metres: named as proposed, and with left and right exchanged.
    weights : (2, J) float64
        Confidence of each, 0 to 1.
    sigmas : (2, J, 2) float64
        Standard deviation of each across its ray and along it, metres.
    heels : (2, H, 5) float64
        As in `depth_pose.core.types.FoundPerson`, under both namings.
    """

    nodes: NDArray[np.int64]
    places: NDArray[np.float64]
    weights: NDArray[np.float64]
    sigmas: NDArray[np.float64]
    heels: NDArray[np.float64] = _NO_HEELS


NO_PROPOSALS = Proposals(np.zeros(0, np.int64), np.zeros((2, 0, 3)), np.zeros((2, 0)), np.zeros((2, 0, 2)))
"""Empty proposals."""


class FitTarget(NamedTuple):
    """Data that a body is fitted to, prepared once for all fits of a frame.

    Attributes
    ----------
    points : (N, 3) float64
        The person's points in the camera frame, metres, in an order in which every third one
        still shows all of the person.
    full, coarse : Observation
        The same frame on the full grid, for free space, and on a coarse one, for visibility.
    nearest : (h, w, 2) int32
        Row and column of the nearest person pixel to every pixel of ``full``.
    proposals : Proposals
    floor : (4,) float64
        The floor's normal, upward, and the sensor's height above it, metres; 0 where it is unknown.
    """

    points: NDArray[np.float64]
    full: Observation
    coarse: Observation
    nearest: NDArray[np.int32]
    proposals: Proposals
    floor: NDArray[np.float64]


def name_proposals(found: FoundPerson) -> Proposals:
    """Return a person's proposed joints under both namings of left and right."""
    if len(found.proposals) != len(JOINTS):
        return NO_PROPOSALS
    both = (np.arange(len(JOINTS)), MIRROR_JOINTS)
    places, weights, sigmas = (
        np.stack([values[names] for names in both]).astype(np.float64)
        for values in (found.proposals, found.proposal_confidence, found.proposal_sigma)
    )
    heels = np.stack([found.heels, found.heels[::-1]]).astype(np.float64)
    return Proposals(np.asarray(JOINT_NODES, np.int64), places, weights, sigmas, heels)


def nearest_person_pixels(observation: Observation) -> NDArray[np.int32]:
    """Find row and column of the nearest person pixel for every pixel, shape (h, w, 2)."""
    nearest = np.empty((*observation.labels.shape, 2), np.int32)
    kernels.nearest_person(observation.labels, nearest)
    return nearest
