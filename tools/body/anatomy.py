"""The embedded body's outer shape: cross-sections along the bones of a 1.75 m adult.

All lengths are metres. Statures, segment lengths, head, hand and foot are those of published
anthropometry: R. Drillis and R. Contini, *Body segment parameters*, 1966 (lengths), and C. C.
Gordon et al., *2012 anthropometric survey of U.S. Army personnel*, NATICK/TR-15/007, 2014 (head
length and breadth, crotch height, hip breadth, foot length). Soldiers are thick-set; trunk and
limbs here are slimmer (waist 0.81 m against their 0.93 m, thigh 0.55 m against 0.62 m): a person of
body mass index 21. Where the joint centres lie in depth inside the body follows skinned human
models, and was checked against people whose joints and surface are both known
(``tools/body/measure_fit.py``).
"""

from __future__ import annotations

import numpy as np

from depth_pose.core.skeleton import ADULT_STATURE_M, NODE_INDEX, rest_nodes
from surface import Array, Ellipsoid, Sweep, smooth_min

# Rows: height, half-breadth, front, back (both measured from the pelvis's z = 0), exponent.
_TRUNK = np.array(
    [
        (0.842, 0.105, 0.052, 0.046, 2.0),
        (0.866, 0.150, 0.088, 0.076, 2.1),
        (0.892, 0.172, 0.108, 0.090, 2.2),
        (0.925, 0.174, 0.113, 0.098, 2.3),
        (0.962, 0.167, 0.119, 0.093, 2.3),
        (1.001, 0.159, 0.126, 0.081, 2.3),
        (1.039, 0.153, 0.129, 0.067, 2.4),
        (1.078, 0.145, 0.129, 0.060, 2.4),
        (1.116, 0.139, 0.131, 0.057, 2.4),
        (1.154, 0.138, 0.134, 0.058, 2.4),
        (1.193, 0.140, 0.136, 0.063, 2.4),
        (1.231, 0.144, 0.134, 0.068, 2.3),
        (1.270, 0.152, 0.131, 0.073, 2.3),
        (1.308, 0.160, 0.127, 0.081, 2.3),
        (1.347, 0.159, 0.115, 0.086, 2.2),
        (1.385, 0.150, 0.095, 0.084, 2.1),
        (1.424, 0.130, 0.073, 0.077, 2.0),
        (1.463, 0.092, 0.052, 0.060, 2.0),
        (1.500, 0.058, 0.052, 0.040, 2.0),
    ]
)
_NECK = np.array(
    [
        (0.0, 0.058, 0.058, 0.046, 0.053),
        (0.5, 0.051, 0.051, 0.047, 0.053),
        (1.0, 0.054, 0.054, 0.052, 0.060),
    ]
)
# Rows: fraction of the bone, half-axes towards the inside, the outside, front, back[, exponent].
_UPPER_ARM = np.array(
    [
        (-0.08, 0.048, 0.044, 0.051, 0.057),
        (0.00, 0.048, 0.048, 0.055, 0.061),
        (0.10, 0.048, 0.049, 0.054, 0.058),
        (0.20, 0.048, 0.048, 0.050, 0.053),
        (0.35, 0.045, 0.043, 0.047, 0.048),
        (0.50, 0.041, 0.039, 0.045, 0.047),
        (0.65, 0.040, 0.036, 0.045, 0.045),
        (0.80, 0.040, 0.034, 0.044, 0.041),
        (0.90, 0.040, 0.032, 0.043, 0.037),
        (1.00, 0.041, 0.033, 0.044, 0.036),
    ]
)
_FOREARM = np.array(
    [
        (0.00, 0.041, 0.033, 0.044, 0.036),
        (0.10, 0.042, 0.034, 0.044, 0.035),
        (0.20, 0.042, 0.037, 0.043, 0.036),
        (0.35, 0.041, 0.036, 0.038, 0.035),
        (0.50, 0.036, 0.034, 0.033, 0.034),
        (0.65, 0.031, 0.030, 0.029, 0.031),
        (0.80, 0.025, 0.024, 0.028, 0.028),
        (0.90, 0.022, 0.021, 0.027, 0.026),
        (1.00, 0.020, 0.019, 0.027, 0.027),
    ]
)
_HAND = np.array(
    [
        (0.00, 0.020, 0.019, 0.027, 0.027, 2.2),
        (0.22, 0.021, 0.015, 0.038, 0.036, 2.4),
        (0.45, 0.018, 0.014, 0.043, 0.042, 2.6),
        (0.60, 0.015, 0.012, 0.042, 0.042, 2.6),
    ]
)
_FINGERS = np.array(
    [
        (0.00, 0.014, 0.012, 0.042, 0.042, 2.6),
        (0.50, 0.011, 0.011, 0.038, 0.040, 2.6),
        (0.85, 0.009, 0.009, 0.030, 0.034, 2.6),
        (1.00, 0.007, 0.007, 0.022, 0.026, 2.4),
    ]
)
_THUMB = np.array(
    [
        (0.0, 0.015, 0.015, 0.016, 0.016),
        (0.6, 0.012, 0.012, 0.012, 0.012),
        (1.0, 0.009, 0.009, 0.009, 0.009),
    ]
)
_SHOULDER = np.array([(0.0, 0.050, 0.026, 0.050, 0.040), (1.0, 0.050, 0.046, 0.060, 0.052)])
_THIGH = np.array(
    [
        (-0.16, 0.050, 0.040, 0.060, 0.060, 2.0),
        (-0.05, 0.075, 0.056, 0.090, 0.080, 2.0),
        (0.05, 0.088, 0.065, 0.108, 0.081, 2.0),
        (0.15, 0.091, 0.069, 0.114, 0.077, 2.1),
        (0.30, 0.092, 0.071, 0.115, 0.063, 2.1),
        (0.45, 0.089, 0.067, 0.112, 0.057, 2.2),
        (0.60, 0.082, 0.062, 0.101, 0.055, 2.2),
        (0.75, 0.071, 0.056, 0.084, 0.053, 2.2),
        (0.90, 0.060, 0.051, 0.066, 0.058, 2.2),
        (1.00, 0.054, 0.049, 0.057, 0.062, 2.2),
    ]
)
_SHANK = np.array(
    [
        (0.00, 0.054, 0.049, 0.057, 0.062, 2.2),
        (0.10, 0.045, 0.052, 0.042, 0.072, 2.2),
        (0.20, 0.041, 0.057, 0.035, 0.080, 2.2),
        (0.30, 0.041, 0.059, 0.032, 0.083, 2.2),
        (0.40, 0.040, 0.057, 0.030, 0.080, 2.2),
        (0.55, 0.036, 0.051, 0.028, 0.068, 2.2),
        (0.70, 0.030, 0.043, 0.028, 0.055, 2.2),
        (0.85, 0.028, 0.036, 0.031, 0.044, 2.2),
        (0.95, 0.032, 0.035, 0.036, 0.041, 2.2),
        (1.05, 0.034, 0.034, 0.040, 0.044, 2.2),
        (1.14, 0.028, 0.028, 0.034, 0.038, 2.0),
    ]
)
# Along the foot, heel to toes: half-axes inside, outside, up, down from an axis 0.03 above the floor.
_FOOT = np.array(
    [
        (0.00, 0.020, 0.022, 0.020, 0.020, 2.2),
        (0.08, 0.031, 0.032, 0.050, 0.029, 2.4),
        (0.20, 0.031, 0.033, 0.064, 0.031, 2.3),
        (0.38, 0.030, 0.040, 0.063, 0.031, 2.2),
        (0.48, 0.029, 0.044, 0.045, 0.031, 2.2),
        (0.58, 0.034, 0.050, 0.031, 0.031, 2.3),
        (0.70, 0.040, 0.054, 0.016, 0.030, 2.4),
        (0.80, 0.039, 0.053, 0.006, 0.030, 2.4),
        (0.92, 0.034, 0.040, 0.001, 0.029, 2.4),
        (0.99, 0.022, 0.026, 0.001, 0.026, 2.2),
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


SOLE = 0.0260
"""Height of the sole of the foot below `depth_pose.core.skeleton.rest_nodes`' zero level, in statures.

With it the ankle joint is .046 and the hip joint .531 of the stature above the sole (Drillis and
Contini: .039 and .530) and the head's joint .089 below the crown, as in bodies whose joint centres
and surface are both known.
"""


def reference_nodes() -> Array:
    """Rest positions (21, 3) of the nodes of the 1.75 m body, metres; the sole is at y = 0."""
    return (rest_nodes() - [0.0, SOLE, 0.0]) * ADULT_STATURE_M


class BodyField:
    """Signed distance of the left half (x >= 0) of the reference body, mirrored to the right.

    Calling it gives the distance of (N, 3) points in the model frame, metres; `parts` gives the
    distances to trunk with head, arm and leg apart.
    """

    def __init__(self) -> None:
        nodes = reference_nodes()
        at = {name: nodes[i] for name, i in NODE_INDEX.items()}
        self.trunk = _trunk()
        self.buttock = Ellipsoid(np.array([0.085, 0.905, -0.043]), np.array([0.085, 0.085, 0.068]), np.eye(3))
        self.breast = Ellipsoid(np.array([0.082, 1.280, 0.085]), np.array([0.062, 0.060, 0.050]), np.eye(3))
        self._make_head()
        self._make_arm(at)
        self._make_leg(at)

    def _make_head(self) -> None:
        self.neck = Sweep(np.array([0.0, 1.47, 0.008]), np.array([0.0, 1.60, 0.034]), _FORWARD, _NECK)
        self.cranium = Ellipsoid(np.array([0.0, 1.660, 0.031]), np.array([0.077, 0.091, 0.102]), np.eye(3))
        self.face = Ellipsoid(np.array([0.0, 1.604, 0.067]), np.array([0.057, 0.078, 0.066]), np.eye(3))
        self.nose = Ellipsoid(np.array([0.0, 1.612, 0.135]), np.array([0.014, 0.024, 0.016]), np.eye(3))

    def _make_arm(self, at: dict[str, Array]) -> None:
        shoulder, elbow, wrist = (at[f"left_{n}"] for n in ("shoulder", "elbow", "wrist"))
        along = (wrist - elbow) / np.linalg.norm(wrist - elbow)
        palm = np.cross(along, _FORWARD)
        self.deltoid = Ellipsoid(
            shoulder + np.array([0.005, 0.0, -0.003]), np.array([0.057, 0.054, 0.064]), np.eye(3)
        )
        self.trapezius = Sweep(
            np.array([0.030, 1.475, -0.025]),
            shoulder + np.array([-0.015, 0.010, -0.012]),
            _FORWARD,
            _SHOULDER,
        )
        self.upper_arm = Sweep(shoulder, elbow, _FORWARD, _UPPER_ARM)
        self.forearm = Sweep(elbow, wrist, _FORWARD, _FOREARM)
        length = HAND_LENGTH * ADULT_STATURE_M
        knuckles = wrist + 0.56 * length * along + 0.004 * palm
        tip = wrist + 0.96 * length * along + 0.038 * palm
        self.hand = Sweep(wrist, wrist + (knuckles - wrist) / 0.56, _FORWARD, _HAND)
        self.fingers = Sweep(knuckles, tip, _FORWARD, _FINGERS)
        self.thumb = Sweep(
            wrist + 0.035 * along + 0.024 * _FORWARD + 0.008 * palm,
            wrist + 0.102 * along + 0.064 * _FORWARD + 0.032 * palm,
            _FORWARD,
            _THUMB,
        )

    def _make_leg(self, at: dict[str, Array]) -> None:
        hip, knee, ankle = (at[f"left_{n}"] for n in ("hip", "knee", "ankle"))
        self.thigh = Sweep(hip, knee, _FORWARD, _THIGH)
        self.shank = Sweep(knee, ankle, _FORWARD, _SHANK)
        heel = np.array([ankle[0], 0.030, ankle[2] - 0.052])
        toe = heel + _FORWARD * FOOT_LENGTH * ADULT_STATURE_M
        self.foot = Sweep(heel, toe, np.array([0.0, 1.0, 0.0]), _FOOT)

    def parts(self, points: Array) -> tuple[Array, Array, Array]:
        """Signed distances (N,) to the trunk with head, to the arm, and to the leg."""
        points = np.column_stack([np.abs(points[:, 0]), points[:, 1:]])
        torso = smooth_min(self.trunk(points), self.trapezius(points), 0.06)
        head = smooth_min(self.cranium(points), self.face(points), 0.05)
        head = smooth_min(head, self.nose(points), 0.02)
        torso = smooth_min(torso, smooth_min(head, self.neck(points), 0.03), 0.05)
        torso = smooth_min(torso, self.buttock(points), 0.05)
        torso = smooth_min(torso, self.breast(points), 0.04)
        arm = smooth_min(self.upper_arm(points), self.deltoid(points), 0.05)
        arm = smooth_min(arm, self.forearm(points), 0.015)
        hand = smooth_min(self.hand(points), self.fingers(points), 0.012)
        hand = smooth_min(hand, self.thumb(points), 0.02)
        arm = smooth_min(arm, hand, 0.012)
        leg = smooth_min(self.thigh(points), self.shank(points), 0.015)
        leg = np.maximum(smooth_min(leg, self.foot(points), 0.03), -points[:, 1])
        return torso, arm, leg

    def __call__(self, points: Array) -> Array:
        """Signed distance (N,) of points (N, 3)."""
        torso, arm, leg = self.parts(points)
        return smooth_min(smooth_min(torso, arm, 0.045), leg, 0.04)
