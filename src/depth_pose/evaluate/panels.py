"""The frames of a contact sheet: depth images with their skeletons and true joints."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.frame import DepthFrame
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import JOINTS
from depth_pose.evaluate.score_people import WEAK_SHARE
from depth_pose.evaluate.truth import STAMP_TOLERANCE_NS, KnownPeople, load_known_people
from depth_pose.io.mcap_read import DepthReader
from depth_pose.io.schemas import PEOPLE_TOPIC
from depth_pose.rooms.placed_camera import Answer, PlacedCamera, answers_in_frames
from depth_pose.rooms.recorded import RecordedPeople, read_recorded

NOBODY = np.zeros((0, len(JOINTS), 3))
"""Empty joints, for a frame without truth."""


@dataclass(frozen=True)
class Panel:
    """One frame of a sheet: the depth, all skeletons or None, and the true joints (P, 19, 3).

    ``name`` is written beside its time.
    """

    frame: DepthFrame
    skeletons: tuple[Skeleton, ...] | None
    truth: NDArray[np.float64]
    seconds: float
    name: str = ""


def project(points: NDArray[np.floating], camera: Camera) -> NDArray[np.float64]:
    """Pixel coordinates (u, v) of points (..., 3) in the camera frame; NaN behind the camera."""
    return camera.project(np.where(points[..., 2:] > 1e-6, points, np.nan))


def answers_in_images(people: RecordedPeople, camera: PlacedCamera | None) -> Answer:
    """As `answers_in_frames`; of the people in a room only those in the image."""
    answer = answers_in_frames(people, camera)
    if not people.is_room:
        return answer

    def within_image(frame: DepthFrame) -> tuple[Skeleton, ...] | None:
        everybody = answer(frame)
        if everybody is None:
            return None
        return tuple(s for s in everybody if _is_in_image(s.positions, frame.camera))

    return within_image


def _is_in_image(joints: NDArray[np.float64], camera: Camera) -> bool:
    """Whether any of the joints (19, 3), camera frame, is in the image."""
    pixels = project(joints, camera)
    return bool(((pixels > -0.5) & (pixels < (camera.width - 0.5, camera.height - 0.5))).all(axis=1).any())


def collect_panels(
    recording_path: Path | str,
    skeleton_path: Path | str,
    frames: int,
    truth_path: Path | str | None = None,
    depth_topic: str | None = None,
    skeleton_topic: str = PEOPLE_TOPIC,
    camera: PlacedCamera | None = None,
) -> list[Panel]:
    """Choose the frames of a sheet, spread over the recording; arguments as for `save_overlay`."""
    if frames < 1:
        raise InputError(f"frames is {frames}; it must be at least 1")
    answer = answers_in_images(read_recorded(skeleton_path, skeleton_topic), camera)
    truth = load_known_people(truth_path) if truth_path else None
    if truth is not None and truth.is_room and camera is None:
        raise ConfigError(f"{truth_path} is in a room's frame: give the rig file of its cameras, --rig")
    reader = DepthReader(recording_path, depth_topic)
    # in each equal part the frame nearest to its middle, with a skeleton if there is one
    chosen: dict[int, tuple[tuple[bool, float], Panel]] = {}
    start_ns = None
    for i, frame in enumerate(reader):
        start_ns = frame.stamp_ns if start_ns is None else start_ns
        part = i * frames // max(len(reader), i + 1)
        skeletons = answer(frame)
        rank = (not skeletons, abs(i + 0.5 - (part + 0.5) * len(reader) / frames))
        if part not in chosen or rank < chosen[part][0]:
            known = _known(truth, frame, camera)
            chosen[part] = (rank, Panel(frame, skeletons, known, (frame.stamp_ns - start_ns) * 1e-9))
    return [chosen[part][1] for part in sorted(chosen)]


def _known(truth: KnownPeople | None, frame: DepthFrame, camera: PlacedCamera | None) -> NDArray[np.float64]:
    """Return the true joints of the people in the frame, (P, 19, 3)."""
    if truth is None or truth.names != JOINTS:
        return NOBODY
    if truth.is_room and camera is not None:
        joints = camera.to_camera(_at(truth, camera.room_stamp(frame.stamp_ns)))
        return joints[[_is_in_image(each, frame.camera) for each in joints]]
    nearest = int(np.argmin(np.abs(truth.stamps_ns - frame.stamp_ns)))
    near = abs(int(truth.stamps_ns[nearest]) - frame.stamp_ns) <= STAMP_TOLERANCE_NS
    return truth.joints[nearest][truth.visible[nearest] >= WEAK_SHARE] if near else NOBODY


def _at(truth: KnownPeople, stamp_ns: int) -> NDArray[np.float64]:
    """Return the true joints (P, 19, 3) at a time, interpolated between the two frames around it."""
    times = truth.stamps_ns - truth.stamps_ns[0]
    at = float(np.interp(stamp_ns - truth.stamps_ns[0], times, np.arange(len(times))))
    before = int(at)
    joints, after = truth.joints[before], truth.joints[min(before + 1, len(times) - 1)]
    return np.asarray(joints + (at - before) * (after - joints))
