"""How sure a skeleton and each of its joints are, and how each joint was seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.skeleton import JOINTS, JointState
from depth_pose.steps.view import PersonView
from depth_pose.types import BACKGROUND, PERSON

_HALF_SURE_SCORE = 0.45
"""Rendered-depth score at which a fit is as likely right as wrong."""

_SCORE_SPREAD = 0.06

_DEPTH_BEHIND_SURFACE = {"wrist": 0.03, "foot": 0.03, "ankle": 0.04, "elbow": 0.05, "knee": 0.06}
"""How far below the skin a joint's centre lies, metres; 0.11 for those not named."""

_HIDDEN_BEHIND = 0.07
"""A joint is hidden if the surface seen there lies this much nearer than its own should, metres."""


@dataclass(frozen=True)
class JointReport:
    """How each joint was seen: states (19,) uint8, and certainty (19,) from 0 to 1."""

    states: NDArray[np.uint8]
    certainty: NDArray[np.float64]


def skeleton_confidence(score: float) -> float:
    """Confidence, 0 to 1, of a fit with a rendered-depth score; falls with the score."""
    return float(1.0 / (1.0 + np.exp((score - _HALF_SURE_SCORE) / _SCORE_SPREAD)))


def score_of(confidence: float) -> float:
    """Rendered-depth score that a confidence stands for, the inverse of `skeleton_confidence`."""
    bounded = min(max(confidence, 1e-7), 1.0 - 1e-7)
    return float(_HALF_SURE_SCORE + _SCORE_SPREAD * np.log(1.0 / bounded - 1.0))


def report_joints(positions: NDArray[np.float64], scale: float, view: PersonView) -> JointReport:
    """Compare joints with the depth seen where they project.

    Parameters
    ----------
    positions : (19, 3) float64
        Camera frame, metres.
    scale : float
    view : PersonView

    Returns
    -------
    JointReport
        SEEN where the surface lies as far in front of the joint as it should; OCCLUDED where it
        lies nearer, or where nothing is known; OUTSIDE_IMAGE beyond the image's border.
    """
    states = np.full(len(JOINTS), JointState.SEEN, np.uint8)
    certainty = np.ones(len(JOINTS))
    camera, window = view.camera, view.full
    for j, (x, y, z) in enumerate(positions):
        u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
        if not (-0.5 <= u < camera.width - 0.5 and -0.5 <= v < camera.height - 0.5):
            states[j], certainty[j] = JointState.OUTSIDE_IMAGE, 0.3
            continue
        a = round(window.camera.fy * y / z + window.camera.cy)
        b = round(window.camera.fx * x / z + window.camera.cx)
        inside = 0 <= a < window.depth.shape[0] and 0 <= b < window.depth.shape[1]
        label = window.labels[a, b] if inside else BACKGROUND
        if label == BACKGROUND:
            certainty[j] = 0.5
        elif label == PERSON:
            below = scale * _DEPTH_BEHIND_SURFACE.get(JOINTS[j].split("_")[-1], 0.11)
            gap = z - below - float(window.depth[a, b])
            if gap > _HIDDEN_BEHIND:
                states[j], certainty[j] = JointState.OCCLUDED, 0.6
            elif gap < -_HIDDEN_BEHIND:
                certainty[j] = 0.5
        else:
            states[j], certainty[j] = JointState.OCCLUDED, 0.6
    return JointReport(states, certainty)
