r"""Confidence of skeletons and joints, and the visibility state of each joint.

A joint's confidence is the probability that it lies within 10 cm of the true position. Its log-odds are a sum
of a term for the kind of joint, terms for the observations at the joint and along the limb segment that ends
there, terms for the distance from the joint proposed by the joint net (`SIGNS`), and one for the
fit's rendered-depth score,

.. math:: \log\frac{p_j}{1 - p_j} = k_j + \sum_i w_i\, s_{ij} + w\, \mathrm{score}

``benchmarks/accuracy.py confidence`` fits the coefficients to simulated people and checks them on recordings
that are not used in the fit (docs/accuracy.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.odds import logistic, logit
from depth_pose.core.rotations import lengths_of
from depth_pose.core.skeleton import JOINT_INDEX, JOINTS, JointState
from depth_pose.recover import _confidence_kernels as kernels
from depth_pose.track.person_view import PersonView

_HALF_SURE_SCORE = 0.45
"""Rendered-depth score at which a fit is right with probability one half."""

_SCORE_SPREAD = 0.06
"""Scale of the logistic fall with the score: 0.27 at this much above; set by hand."""

_DEPTH_BEHIND_SURFACE = {"wrist": 0.03, "foot": 0.03, "ankle": 0.04, "elbow": 0.05, "knee": 0.06}
"""Depth of each kind of joint below the skin (m); 0.11 for the others."""

_HIDDEN_BEHIND = 0.07
"""A joint is hidden if the observed surface lies nearer than expected by more than this (m)."""

_TOWARD = {
    "pelvis": "spine", "spine": "pelvis", "chest": "spine", "neck": "chest", "head": "neck",
    "shoulder": "neck", "elbow": "shoulder", "wrist": "elbow",
    "hip": "pelvis", "knee": "hip", "ankle": "knee", "foot": "ankle",
}  # fmt: skip
"""Other end of the segment that is examined for each kind of joint."""

SIGNS = {
    "hidden": -0.01,
    "outside": -1.40,
    "in free space": 0.57,
    "before the surface": 0.09,
    "behind the surface": 0.10,
    "segment in free space": -3.22,
    "segment hidden": -2.18,
    "segment off the surface": -2.33,
    "hidden behind oneself": 0.07,
    "outside, the other end seen": 0.92,
    "away from the proposal": -3.95,
    "sure of the proposal": 1.24,
}
"""Log-odds of the observations. Hidden, in free space, hidden by the person's own body, outside next to a
visible joint: 0 or 1. Outside: distance beyond the image border in units of 7 cm, at most 2. Before or
behind: distance of the joint from its expected place under the surface, in those units, at most 2. Of the
segment: shares in free space and hidden, and mean distance of the rest. Of the proposal: the log-odds of its
confidence, and that confidence, 0 to 1, times the joint's distance from it in units of 10 cm, at most 4. The
net's own confidence counts most: a limb that is fitted where another surface lies, because its own returned
no depth, agrees with the depth image."""

_APART_UNIT_M, _MOST_APART = 0.1, 4.0
"""Unit (m) and maximum, in that unit, of the distance from the proposal in `SIGNS`."""

_UNMEASURED = -0.8
"""Log-odds of the proposal for a joint that was not measured; set by hand."""

KINDS = {
    "pelvis": 6.01,
    "spine": 5.86,
    "chest": 6.02,
    "neck": 6.33,
    "head": 6.32,
    "shoulder": 5.69,
    "elbow": 5.23,
    "wrist": 4.76,
    "hip": 5.76,
    "knee": 5.69,
    "ankle": 5.55,
    "foot": 5.69,
}
"""Log-odds of each kind of joint."""

SCORE = -5.11
"""Log-odds of the fit's rendered-depth score."""

BESIDE = 0.45
"""Maximum confidence of a joint beyond the left or right border; `SIGNS` are not fitted to such people."""

SKELETON_SIGNS = {
    "always": -1.90,
    "log-odds of being a person": 0.66,
    "log-odds of the joints' mean confidence": 1.11,
    "metres from the finder's joints": -0.56,
}
"""Log-odds of a skeleton by its evidence, fitted to people in simulated homes and before walls; that of being
a person, in rooms, by ``benchmarks/accuracy.py confidence --rooms``. The distance from the proposals is
weighted by their confidence; the rendered-depth score enters through the joints' confidence."""

_SEEN = int(JointState.SEEN)
_LEAST_SEEN = 4
"""With fewer visible joints, a skeleton's confidence covers all joints."""

_FAR_APART_M = 0.5
"""Maximum distance (m) of a joint from its proposal that counts; set by hand."""
_LEAST_CHANCE = 0.01
"""Probabilities are clipped to this and its complement, so that log-odds are finite; set by hand."""
_SKELETON_ODDS = np.array(list(SKELETON_SIGNS.values()))

_KIND = [name.split("_")[-1] for name in JOINTS]
"""Kind of each joint: its name without the side."""
_BELOW = np.array([_DEPTH_BEHIND_SURFACE.get(kind, 0.11) for kind in _KIND])
"""Depth of each joint below the skin, (19,), metres on the 1.75 m body."""
_OTHER_END = np.array(
    [
        JOINT_INDEX.get(name.replace(kind, _TOWARD[kind]), JOINT_INDEX.get(_TOWARD[kind], 0))
        for name, kind in zip(JOINTS, _KIND, strict=True)
    ]
)
"""Joint at the other end of each joint's bone, by `_TOWARD`, (19,)."""
_SHARES = np.arange(6) / 6
"""Points that are looked at along a segment, as shares of its length; the first is the joint."""
_BELOW_ALONG = _BELOW[:, None] + _SHARES * (_BELOW[_OTHER_END] - _BELOW)[:, None]
"""Depths of those points below the skin, (19, 6), metres on the 1.75 m body."""
_KIND_ODDS = np.array([KINDS[kind] for kind in _KIND])
_SIGN_ODDS = np.array(list(SIGNS.values()))
_AWAY = list(SIGNS).index("away from the proposal")


@dataclass(frozen=True)
class JointSigns:
    """Visibility of each joint: states (19,) uint8, and the values of `SIGNS`, (19, 12)."""

    states: NDArray[np.uint8]
    signs: NDArray[np.float64]


@dataclass(frozen=True)
class JointReport:
    """Visibility states (19,) uint8, and confidences (19,), the probability of an error below 10 cm."""

    states: NDArray[np.uint8]
    confidence: NDArray[np.float64]


def fit_confidence(score: float) -> float:
    """Compute the confidence, 0 to 1, of a fit from its rendered-depth score; it falls with the score.

    It ignores clutter; `skeleton_confidence` takes it into account.
    """
    return float(logistic((_HALF_SURE_SCORE - score) / _SCORE_SPREAD))


def skeleton_signs(
    person: PersonView,
    joints: NDArray[np.float64],
    states: NDArray[np.uint8],
    joint_confidence: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Compute the evidence for the confidence of a skeleton, (4,): `SKELETON_SIGNS`."""
    measured, seen, gap = person.measured, joints_that_count(states), 0.0
    if measured is not None:
        trust = seen * measured.confidence.astype(np.float64)
        apart = lengths_of(joints - measured.places)
        gap = float(np.minimum(apart, _FAR_APART_M) @ trust / max(float(trust.sum()), 1e-6))
    mean = float(joint_confidence[seen].mean())
    return np.array([1.0, logit(person.found.probability, _LEAST_CHANCE), logit(mean, _LEAST_CHANCE), gap])


def joints_that_count(states: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return which joints (19,) a skeleton's confidence covers: visible ones, or all if few are visible."""
    seen = states == _SEEN
    return seen if seen.sum() >= _LEAST_SEEN else np.ones_like(seen)


def skeleton_confidence(
    person: PersonView,
    joints: NDArray[np.float64],
    states: NDArray[np.uint8],
    joint_confidence: NDArray[np.float64],
) -> float:
    """Compute the probability that this is a person and that the joints are within 10 cm on average.

    Parameters
    ----------
    person : PersonView
    joints : (19, 3) float64
        Camera frame, metres.
    states : (19,) uint8
        `depth_pose.core.skeleton.JointState` values.
    joint_confidence : (19,) float64
    """
    odds = float(skeleton_signs(person, joints, states, joint_confidence) @ _SKELETON_ODDS)
    return float(logistic(odds))


def measure_joint_signs(positions: NDArray[np.float64], scale: float, person: PersonView) -> JointSigns:
    """Compare joints with the observed depth where they and the limb segments project.

    Parameters
    ----------
    positions : (19, 3) float64
        Camera frame, metres.
    scale : float
    person : PersonView

    Returns
    -------
    JointSigns
        SEEN where the surface lies as far in front of the joint as it should; OCCLUDED where it
        lies nearer, or where nothing is known; OUTSIDE_IMAGE beyond the image's border.
    """
    states, signs = np.empty(len(JOINTS), np.uint8), np.empty((len(JOINTS), len(SIGNS)))
    signs[:, -2:] = _proposal_signs(positions, person.measured)
    along = positions[:, None] + _SHARES[:, None] * (positions[_OTHER_END] - positions)[:, None]
    pixels, expected = person.camera.project(along), along[..., 2] - scale * _BELOW_ALONG
    kernels.measure_joint_signs(
        pixels,
        positions[:, 2],
        expected,
        _OTHER_END,
        _HIDDEN_BEHIND,
        person.camera,
        person.full,
        states,
        signs,
    )
    return JointSigns(states, signs)


def _proposal_signs(positions: NDArray[np.float64], measured: JointMeasurement | None) -> NDArray[np.float64]:
    """Compute the distances of joints (19, 3) from the measured ones, and their log-odds, (19, 2)."""
    if measured is None:
        return np.tile([0.0, _UNMEASURED], (len(positions), 1))
    sure = measured.confidence.astype(np.float64)
    apart = lengths_of(positions - measured.places) / _APART_UNIT_M
    chance = np.minimum(np.maximum(sure, _LEAST_CHANCE), 1.0 - _LEAST_CHANCE)
    signs = np.empty((len(positions), 2))
    signs[:, 0], signs[:, 1] = np.minimum(apart, _MOST_APART) * sure, np.log(chance / (1.0 - chance))
    return signs


def report_joints(
    positions: NDArray[np.float64],
    scale: float,
    person: PersonView,
    score: float,
    *,
    is_compared: bool = True,
) -> JointReport:
    """Compute the visibility state and the confidence of each joint.

    Parameters
    ----------
    positions : (19, 3) float64
        Camera frame, metres.
    scale : float
    person : PersonView
    score : float
        Rendered-depth score of the fit.
    is_compared : bool
        Whether the distance from the measured joints counts; not before both are fused.
    """
    seen = measure_joint_signs(positions, scale, person)
    if not is_compared:
        seen.signs[:, _AWAY] = 0.0
    odds = _KIND_ODDS + seen.signs @ _SIGN_ODDS + SCORE * score
    confidence = logistic(odds)
    column = person.camera.fx * positions[:, 0] / positions[:, 2] + person.camera.cx
    beside = np.abs(column - 0.5 * (person.camera.width - 1)) > 0.5 * person.camera.width
    confidence[beside] = np.minimum(confidence[beside], BESIDE)
    return JointReport(seen.states, confidence)
