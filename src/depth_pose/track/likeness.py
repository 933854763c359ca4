r"""Likelihood of a detection given a track, as a log-likelihood ratio in nats.

Detection k is either track i, a newcomer, or an object. With the gap :math:`\Delta t` since the track was
last seen and the time :math:`\delta` since the last frame, the gain of pairing both is

.. math::

    g_{ik} = \log \frac{P_i}{1 - P_i}
             + \log \frac{f(x_k \mid i, \Delta t)}{\nu \delta + \kappa (1 - p_k) / p_k}
             + \log \frac{f(s_k \mid i)}{f(s_k)} + \log \frac{f(q_k \mid i, \Delta t)}{f(q_k)}

- :math:`P_i`: probability that the track is detected in this frame (`seen_odds`);
- :math:`f(x \mid i, \Delta t)`: density of its place, 1/m^2 (`place_density`), over the density of newcomers
  and, for a detection of person probability :math:`p_k`, of objects;
- :math:`s`: logarithm of the body size, relative to the population (`size_gain`);
- :math:`q`: joints about their centre, relative to those of any person (`pose_gain`); fades with the gap.

The best assignment has the largest sum of gains; pairs with negative gain are not made.

Constants that say "swept" were set by hand, then halved and doubled (``benchmarks/accuracy.py tracks``). The
mixture of hidden people who stay and who wander changes nothing in rooms with crossings, but without it ids
in a corridor change six times instead of once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.measurement import TYPICAL_ERROR_M
from depth_pose.core.rotations import lengths_of
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES, rest_nodes
from depth_pose.detect.segmentation import Detection

_MISSED, _HIDES_S = 0.03, 4.0
"""Probability of missing a person in view in a frame, and mean time for which people stay in view (s);
swept."""

_UNPROVEN = -4.0
"""Log-odds (nats) that an unconfirmed track is not a fragment of another person; swept."""

_RETURN_S = 0.3
"""A person hidden for a time t returns at a rate of 1 / (t + this), seconds; swept."""

_NEWCOMERS = 0.002
"""Rate of newcomers, 1/(m^2 s): one in 30 s on 15 m^2; swept."""

_THINGS = 0.005
"""Density of objects per frame at a person probability of one half, 1/m^2; swept."""

_ONE_BODY_M = 0.3
"""Least distance of two torsos (m); swept."""

_STILL_M = 0.45
"""Movement of a torso's place (m) from frame to frame when parts of the person appear or vanish."""

_SPEED_M_S = 5.0
"""Maximum speed of people indoors (m/s)."""

_HEIGHT_SHARE = 0.5
"""Weight of movement along the image columns: a torso's height varies when legs are hidden, but under a
ceiling camera this direction lies in the floor."""

_PLACE_M, _PLACE_SHARE, _PLACE_M_S = 0.06, 0.02, 1.0
"""Spread of a place (m), its share of the distance, and its growth for walking people (m/s); measured in
simulated rooms."""

_JUMPS = 0.02
"""Share of places anywhere within reach, for people who come into view or wrong stamps; swept."""

_STAY_M, _WANDER_M_S, _WANDER_M = 0.3, 1.0, 2.5
"""Spread of the place of a hidden person who stays (m), its growth for one who wanders (m/s), and its
maximum (m); swept."""

_STOP_SHARE, _STOP_S = 0.5, 1.0
"""Share of hidden people who stop walking, and the time constant (s); half of them stay, half wander;
swept."""

_COASTING_S = 0.7
"""Time after which a hidden person is no longer expected to walk on (s)."""

_POPULATION = (math.log(1.65), 0.15)
"""Mean and standard deviation of the logarithm of stature (m), children among them."""

_BUILD_SD = 0.03
"""Least standard deviation of the logarithm of size, for any number of observations; swept."""

_CORRELATED_S = 0.2
"""Observations closer in time than this (s) have correlated size errors; swept."""

_WORST_SIZE = -10.0
"""Least gain from size (nats): the size in a single frame may be entirely wrong."""

_POSE_M, _POSE_M_S, _ANY_POSE_M = 0.02, 0.28, 0.17
"""Spread of the joints about their centre between frames (m), its growth (m/s), and the spread between two
people (m); measured in simulated rooms."""

_ODD_POSES = 0.05
"""Share of poses that do not continue the last one, as when left and right are exchanged; swept."""

_LEAST_CONFIDENCE = 1e-3
"""Lower bound of confidences: an error of 3 m."""

_LIMBS = (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"))
_BONES = np.array(
    [
        (JOINT_INDEX[a], JOINT_INDEX[b])
        for a, b in (
            ("pelvis", "neck"),
            ("neck", "head"),
            ("left_shoulder", "right_shoulder"),
            ("left_hip", "right_hip"),
            *((f"{side}_{a}", f"{side}_{b}") for side in ("left", "right") for a, b in _LIMBS),
        )
    ]
).T
"""Joints at both ends of each bone used for the size."""


def _lengths(joints: NDArray[np.floating]) -> NDArray[np.float64]:
    return np.asarray(lengths_of(joints[_BONES[1]] - joints[_BONES[0]]), np.float64)


_FRACTIONS = _lengths(rest_nodes()[JOINT_NODES])
"""Length of each bone as a fraction of stature."""


@dataclass(frozen=True)
class Size:
    """Logarithm of a body size (stature of a person of average proportions, m), with its variance."""

    log_m: float
    variance: float

    def merged(self, seen: Size, seconds: float) -> Size:
        """Return the estimate after one more observation, ``seconds`` after the last one."""
        doubt = seen.variance * max(1.0, _CORRELATED_S / max(seconds, 1e-3))
        share = self.variance / (self.variance + doubt)
        variance = max((1.0 - share) * self.variance, _BUILD_SD**2)
        return Size(self.log_m + share * (seen.log_m - self.log_m), variance)


@dataclass(frozen=True)
class Traits:
    """Traits that identify a person in one frame.

    Attributes
    ----------
    place : (3,) float64
        Centre of the torso, camera frame (m).
    size : Size or None
        None without proposed joints.
    joints : (19, 3) float64
        Measured joints, camera frame (m); no rows without.
    variance : (19,) float64
        Their squared expected errors (m^2).
    """

    place: NDArray[np.float64]
    size: Size | None
    joints: NDArray[np.float64]
    variance: NDArray[np.float64]


def traits_of(detection: Detection) -> Traits:
    """Compute the identifying traits of a detection.

    The size is the least-squares scale of the average skeleton's bones to the proposed ones, each weighted by
    the errors of its two ends; a third of a joint's squared error lies along the bone.
    """
    measured = detection.measured
    if measured is None:
        return Traits(detection.place, None, np.zeros((0, 3)), np.zeros(0))
    joints = measured.places.astype(np.float64)
    confidence = np.maximum(measured.confidence.astype(np.float64), _LEAST_CONFIDENCE)
    variance = TYPICAL_ERROR_M**2 * (1.0 / confidence - 1.0)
    weight = _FRACTIONS / ((variance[_BONES[0]] + variance[_BONES[1]]) / 3.0 + 1e-6)
    total = float(weight @ _FRACTIONS)
    stature = max(float(weight @ _lengths(joints)) / total, 1e-2)
    size = Size(math.log(stature), 1.0 / (total * stature**2) + _BUILD_SD**2)
    return Traits(detection.place, size, joints, variance)


def fragments(everybody: Sequence[Traits]) -> set[int]:
    """Return the indices of detections that show a part of another person.

    Of two detections at one place it is the one with less certain joints.
    """
    known = [n for n, traits in enumerate(everybody) if traits.size is not None]
    return {
        max(pair, key=lambda n: float(everybody[n].variance.sum()))
        for pair in combinations(known, 2)
        if _distance(everybody[pair[0]].place - everybody[pair[1]].place) < _ONE_BODY_M
    }


def seen_odds(gap_s: float, frame_s: float, is_proven: bool) -> float:
    """Compute the log-odds that a person is detected in this frame.

    Parameters
    ----------
    gap_s : float
        Time since the person was seen (s).
    frame_s : float
        Time since the last frame (s); if the gap is no longer, the person was seen in the last frame.
    is_proven : bool
        Whether the track is believed to be a person.
    """
    if not is_proven:
        return _UNPROVEN + seen_odds(gap_s, frame_s, is_proven=True)
    if gap_s <= frame_s:
        lost = _MISSED + -math.expm1(-frame_s / _HIDES_S)
        return math.log((1.0 - lost) / lost)
    returns = frame_s / (_RETURN_S + gap_s - frame_s)
    return math.log(math.expm1(max(returns, 1e-6)))  # the odds of 1 - exp(-returns)


def new_density(probability: float, frame_s: float) -> float:
    """Compute the density (1/m^2) of newcomers and objects for a detection of this person probability."""
    p = min(max(probability, 1e-4), 1.0)
    return _NEWCOMERS * max(frame_s, 1e-3) + _THINGS * (1.0 - p) / p


def place_density(
    was: NDArray[np.float64], velocity: NDArray[np.float64], now: NDArray[np.float64], gap_s: float
) -> float:
    """Compute the density (1/m^2) of a person's place after a gap; 0 beyond the maximum reach.

    A mixture of people who walk on with the last velocity, stay, turn elsewhere, or are anywhere within
    reach.
    """
    away, reach = _distance(now - was), _STILL_M + _SPEED_M_S * gap_s
    if away > reach:
        return 0.0
    still = math.hypot(_PLACE_M, _PLACE_SHARE * float(now[2]))
    off = _distance(now - was - velocity * min(gap_s, _COASTING_S))
    stops = _STOP_SHARE * -math.expm1(-gap_s / _STOP_S)
    walks_on = (1.0 - stops) * _normal(off, min(math.hypot(still, _PLACE_M_S * gap_s), _WANDER_M))
    wander = min(math.hypot(still, _WANDER_M_S * gap_s), _WANDER_M)
    stays_near = 0.5 * stops * (_normal(away, min(wander, _STAY_M)) + _normal(away, wander))
    return (1.0 - _JUMPS) * (walks_on + stays_near) + _JUMPS / (math.pi * reach**2)


def size_gain(track: Size | None, seen: Size | None) -> float:
    """Compute the log-likelihood ratio of a size: this person against the population (nats)."""
    if track is None or seen is None:
        return 0.0
    mean, sd = _POPULATION
    own = _log_normal(seen.log_m - track.log_m, track.variance + seen.variance)
    return max(own - _log_normal(seen.log_m - mean, sd**2 + seen.variance), _WORST_SIZE)


def pose_gain(track: Traits, seen: Traits, gap_s: float) -> float:
    """Compute the log-likelihood ratio of a pose: this person after the gap against any person (nats)."""
    spread = math.hypot(_POSE_M, _POSE_M_S * gap_s)
    if spread >= _ANY_POSE_M or track.size is None or seen.size is None:
        return 0.0
    weight = 1.0 / (track.variance + seen.variance + TYPICAL_ERROR_M**2)
    weight /= weight.sum()
    way = seen.joints - track.joints
    way -= weight @ way
    apart = math.sqrt(float(weight @ (way * way).sum(axis=1)))
    ratio = _normal(apart, spread) / _normal(apart, _ANY_POSE_M)
    return math.log((1.0 - _ODD_POSES) * ratio + _ODD_POSES)


def _distance(way: NDArray[np.float64]) -> float:
    x, y, z = way.tolist()
    return math.sqrt(x * x + (_HEIGHT_SHARE * y) ** 2 + z * z)


def _normal(distance: float, spread: float) -> float:
    """Compute the density of a two-dimensional normal distribution at a distance from its mean."""
    return math.exp(-0.5 * (distance / spread) ** 2) / (2.0 * math.pi * spread**2)


def _log_normal(difference: float, variance: float) -> float:
    return -0.5 * (difference**2 / variance + math.log(variance))
