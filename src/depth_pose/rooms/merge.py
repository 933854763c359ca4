r"""One skeleton of a person from the skeletons of several cameras, by their covariances.

Each joint of each camera is a Gaussian. Its size comes from the joint's confidence, the probability
:math:`p` of an error below 10 cm: with equal spread :math:`\sigma` in all directions,

.. math:: p = \operatorname{erf}(x / \sqrt{2}) - \sqrt{2 / \pi}\, x\, e^{-x^2 / 2}, \qquad x = 0.1 / \sigma.

It is longer along the camera's ray than across. The merged joint is the mode of the product of Student's t
densities (iteratively reweighted least squares), so that a camera far from the others has no influence.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.result import BUILD_SIZE, Skeleton
from depth_pose.core.skeleton import JointState, Source

Array = NDArray[np.float64]

WITHIN_M = 0.1
"""A joint's confidence is the probability of an error below this (m)."""

_ALONG, _ACROSS = 1.26, 0.84
"""Spread along a camera's ray and across it, in units of the mean spread: 1.5 to 1; set by hand."""

_WEAKER = np.array([1.0, 1.2, 1.5, 4.0])
"""Factor on the spread of joints by `JointState`; set by hand."""

_AGING_M_S = 0.5
"""Growth of the spread with the age of a sighting (m/s), beyond the person's velocity; set by hand."""

_SHARED_M = 0.02
"""Spread of the errors that all cameras have in common (m); set by hand."""

_FREEDOM = 6.0
"""Degrees of freedom of Student's t; set by hand."""

_STEPS = 4
"""Steps of the reweighting; set by hand."""

_LEAST_SHARE = 0.2
"""Minimum weight, as a share of the largest, of a camera that decides a joint's state."""

_DOUBT_LEFT = 0.3
"""Minimum share of the best camera's doubt that remains in the merged confidence; set by hand."""

_RATIOS: Array = np.linspace(0.0, 6.0, 601)
_CHANCES: Array = np.array(
    [
        math.erf(x / math.sqrt(2.0)) - math.sqrt(2.0 / math.pi) * x * math.exp(-0.5 * x * x)
        for x in _RATIOS.tolist()
    ]
)
"""Compute the probability that a joint is within `WITHIN_M`, from the ratio of that to the spread."""

_CERTAIN = 0.998
"""Confidences are clipped to this and its complement before they become spreads; set by hand."""


@dataclass(frozen=True, eq=False)
class PlacedSkeleton:
    """A skeleton of one camera, in the room's frame.

    Attributes
    ----------
    skeleton : Skeleton
        Room frame; not lost.
    eye : (3,) float64
        The camera's position in the room, metres.
    offset : (3,) float64
        The person's displacement from the skeleton's stamp to the common one, metres.
    age_s : float
        Time between the two stamps, seconds.
    """

    skeleton: Skeleton
    eye: Array
    offset: Array
    age_s: float = 0.0


def place(skeleton: Skeleton, T_room_camera: Array, frame_id: str) -> Skeleton:
    """Return a skeleton of a camera's frame in the room's frame.

    Parameters
    ----------
    skeleton : Skeleton
    T_room_camera : (4, 4) float64
    frame_id : str
        Name of the room's frame.
    """
    if skeleton.is_lost:
        return replace(skeleton, frame_id=frame_id)
    return skeleton.turned(T_room_camera[:3, :3], T_room_camera[:3, 3], frame_id)


def spread_of(confidence: NDArray[np.floating]) -> Array:
    """Compute the spread of joints (m, per direction) from their confidences."""
    chance = np.clip(np.asarray(confidence, np.float64), 1.0 - _CERTAIN, _CERTAIN)
    return np.asarray(WITHIN_M / np.interp(chance, _CHANCES, _RATIOS))


def confidence_of(spread: Array) -> Array:
    """Compute the confidences of joints from their spreads (m)."""
    return np.asarray(np.interp(WITHIN_M / np.maximum(spread, 1e-3), _RATIOS, _CHANCES))


def merge_skeletons(seen: Sequence[PlacedSkeleton], body_id: str, stamp_ns: int, frame_id: str) -> Skeleton:
    """Merge the skeletons of one person.

    Parameters
    ----------
    seen : sequence of PlacedSkeleton
        By different cameras; at least one.
    body_id, stamp_ns, frame_id
        Of the result.
    """
    skeletons = [s.skeleton for s in seen]
    positions = np.array([s.skeleton.positions + s.offset for s in seen])
    information = np.array([_information(s) for s in seen])
    merged, weights = _modes(positions, information)
    states = np.array([s.joint_states for s in skeletons])
    confidence, covariances = _certainty(skeletons, positions, merged, information, weights)
    heard = weights >= _LEAST_SHARE * weights.max(axis=0)
    trust = np.array([max(s.confidence, 1e-3) for s in skeletons])
    best = skeletons[int(np.argmax(trust))]
    builds = [s.build for s in skeletons if len(s.build) == BUILD_SIZE]
    return Skeleton(
        stamp_ns=stamp_ns,
        frame_id=frame_id,
        body_id=body_id,
        source=Source.REFINED if any(s.source == Source.REFINED for s in skeletons) else best.source,
        confidence=best.confidence,
        residual=min(s.residual for s in skeletons),
        scale=float(trust @ [s.scale for s in skeletons] / trust.sum()),
        positions=merged,
        quats_xyzw=_mean_rotations(np.array([s.quats_xyzw for s in skeletons]), weights, information),
        joint_confidence=confidence,
        joint_states=np.where(heard, states, JointState.LOST).min(axis=0).astype(np.uint8),
        build=np.mean(builds, axis=0, dtype=np.float32) if builds else best.build,
        covariances=covariances,
    )


def _information(seen: PlacedSkeleton) -> Array:
    """Return the inverse covariances (19, 3, 3) of a camera's joints, 1/m^2."""
    skeleton = seen.skeleton
    spread = spread_of(skeleton.joint_confidence) * _WEAKER[skeleton.joint_states]
    spread = np.hypot(spread, _AGING_M_S * seen.age_s)
    spread = np.sqrt(np.maximum(spread**2 - _SHARED_M**2, _SHARED_M**2 / 4.0))
    rays = skeleton.positions - seen.eye
    rays = rays / np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-6)
    along = rays[:, :, None] * rays[:, None, :]
    shape = np.eye(3) / _ACROSS**2 + (1.0 / _ALONG**2 - 1.0 / _ACROSS**2) * along
    return np.asarray(shape / spread[:, None, None] ** 2)


def _modes(positions: Array, information: Array) -> tuple[Array, Array]:
    """Find the merged joints (19, 3) and the weights (N, 19) of the cameras.

    The iteration starts at the camera that agrees best with all; of two cameras, at the more confident one.
    """
    if len(positions) == 1:
        return positions[0], np.ones(positions.shape[:2])
    apart = positions[:, None] - positions[None]
    cost = np.log1p(_squares(apart, information[None]) / _FREEDOM).sum(axis=1)
    merged = np.take_along_axis(positions, cost.argmin(axis=0)[None, :, None], axis=0)[0]
    for _ in range(_STEPS):
        weights = (_FREEDOM + 3.0) / (_FREEDOM + _squares(positions - merged, information))
        weighted = weights[..., None, None] * information
        pull = np.einsum("njab,njb->ja", weighted, positions)
        merged = np.linalg.solve(weighted.sum(axis=0), pull[..., None])[..., 0]
    return merged, weights


def _squares(apart: Array, information: Array) -> Array:
    """Return squared Mahalanobis distances (...), of differences (..., 3)."""
    return np.asarray(np.einsum("...a,...ab,...b->...", apart, information, apart))


def _certainty(
    skeletons: Sequence[Skeleton], positions: Array, merged: Array, information: Array, weights: Array
) -> tuple[NDArray[np.float32], Array]:
    """Return the confidences (19,) and the covariances (19, 3, 3) of the merged joints.

    One camera keeps its own; several give those of the merged covariance, widened by their disagreement.
    """
    given = np.array([s.joint_confidence for s in skeletons], np.float64)
    if len(skeletons) == 1:
        return given[0].astype(np.float32), skeletons[0].covariances
    weights = np.minimum(weights, 1.0)
    covariance = np.linalg.inv((weights[..., None, None] * information).sum(axis=0))
    squares = (weights * _squares(positions - merged, information)).sum(axis=0)
    widened = np.maximum(1.0, squares / (3.0 * (len(skeletons) - 1)))
    variance = widened * np.trace(covariance, axis1=1, axis2=2) / 3.0
    most = 1.0 - _DOUBT_LEFT * (1.0 - given.max(axis=0))
    confidence = np.minimum(confidence_of(np.sqrt(variance + _SHARED_M**2)), most).astype(np.float32)
    return confidence, widened[:, None, None] * covariance + _SHARED_M**2 * np.eye(3)


def _mean_rotations(quats_xyzw: Array, weights: Array, information: Array) -> Array:
    """Return the weighted mean rotations (19, 4) of (N, 19, 4): the mean of Markley et al., 2007."""
    if len(quats_xyzw) == 1:
        return quats_xyzw[0]
    weights = weights * np.trace(information, axis1=2, axis2=3)
    summed = np.einsum("nj,nja,njb->jab", weights, quats_xyzw, quats_xyzw)
    return np.asarray(np.linalg.eigh(summed)[1][:, :, -1])
