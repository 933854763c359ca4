"""Ranges of motion in degrees: the numbers behind `depth_pose.body.limits`."""

from __future__ import annotations

from depth_pose.body.angles import ANGLES

TRUNK_RANGES: dict[str, tuple[float, float]] = {
    # The pelvis against the world may lean and turn freely; these keep a person off the ground.
    "pelvis_flexion": (-60.0, 110.0),
    "pelvis_side": (-60.0, 60.0),
    "pelvis_twist": (-1e9, 1e9),
    # Thoracolumbar spine: flexion 80 to 90, extension 20 to 30, side bend 35, rotation 45 (AAOS),
    # the lumbar part taking most of the bending and the thoracic part of the turning (Kapandji).
    "spine_flexion": (-20.0, 50.0),
    "spine_side": (-20.0, 20.0),
    "spine_twist": (-18.0, 18.0),
    "chest_flexion": (-18.0, 40.0),
    "chest_side": (-20.0, 20.0),
    "chest_twist": (-32.0, 32.0),
    # Cervical spine: flexion 45 to 60, extension 45 to 75, side bend 45, rotation 60 to 80.
    "neck_flexion": (-35.0, 35.0),
    "neck_side": (-25.0, 25.0),
    "neck_twist": (-40.0, 40.0),
    "head_flexion": (-35.0, 30.0),
    "head_side": (-22.0, 22.0),
    "head_twist": (-45.0, 45.0),
}

LIMB_RANGES: dict[str, tuple[float, float]] = {
    "clavicle_elevation": (-8.0, 38.0),
    "clavicle_protraction": (-30.0, 30.0),
    "shoulder_flexion": (-62.0, 180.0),
    "shoulder_abduction": (-75.0, 180.0),
    "shoulder_twist": (-104.0, 160.0),
    "elbow_flexion": (0.0, 150.0),
    "forearm_pronation": (-85.0, 85.0),
    "wrist_flexion": (-75.0, 78.0),
    "wrist_deviation": (-36.0, 24.0),
    "hip_flexion": (-28.0, 125.0),
    "hip_abduction": (-30.0, 60.0),
    "hip_twist": (-50.0, 48.0),
    "knee_flexion": (0.0, 150.0),
    "ankle_dorsiflexion": (-56.0, 40.0),
    "ankle_inversion": (-25.0, 38.0),
    "ankle_toe_out": (-25.0, 40.0),
}
"""Lowest and highest angle of a limb's joints, either side, degrees; sources in `depth_pose.body.limits`."""


def range_of(name: str) -> tuple[float, float]:
    """Range of one of `ANGLES`, degrees."""
    if name in TRUNK_RANGES:
        return TRUNK_RANGES[name]
    return LIMB_RANGES[name.removeprefix("left_").removeprefix("right_")]


RANGES: tuple[tuple[float, float], ...] = tuple(range_of(name) for name in ANGLES)
"""(low, high) of every angle, in the order of `ANGLES`."""
