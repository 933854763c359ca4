"""The embedded body's outer shape: cross-sections along the bones of a 1.75 m adult.

All lengths are metres. Breadths, depths and girths are those of an adult between the means of
the men and the women of the 2012 US Army survey, scaled to one stature (C. C. Gordon et al.,
*2012 Anthropometric survey of U.S. Army personnel*, NATICK/TR-15/007, 2014), rounded.
"""

from __future__ import annotations

import numpy as np

from depth_pose.body.surface import Array, Ellipsoid, Sweep, smooth_min
from depth_pose.skeleton import ADULT_STATURE_M, NODE_INDEX, rest_nodes

# Rows: height, half-breadth, front, back (both measured from z = 0), superellipse exponent.
_TRUNK = np.array(
    [
        (0.800, 0.120, 0.070, 0.075, 2.0),
        (0.850, 0.160, 0.090, 0.105, 2.2),
        (0.900, 0.174, 0.100, 0.118, 2.3),
        (0.950, 0.172, 0.108, 0.115, 2.3),
        (1.000, 0.163, 0.112, 0.103, 2.3),
        (1.050, 0.152, 0.110, 0.096, 2.3),
        (1.110, 0.146, 0.105, 0.096, 2.3),
        (1.180, 0.147, 0.106, 0.106, 2.3),
        (1.250, 0.154, 0.112, 0.120, 2.3),
        (1.310, 0.160, 0.112, 0.130, 2.3),
        (1.370, 0.158, 0.098, 0.133, 2.2),
        (1.420, 0.145, 0.076, 0.124, 2.1),
        (1.460, 0.115, 0.052, 0.108, 2.0),
        (1.500, 0.078, 0.032, 0.090, 2.0),
        (1.540, 0.060, 0.034, 0.078, 2.0),
    ]
)
_NECK = np.array(
    [
        (0.0, 0.064, 0.064, 0.062, 0.062),
        (0.5, 0.058, 0.058, 0.060, 0.058),
        (1.0, 0.056, 0.056, 0.060, 0.058),
    ]
)
# Rows: fraction of the bone, half-axes towards the inside, the outside, front, back, exponent.
_UPPER_ARM = np.array(
    [
        (-0.06, 0.048, 0.050, 0.052, 0.052, 2.0),
        (0.15, 0.048, 0.056, 0.056, 0.056, 2.0),
        (0.35, 0.045, 0.050, 0.054, 0.053, 2.0),
        (0.60, 0.043, 0.044, 0.051, 0.048, 2.0),
        (0.85, 0.042, 0.040, 0.042, 0.042, 2.0),
        (1.00, 0.043, 0.040, 0.041, 0.041, 2.0),
    ]
)
_FOREARM = np.array(
    [
        (0.00, 0.042, 0.040, 0.042, 0.041, 2.0),
        (0.20, 0.044, 0.040, 0.046, 0.043, 2.0),
        (0.45, 0.039, 0.036, 0.041, 0.040, 2.0),
        (0.75, 0.028, 0.027, 0.032, 0.032, 2.0),
        (1.00, 0.021, 0.021, 0.030, 0.030, 2.2),
    ]
)
_HAND = np.array(
    [
        (0.00, 0.021, 0.020, 0.030, 0.030, 2.2),
        (0.22, 0.020, 0.015, 0.040, 0.038, 2.4),
        (0.45, 0.017, 0.014, 0.044, 0.043, 2.6),
        (0.65, 0.014, 0.012, 0.041, 0.041, 2.6),
        (0.85, 0.011, 0.010, 0.034, 0.036, 2.6),
        (0.96, 0.008, 0.008, 0.022, 0.026, 2.4),
    ]
)
_THIGH = np.array(
    [
        (-0.16, 0.050, 0.040, 0.055, 0.055, 2.0),
        (-0.05, 0.075, 0.064, 0.080, 0.085, 2.0),
        (0.15, 0.085, 0.080, 0.092, 0.096, 2.1),
        (0.35, 0.080, 0.078, 0.090, 0.085, 2.1),
        (0.60, 0.068, 0.070, 0.078, 0.072, 2.1),
        (0.85, 0.056, 0.056, 0.062, 0.060, 2.1),
        (1.00, 0.053, 0.052, 0.056, 0.058, 2.1),
    ]
)
_SHANK = np.array(
    [
        (0.00, 0.053, 0.052, 0.056, 0.058, 2.1),
        (0.12, 0.052, 0.051, 0.050, 0.062, 2.1),
        (0.28, 0.054, 0.055, 0.047, 0.075, 2.0),
        (0.50, 0.045, 0.048, 0.042, 0.062, 2.0),
        (0.75, 0.034, 0.036, 0.036, 0.044, 2.0),
        (0.92, 0.033, 0.033, 0.036, 0.042, 2.0),
        (1.02, 0.036, 0.035, 0.040, 0.045, 2.0),
        (1.10, 0.030, 0.030, 0.036, 0.040, 2.0),
    ]
)
# Along the foot, heel to toes: half-axes outside, inside, up, down from an axis 0.03 above the floor.
_FOOT = np.array(
    [
        (0.03, 0.022, 0.022, 0.030, 0.022, 2.2),
        (0.12, 0.033, 0.033, 0.060, 0.030, 2.4),
        (0.25, 0.034, 0.033, 0.070, 0.031, 2.4),
        (0.40, 0.037, 0.036, 0.058, 0.031, 2.4),
        (0.62, 0.044, 0.043, 0.030, 0.031, 2.4),
        (0.75, 0.046, 0.048, 0.018, 0.030, 2.4),
        (0.90, 0.036, 0.044, 0.008, 0.028, 2.4),
        (0.98, 0.020, 0.028, 0.000, 0.024, 2.2),
    ]
)

_TRAPEZIUS = np.array([(0.0, 0.05, 0.04, 0.05, 0.05), (1.0, 0.05, 0.036, 0.045, 0.05)])
_THUMB = np.array(
    [
        (0.0, 0.015, 0.015, 0.016, 0.016),
        (0.6, 0.012, 0.012, 0.012, 0.012),
        (1.0, 0.009, 0.009, 0.009, 0.009),
    ]
)
_FORWARD = np.array([0.0, 0.0, 1.0])

HAND_LENGTH = 0.108
"""Wrist to the tip of the middle finger, in statures (Drillis and Contini)."""
FOOT_LENGTH = 0.152
"""Heel to toes, in statures (Drillis and Contini)."""


def _trunk() -> Sweep:
    rows = _TRUNK
    low, high = rows[0, 0], rows[-1, 0]
    stations = np.column_stack(
        [(rows[:, 0] - low) / (high - low), rows[:, 1], rows[:, 1], rows[:, 2], rows[:, 3], rows[:, 4]]
    )
    return Sweep(np.array([0.0, low, 0.0]), np.array([0.0, high, 0.0]), np.array([0.0, 0.0, 1.0]), stations)


class BodyField:
    """Signed distance of the left half (x >= 0) of the reference body, mirrored to the right.

    Calling it gives the distance of (N, 3) points in the model frame, metres; `parts` gives the
    distances to trunk with head, arm and leg apart.
    """

    def __init__(self) -> None:
        nodes = rest_nodes() * ADULT_STATURE_M
        at = {name: nodes[i] for name, i in NODE_INDEX.items()}
        self.trunk = _trunk()
        self.buttock = Ellipsoid(np.array([0.080, 0.895, -0.065]), np.array([0.080, 0.085, 0.072]), np.eye(3))
        self._make_head()
        self._make_arm(at)
        self._make_leg(at)

    def _make_head(self) -> None:
        self.neck = Sweep(np.array([0.0, 1.48, -0.030]), np.array([0.0, 1.63, -0.005]), _FORWARD, _NECK)
        self.cranium = Ellipsoid(np.array([0.0, 1.664, -0.004]), np.array([0.077, 0.086, 0.098]), np.eye(3))
        self.face = Ellipsoid(np.array([0.0, 1.610, 0.026]), np.array([0.060, 0.085, 0.068]), np.eye(3))
        self.nose = Ellipsoid(np.array([0.0, 1.615, 0.092]), np.array([0.014, 0.024, 0.020]), np.eye(3))

    def _make_arm(self, at: dict[str, Array]) -> None:
        shoulder, elbow, wrist = (at[f"left_{n}"] for n in ("shoulder", "elbow", "wrist"))
        along = (wrist - elbow) / np.linalg.norm(wrist - elbow)
        palm = np.cross(along, _FORWARD)
        self.deltoid = Ellipsoid(shoulder + [0.012, -0.002, 0.0], np.array([0.058, 0.056, 0.058]), np.eye(3))
        self.trapezius = Sweep(
            np.array([0.03, 1.49, -0.045]), shoulder + [0.0, 0.012, 0.0], _FORWARD, _TRAPEZIUS
        )
        self.upper_arm = Sweep(shoulder, elbow, _FORWARD, _UPPER_ARM)
        self.forearm = Sweep(elbow, wrist, _FORWARD, _FOREARM)
        tip = wrist + along * HAND_LENGTH * ADULT_STATURE_M
        self.hand = Sweep(wrist, tip + 0.012 * palm, _FORWARD, _HAND)
        self.thumb = Sweep(
            wrist + 0.035 * along + 0.024 * _FORWARD + 0.008 * palm,
            wrist + 0.105 * along + 0.060 * _FORWARD + 0.022 * palm,
            _FORWARD,
            _THUMB,
        )

    def _make_leg(self, at: dict[str, Array]) -> None:
        hip, knee, ankle = (at[f"left_{n}"] for n in ("hip", "knee", "ankle"))
        self.thigh = Sweep(hip, knee, _FORWARD, _THIGH)
        self.shank = Sweep(knee, ankle, _FORWARD, _SHANK)
        heel = np.array([ankle[0], 0.030, ankle[2] - 0.058])
        toe = heel + _FORWARD * FOOT_LENGTH * ADULT_STATURE_M + [0.004, 0.0, 0.0]
        self.foot = Sweep(heel, toe, np.array([0.0, 1.0, 0.0]), _FOOT)

    def parts(self, points: Array) -> tuple[Array, Array, Array]:
        """Signed distances (N,) to the trunk with head, to the arm, and to the leg."""
        points = np.column_stack([np.abs(points[:, 0]), points[:, 1:]])
        torso = smooth_min(self.trunk(points), self.trapezius(points), 0.06)
        head = smooth_min(self.cranium(points), self.face(points), 0.05)
        head = smooth_min(head, self.nose(points), 0.02)
        torso = smooth_min(torso, smooth_min(head, self.neck(points), 0.03), 0.05)
        torso = smooth_min(torso, self.buttock(points), 0.05)
        arm = smooth_min(self.upper_arm(points), self.deltoid(points), 0.05)
        arm = smooth_min(arm, self.forearm(points), 0.015)
        hand = smooth_min(self.hand(points), self.thumb(points), 0.02)
        arm = smooth_min(arm, hand, 0.012)
        leg = smooth_min(self.thigh(points), self.shank(points), 0.015)
        leg = np.maximum(smooth_min(leg, self.foot(points), 0.03), -points[:, 1])
        return torso, arm, leg

    def __call__(self, points: Array) -> Array:
        """Signed distance (N,) of points (N, 3)."""
        torso, arm, leg = self.parts(points)
        return smooth_min(smooth_min(torso, arm, 0.045), leg, 0.04)
