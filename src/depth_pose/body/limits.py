"""Joint limits: anatomical ranges, clamping, violation, and the shoulder's rhythm.

The ranges are those of healthy adults, rounded between these sources and widened to the more
generous where they differ, because forbidding a real posture costs more than allowing an impossible one:

* American Academy of Orthopaedic Surgeons, *Joint Motion: Method of Measuring and Recording*,
  1965 (spine, shoulder, elbow, forearm, hip, knee, ankle);
* D. C. Boone and S. P. Azen, *Normal range of motion of joints in male subjects*, J. Bone Joint
  Surg. 61-A, 1979 (limbs);
* NASA-STD-3000, *Man-Systems Integration Standards*, vol. I, section 3.3.2 (joint motion);
* I. A. Kapandji, *The Physiology of the Joints* (how a movement divides among the spine's parts,
  clavicle).

Shoulder and hip are limited in direction by a cone, a quarter of an ellipse in each quadrant of
(flexion, abduction). The range of the upper arm's axial rotation moves with its direction
(X. Wang et al., *Three-dimensional modelling of the motion range of axial rotation of the upper
arm*, J. Biomech. 31, 1998); here linearly between the ranges measured with the arm hanging,
forward and aside.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.body._limits_table import RANGES
from depth_pose.body.angles import ARM, LEG, angles_from_rotations, rotations_from_angles

Array = NDArray[np.float64]

LOW: Array = np.array([low for low, _ in RANGES])
"""Smallest value of every angle, degrees, shape (47,)."""
HIGH: Array = np.array([high for _, high in RANGES])
"""Largest value of every angle, degrees, shape (47,)."""

RHYTHM_SETTING_DEG = 30.0
"""Elevation of the arm below which the shoulder girdle need not take part (Inman's setting phase)."""


OVERHEAD_DEG = 155.0
"""Elevation from which an arm points up whatever its plane is.

Forward, sideward and backward meet there, and so do very different pairs of (flexion, abduction)
and twist; limits on these would forbid an arm slightly behind the ear.
"""


def clamp_angles(angles: Array) -> Array:
    """Clip anatomical angles to the joint limits.

    Parameters
    ----------
    angles : (..., 47)
        Degrees, in the order of `depth_pose.body.angles.ANGLES`.

    Returns
    -------
    (..., 47) float64
        The nearest allowed angles, taken joint by joint; allowed ones are returned unchanged.
    """
    out = np.clip(angles, LOW, HIGH)
    for leg in LEG:
        pair = slice(leg.start, leg.start + 2)
        out[..., pair] = _into_cone(out[..., pair], LOW[pair], HIGH[pair])
    for arm in ARM:
        pair, twist = slice(arm.start + 2, arm.start + 4), arm.start + 4
        swing = angles[..., pair]
        elevation = np.linalg.norm(swing, axis=-1, keepdims=True)
        cone = _into_cone(out[..., pair], LOW[pair], HIGH[pair])
        overhead = elevation > OVERHEAD_DEG
        swing = np.where(overhead, swing * np.minimum(1.0, 180.0 / np.maximum(elevation, 1.0)), cone)
        out[..., pair] = swing
        low, high = shoulder_twist_range(swing[..., 0], swing[..., 1])
        out[..., twist] = np.where(overhead[..., 0], angles[..., twist], np.clip(out[..., twist], low, high))
    return out


def _into_cone(swing: Array, low: Array, high: Array) -> Array:
    reach = np.where(swing >= 0, high, -low)
    size = np.linalg.norm(swing / reach, axis=-1, keepdims=True)
    return np.asarray(swing / np.maximum(size, 1.0))


def shoulder_twist_range(flexion: Array, abduction: Array) -> tuple[Array, Array]:
    """Range of the upper arm's internal twist for its direction.

    External/internal: 60 and 95 degrees with the arm hanging, 90 and 75 with it aside at the
    height of the shoulder, 40 and 145 with it forward, all against the swing's own zero.

    Parameters
    ----------
    flexion, abduction : (...)
        Swing of the upper arm, degrees.

    Returns
    -------
    low, high : (...)
        Degrees, internal positive.
    """
    forward, aside = np.clip(flexion / 90.0, 0, 1), np.clip(abduction / 90.0, 0, 1)
    return -60.0 - 30.0 * aside + 20.0 * forward, 95.0 - 20.0 * aside + 50.0 * forward


def violation(angles: Array) -> Array:
    """How far each angle lies outside its limits, degrees, shape of the input (0 inside)."""
    return np.abs(angles - clamp_angles(angles))


def clamp_rotations(rotations: Array) -> Array:
    """Clip segment rotations to the joint limits, (..., 21, 3, 3) to (..., 21, 3, 3)."""
    return rotations_from_angles(clamp_angles(angles_from_rotations(rotations)))


def with_shoulder_rhythm(angles: Array) -> Array:
    """Make the shoulder girdles follow the arms.

    Of the arm's elevation beyond 30 degrees one third is the scapula's and two thirds the
    shoulder joint's (V. T. Inman, J. B. Saunders, L. C. Abbott, *Observations on the function of
    the shoulder joint*, J. Bone Joint Surg. 26, 1944). The clavicle, which carries the shoulder
    here, rises by about half of the scapula's turn, comes forward as the arm reaches across the
    body and goes back as it goes behind (P. M. Ludewig et al., *Motion of the shoulder complex
    during multiplanar humeral elevation*, J. Bone Joint Surg. 91-A, 2009).

    Parameters
    ----------
    angles : (..., 47)
        Degrees; the clavicles' values are what is added to the rhythm (a shrug).

    Returns
    -------
    (..., 47) float64
        The same with complete clavicle angles.
    """
    out = np.array(angles, dtype=np.float64)
    for arm in ARM:
        flexion, abduction = out[..., arm.start + 2], out[..., arm.start + 3]
        elevation = np.hypot(flexion, abduction)
        out[..., arm.start] += np.maximum(elevation - RHYTHM_SETTING_DEG, 0.0) / 3.0 / 2.0
        across = np.clip(flexion, -60, 90) / 90.0 - 0.6 * np.clip(abduction, -60, 90) / 90.0
        out[..., arm.start + 1] += 12.0 * across * np.clip(2.0 - elevation / 90.0, 0.0, 1.0)
    return out
