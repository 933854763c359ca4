"""Key postures of whole-body actions, drawn by hand: kick, throw, racket swing, punch, shot, jump.

Each table is for the right side; degrees of the anatomical angles at phases from 0 to 1. They
follow the phases that sports biomechanics names (J. Hamill and K. M. Knutzen, *Biomechanical
Basis of Human Movement*): preparation, backswing, drive, follow-through, recovery.
"""

from __future__ import annotations

Table = tuple[tuple[float, dict[str, float]], ...]


def _arm(side: str, flexion: float, abduction: float, twist: float, elbow: float) -> dict[str, float]:
    return {
        f"{side}_shoulder_flexion": flexion,
        f"{side}_shoulder_abduction": abduction,
        f"{side}_shoulder_twist": twist,
        f"{side}_elbow_flexion": elbow,
    }


def _leg(side: str, hip: float, knee: float, ankle: float, abduction: float = 4.0) -> dict[str, float]:
    return {
        f"{side}_hip_flexion": hip,
        f"{side}_hip_abduction": abduction,
        f"{side}_hip_twist": -6.0,
        f"{side}_knee_flexion": knee,
        f"{side}_ankle_dorsiflexion": ankle,
        f"{side}_ankle_toe_out": 6.0,
    }


def _trunk(flexion: float, twist: float, side: float = 0.0, pelvis: float = 0.0) -> dict[str, float]:
    return {
        "pelvis_flexion": 0.4 * flexion,
        "pelvis_twist": pelvis,
        "spine_flexion": 0.35 * flexion,
        "chest_flexion": 0.25 * flexion,
        "spine_twist": 0.4 * twist,
        "chest_twist": 0.6 * twist,
        "spine_side": 0.5 * side,
        "chest_side": 0.5 * side,
        "neck_twist": -0.3 * twist,
        "head_twist": -0.4 * twist,
        "head_flexion": -0.3 * flexion,
    }


_STAND = (
    _leg("left", 4, 6, 2)
    | _leg("right", 4, 6, 2)
    | _arm("left", 2, 12, 14, 22)
    | _arm("right", 2, 12, 14, 22)
)
"""Leg and arm angles of a standing person (degrees)."""

KICK: Table = (
    (0.0, _STAND | _trunk(4, 0)),
    (0.2, _leg("left", 32, 30, 2) | _leg("right", -12, 22, -10) | _trunk(8, 6, 0, -15)
     | _arm("left", 45, 55, 10, 35) | _arm("right", -10, 25, 10, 35)),
    (0.4, _leg("left", 20, 24, 8, 0) | _leg("right", -24, 88, -30, 18) | _trunk(-6, 16, 6, -22)
     | _arm("left", 30, 95, -5, 25) | _arm("right", -30, 30, 10, 30)),
    (0.52, _leg("left", 8, 22, 12, -4) | _leg("right", 28, 55, -34, 14) | _trunk(10, -2, 10, -4)
     | _arm("left", 40, 70, 10, 30) | _arm("right", -35, 35, 10, 25)),
    (0.6, _leg("left", 2, 18, 12, -4) | _leg("right", 50, 18, -30, 8) | _trunk(14, -12, 8, 10)
     | _arm("left", 55, 35, 25, 35) | _arm("right", -42, 35, 5, 20)),
    (0.72, _leg("left", -2, 10, 2, -2) | _leg("right", 82, 15, -20, -4) | _trunk(10, -18, 4, 20)
     | _arm("left", 50, 10, 35, 45) | _arm("right", -45, 40, 5, 20)),
    (0.86, _leg("left", 2, 14, 6) | _leg("right", 48, 55, -5, 0) | _trunk(8, -8, 0, 14)
     | _arm("left", 25, 20, 20, 35) | _arm("right", -15, 25, 10, 25)),
    (1.0, _STAND | _trunk(4, 0, 0, 5)),
)  # fmt: skip

THROW: Table = (
    (0.0, _STAND | _trunk(2, 0)),
    (0.18, _leg("left", 60, 75, 0) | _leg("right", 6, 14, 6) | _trunk(2, -25, 4, -40)
     | _arm("left", 60, 15, 45, 90) | _arm("right", 55, 15, 45, 100)),
    (0.38, _leg("left", 45, 25, 5, 18) | _leg("right", -4, 30, 15, 12) | _trunk(-8, -35, -8, -45)
     | _arm("left", 60, 70, 20, 25) | _arm("right", -15, 88, -30, 70)),
    (0.52, _leg("left", 42, 35, 10, 8) | _leg("right", -14, 28, -10, 10) | _trunk(-6, -10, 6, -5)
     | _arm("left", 35, 70, 30, 60) | _arm("right", -8, 100, -85, 95)),
    (0.62, _leg("left", 40, 32, 10, 2) | _leg("right", -16, 30, -25, 8) | _trunk(22, 12, 12, 15)
     | _arm("left", 10, 55, 40, 90) | _arm("right", 55, 115, -35, 35)),
    (0.74, _leg("left", 42, 26, 12) | _leg("right", -10, 45, -30, 8) | _trunk(48, 26, 6, 25)
     | _arm("left", -20, 40, 30, 80) | _arm("right", 75, 10, 60, 20)),
    (0.88, _leg("left", 30, 22, 12) | _leg("right", 12, 50, -10, 6) | _trunk(35, 20, 2, 25)
     | _arm("left", -5, 30, 20, 60) | _arm("right", 40, -25, 60, 25)),
    (1.0, _STAND | _trunk(2, 0)),
)  # fmt: skip

RACKET: Table = (
    (0.0, _leg("left", 22, 32, 12, 12) | _leg("right", 22, 32, 12, 12) | _trunk(22, 0)
     | _arm("left", 40, 10, 40, 85) | _arm("right", 35, 12, 40, 80)),
    (0.25, _leg("left", 26, 32, 8, 10) | _leg("right", 18, 38, 14, 18) | _trunk(14, -32, -4, -45)
     | _arm("left", 65, 20, 30, 35) | _arm("right", -15, 55, -15, 60)),
    (0.42, _leg("left", 34, 32, 4, 8) | _leg("right", 6, 35, 0, 16) | _trunk(16, -28, -6, -30)
     | _arm("left", 50, 40, 20, 45) | _arm("right", -30, 60, -45, 35)),
    (0.56, _leg("left", 30, 26, 6, 6) | _leg("right", -4, 32, -14, 12) | _trunk(14, 4, 4, 5)
     | _arm("left", 25, 45, 25, 70) | _arm("right", 55, 50, 0, 25)),
    (0.7, _leg("left", 26, 22, 8, 6) | _leg("right", -6, 38, -20, 10) | _trunk(12, 30, 6, 30)
     | _arm("left", 10, 40, 35, 90) | _arm("right", 95, -10, 60, 70)),
    (0.82, _leg("left", 24, 26, 10, 8) | _leg("right", 6, 42, -10, 10) | _trunk(10, 34, 4, 38)
     | _arm("left", 15, 30, 35, 85) | _arm("right", 100, -30, 70, 115)),
    (1.0, _leg("left", 22, 32, 12, 12) | _leg("right", 22, 32, 12, 12) | _trunk(22, 0)
     | _arm("left", 40, 10, 40, 85) | _arm("right", 35, 12, 40, 80)),
)  # fmt: skip

_GUARD = _arm("left", 48, 8, 20, 125) | _arm("right", 42, 10, 20, 130)
"""A boxer's arms, degrees."""
_FIGHT = _leg("left", 28, 28, 2, 6) | _leg("right", 2, 28, 8, 14)
"""A boxer's legs, degrees."""
PUNCH: Table = (
    (0.0, _FIGHT | _GUARD | _trunk(12, -10, 0, -25)),
    (0.2, _arm("right", 25, 25, 15, 130) | _trunk(10, -22, 0, -32)),
    (0.36, _leg("left", 34, 34, 4, 6) | _leg("right", -8, 26, 0, 12) | _arm("right", 88, 6, 45, 10)
     | _trunk(16, 22, 0, 5)),
    (0.5, _FIGHT | _arm("right", 45, 14, 20, 120) | _trunk(12, 0, 0, -20)),
    (0.64, _arm("left", 90, 4, 45, 8) | _trunk(12, -22, 0, -30)),
    (0.8, _GUARD | _trunk(12, -8, 0, -25)),
    (0.9, _arm("left", 70, 60, 75, 95) | _trunk(12, -20, 0, -30)),
    (1.0, _FIGHT | _GUARD | _trunk(12, -10, 0, -25)),
)  # fmt: skip

SHOOT: Table = (
    (0.0, _leg("left", 25, 40, 14, 7) | _leg("right", 27, 40, 14, 7) | _trunk(22, 0)
     | _arm("left", 30, 8, 30, 95) | _arm("right", 30, 8, 30, 95)),
    (0.22, _leg("left", 42, 68, 26, 7) | _leg("right", 44, 68, 26, 7) | _trunk(28, 0)
     | _arm("left", 40, 5, 35, 100) | _arm("right", 40, 5, 30, 105)),
    (0.42, _leg("left", 12, 20, 4, 5) | _leg("right", 14, 20, 4, 5) | _trunk(4, 4)
     | _arm("left", 115, 15, 15, 85) | _arm("right", 110, 12, 10, 110)),
    (0.56, _leg("left", 0, 6, -28, 5) | _leg("right", 2, 6, -28, 5) | _trunk(-2, 6)
     | _arm("left", 140, 25, 10, 45) | _arm("right", 150, 10, 0, 25) | {"right_wrist_flexion": 50.0}),
    (0.72, _leg("left", 4, 12, -16, 5) | _leg("right", 4, 12, -16, 5) | _trunk(2, 4)
     | _arm("left", 110, 30, 10, 40) | _arm("right", 140, 12, 0, 12) | {"right_wrist_flexion": 60.0}),
    (0.86, _leg("left", 20, 34, 12, 6) | _leg("right", 20, 34, 12, 6) | _trunk(14, 0)
     | _arm("left", 40, 25, 15, 45) | _arm("right", 50, 22, 15, 45) | {"right_wrist_flexion": 10.0}),
    (1.0, _leg("left", 25, 40, 14, 7) | _leg("right", 27, 40, 14, 7) | _trunk(22, 0)
     | _arm("left", 30, 8, 30, 95) | _arm("right", 30, 8, 30, 95)),
)  # fmt: skip

JUMP: Table = (
    (0.0, _STAND | _trunk(4, 0)),
    (0.3, _leg("left", 72, 92, 30, 7) | _leg("right", 72, 92, 30, 7) | _trunk(55, 0)
     | _arm("left", -45, 18, 10, 20) | _arm("right", -45, 18, 10, 20)),
    (0.42, _leg("left", 18, 28, -8, 5) | _leg("right", 18, 28, -8, 5) | _trunk(14, 0)
     | _arm("left", 70, 18, 20, 45) | _arm("right", 70, 18, 20, 45)),
    (0.5, _leg("left", -2, 4, -38, 5) | _leg("right", -2, 4, -38, 5) | _trunk(0, 0)
     | _arm("left", 140, 25, 10, 30) | _arm("right", 140, 25, 10, 30)),
    (0.62, _leg("left", 24, 38, -25, 8) | _leg("right", 20, 34, -25, 8) | _trunk(4, 0)
     | _arm("left", 120, 45, 10, 35) | _arm("right", 120, 45, 10, 35)),
    (0.74, _leg("left", 14, 18, -18, 7) | _leg("right", 14, 18, -18, 7) | _trunk(8, 0)
     | _arm("left", 65, 45, 10, 35) | _arm("right", 65, 45, 10, 35)),
    (0.84, _leg("left", 58, 76, 26, 8) | _leg("right", 58, 76, 26, 8) | _trunk(40, 0)
     | _arm("left", 20, 35, 15, 35) | _arm("right", 20, 35, 15, 35)),
    (1.0, _STAND | _trunk(4, 0)),
)  # fmt: skip
JUMP_AIR = (0.5, 0.78)
"""Phases of take-off and landing of `JUMP`."""
