"""The floor below one camera: from its depth image of the empty room, else from people who stand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.config import SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.core.rotations import unit_vectors
from depth_pose.core.skeleton import ADULT_STATURE_M, JOINT_INDEX, NODE_INDEX, rest_nodes
from depth_pose.detect.floor import Floor, FloorFinder
from depth_pose.rooms.background import EmptyRoom
from depth_pose.rooms.calibration_input import BodyTrack

Array = NDArray[np.float64]

_MOST_BODIES = 50
"""Number of skeletons from which the floor below a camera that looks down is tried. Set by hand."""
_STRAIGHT = np.cos(np.radians(25.0))
"""Maximum angle between trunk and legs of a standing person. Set by hand."""
_SAME_UP, _SAME_M = np.cos(np.radians(20.0)), 0.5
"""Maximum distance between the plane fitted to depth and the plane fitted to feet: direction, which feet give
to about 10 degrees, and height. Set by hand."""
_ANKLE_M = float(rest_nodes()[NODE_INDEX["left_ankle"], 1]) * ADULT_STATURE_M
"""Height of an ankle above the floor, metres."""

BY_STANDING = "people who stand"
"""Source of a floor that no depth image shows."""


def find_floor(tracks: Sequence[BodyTrack], background: EmptyRoom | None) -> Floor | None:
    """Find the floor below a camera, camera frame; None where neither images nor people show it.

    Parameters
    ----------
    tracks : sequence of BodyTrack
    background : EmptyRoom, optional
    """
    stood = _floor_of_standing(tracks)
    if background is None:
        return stood
    bodies = [joints for track in tracks for joints in track.joints[:: max(1, len(track.joints) // 10)]]
    finder = FloorFinder(SegmentConfig()) if stood is None else FloorFinder(SegmentConfig(), stood.up)
    seen = finder.find(DepthFrame(0, "", background.depth, background.camera), bodies[:_MOST_BODIES])
    if seen is None:
        return stood
    if stood is not None and (seen.up @ stood.up < _SAME_UP or abs(seen.height - stood.height) > _SAME_M):
        return stood
    return Floor(seen.up, seen.height)


def _floor_of_standing(tracks: Sequence[BodyTrack]) -> Floor | None:
    """Estimate the floor from the bodies of people who stand upright."""
    if not tracks:
        return None
    joints = np.concatenate([track.joints for track in tracks])
    at = {name: joints[:, i] for name, i in JOINT_INDEX.items()}
    ankles = 0.5 * (at["left_ankle"] + at["right_ankle"])
    trunk, legs = unit_vectors(at["neck"] - at["pelvis"]), unit_vectors(at["pelvis"] - ankles)
    stands = np.sum(trunk * legs, axis=1) > _STRAIGHT
    if not stands.any():
        return None
    up = unit_vectors(np.median(unit_vectors(at["neck"] - ankles)[stands], axis=0))
    lower = np.minimum(at["left_ankle"] @ up, at["right_ankle"] @ up)[stands]
    return Floor(np.asarray(up), float(_ANKLE_M - np.median(lower)), BY_STANDING)
