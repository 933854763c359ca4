"""The floor that people stand on, from their skeletons and optionally the depth recording.

`depth-pose run` records the floor where the sensor stood still and saw it. Else feet give a rough estimate:
a toe base is .024 of the stature above the floor, and a standing trunk points up. The depth images then
give it exactly (`depth_pose.detect.floor`).

The world is REP-103's: x forward (where the sensor looks), y to the left, z up, the origin on the floor
below the sensor.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.config import SegmentConfig
from depth_pose.core.errors import InputError
from depth_pose.core.frame import DepthFrame
from depth_pose.core.rotations import unit_vectors
from depth_pose.core.skeleton import ADULT_STATURE_M, JOINT_INDEX
from depth_pose.detect.floor import Floor, FloorFinder
from depth_pose.export.tracks import Track, Tracks, in_world
from depth_pose.io.mcap_read import DepthReader
from depth_pose.io.recording import read_metadata
from depth_pose.offline import FLOOR

Array = NDArray[np.float64]

FLOOR_FRAME = "floor"
"""Name of the frame on the floor."""

_TOE_SHARE = 0.024
"""Height of the toe base above a standing person's sole, as a share of stature: measured on skinned bodies
(.018 to .026). The .044 of `rest_nodes` is that of the back of the foot."""
_SURE = 0.5
"""Minimum confidence of a toe base used for the floor. Set by hand."""
_STANDING_COS = np.cos(np.radians(25.0))
"""Maximum angle between trunk and shanks of a standing person. Set by hand."""
_FEET_SPREAD_M = 0.04
"""Deviation of toe bases from feet on the floor, metres: joint error and lifted feet. Set by hand,
about the feet's error in `docs/accuracy.md`."""
_FEET_OFF_M = 0.015
"""Deviation of one person's toe bases from the average height, metres: shoes and build. Set by hand."""
_ALIKE_FRAMES = 10
"""Successive frames whose feet err alike. Set by hand: a third of a second."""
_UP_SPREAD = 0.07
"""Mean lean of a standing trunk over a recording, radians (4 degrees). Set by hand."""
_BENT_SPREAD = 0.2
"""The same where people do not stand: bent, seated, squatting. Set by hand."""
_LEAST_STANDING = 0.4
"""Minimum share of frames with a standing person for the up direction of standing trunks. Set by hand."""
_FAR_M = 100.0
"""Feet farther from the camera than this (m) are beyond the range of depth sensors; set by hand."""
_ROUNDS = 8
"""Number of reweighted fits of the plane. Set by hand."""
_FRAMES = 12
"""Maximum number of depth images searched for the floor. Set by hand."""
_SAME_COS, _SAME_M = np.cos(np.radians(20.0)), 0.4
"""Maximum difference of a floor in the images from the estimate by feet, which errs by 5 degrees and 10 cm; a
table is higher. Set by hand."""


def recorded_floor(skeletons: Path | str) -> Floor | None:
    """Return the floor that `run` recorded with the skeletons, if it did."""
    return Floor.from_metadata(read_metadata(skeletons, FLOOR) or {})


def find_floor(
    people: Sequence[Track], skeletons: Path | str, recording: Path | str | None, depth_topic: str | None
) -> Floor:
    """Find the floor: in the depth recording if there is one, else as recorded by `run`, else from feet.

    Parameters
    ----------
    people : sequence of Track
        In the sensor's frame; needed only without a `recorded_floor`.
    skeletons : Path or str
        Their recording.
    recording : Path or str, optional
        The depth recording.
    depth_topic : str, optional
        Its topic.

    Raises
    ------
    InputError
        Where no feet and trunk are known well enough, and there is no other floor.
    """
    guess = recorded_floor(skeletons) or floor_of_feet(people)
    if recording is None:
        return guess
    reader = DepthReader(recording, depth_topic)
    return floor_of_depth(some_frames(reader, len(reader)), guess) or guess


def on_floor(tracks: Tracks, floor: Floor) -> Tracks:
    """Return the motion in the floor's frame, `FLOOR_FRAME`."""
    turned = tuple(in_world(track, floor.T_floor_camera, FLOOR_FRAME) for track in tracks.people)
    return replace(tracks, people=turned, frame_id=FLOOR_FRAME)


def floor_of_feet(tracks: Iterable[Track]) -> Floor:
    """Estimate the floor from people's feet.

    Raises
    ------
    InputError
        Where no feet and trunk are known well enough.
    """
    tracks = [track for track in tracks if track.present.any()]
    up, up_spread = _up(tracks)
    toes = [_toes(track, up) for track in tracks]
    points = np.concatenate([p for p, _ in toes]) if toes else np.zeros((0, 3))
    if len(points) < 2:
        raise InputError("no feet are seen well enough to find the floor")
    below = np.concatenate([h for _, h in toes])
    if not np.abs(points).max() < _FAR_M:
        raise InputError(f"feet farther than {_FAR_M:.0f} m from the camera do not show the floor")
    return _settled(points - below[:, None] * up, up, up_spread)


def _up(tracks: list[Track]) -> tuple[Array, float]:
    """Mean direction of standing trunks, else of all trunks, camera frame, and its deviation, radians."""
    standing, trunks = [], []
    for track in tracks:
        at = {name: track.positions[track.present, i] for name, i in JOINT_INDEX.items()}
        trunk = unit_vectors(at["neck"] - at["pelvis"])
        shanks = [
            np.sum(trunk * unit_vectors(at[f"{s}_hip"] - at[f"{s}_ankle"]), axis=1) for s in ("left", "right")
        ]
        trunks.append(trunk)
        standing.append(trunk[np.min(shanks, axis=0) > _STANDING_COS])
    for some, spread in ((standing, _UP_SPREAD), (trunks, _BENT_SPREAD)):
        found = np.concatenate(some) if some else np.zeros((0, 3))
        if len(found) > _LEAST_STANDING * sum(map(len, trunks)):
            up = np.asarray(unit_vectors(np.median(found, axis=0)))
            scatter = float(np.sqrt(np.mean(np.sum((found - up) ** 2, axis=1)) / 2))
            return up, max(spread, scatter)  # trunks that lean in many ways
    raise InputError("the recording has no skeletons from which to find the floor")


def _toes(track: Track, up: Array) -> tuple[Array, Array]:
    """Toe bases that are the lowest points of a body, and their nominal height above the floor, metres."""
    feet = [JOINT_INDEX["left_foot"], JOINT_INDEX["right_foot"]]
    there = np.flatnonzero(track.present)
    heights = track.positions[there][:, feet] @ up
    lower = np.argmin(heights, axis=1)
    points = track.positions[there, np.array(feet)[lower]]
    sure = track.joint_confidence[there, np.array(feet)[lower]] >= _SURE
    size = np.where(track.scale[there] > 0, track.scale[there], 1.0)
    return points[sure], (_TOE_SHARE * ADULT_STATURE_M * size)[sure].astype(np.float64)


def _settled(points: Array, up: Array, up_spread: float) -> Floor:
    """Fit a plane to points on the floor, pulled to a direction of up, with little weight on jumps."""
    forward = np.array([0.0, 0.0, 1.0]) if abs(up[2]) < 0.9 else np.array([0.0, -1.0, 0.0])
    first = unit_vectors(forward - (forward @ up) * up)
    second = np.cross(up, first)
    middle = points.mean(axis=0)
    flat = np.stack([(points - middle) @ first, (points - middle) @ second, np.ones(len(points))], axis=1)
    above = (points - middle) @ up
    prior = np.diag([1.0, 1.0, 0.0]) * (_FEET_SPREAD_M / up_spread) ** 2
    slope = np.array([0.0, 0.0, np.percentile(above, 25)])  # lifted feet are above the floor, none below
    for _ in range(_ROUNDS):
        weight = 1.0 / (1.0 + ((above - flat @ slope) / _FEET_SPREAD_M) ** 2) ** 2
        normal_matrix = flat.T @ (weight[:, None] * flat) + prior
        slope = np.linalg.solve(normal_matrix, flat.T @ (weight * above))
    normal = unit_vectors(up - slope[0] * first - slope[1] * second)
    on_it = middle + slope[2] * up
    known = flat.T @ (weight[:, None] * flat) / _ALIKE_FRAMES + prior
    covariance = np.linalg.inv(known) * _FEET_SPREAD_M**2
    return Floor(
        np.asarray(normal),
        float(-normal @ on_it),
        "feet",
        deviation=float(np.hypot(np.sqrt(covariance[2, 2]), _FEET_OFF_M)),
        tilt_deviation_deg=float(np.degrees(np.sqrt(0.5 * (covariance[0, 0] + covariance[1, 1])))),
    )


def floor_of_depth(frames: Iterable[DepthFrame], guess: Floor) -> Floor | None:
    """Find the floor in depth images, near a guess; None if too little of it is visible.

    Parameters
    ----------
    frames : iterable of DepthFrame
        A dozen, spread over the recording, are enough; see `some_frames`.
    guess : Floor

    Returns
    -------
    Floor or None
        The median of the floors that `FloorFinder` finds near the guess.
    """
    finder = FloorFinder(SegmentConfig(), guess.up)
    seen = [floor for frame in frames if (floor := finder.find(frame)) is not None]
    near = [f for f in seen if f.up @ guess.up > _SAME_COS and abs(f.height - guess.height) < _SAME_M]
    if not near:
        return None
    up = unit_vectors(np.median([f.up for f in near], axis=0))
    return Floor(np.asarray(up), float(np.median([f.height for f in near])))


def some_frames(frames: Iterable[DepthFrame], count: int) -> list[DepthFrame]:
    """Select a dozen frames, spread over the recording."""
    step = max(1, count // _FRAMES)
    return [frame for i, frame in enumerate(frames) if i % step == 0][:_FRAMES]
