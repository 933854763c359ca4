"""Detect, identify, cut out and denoise everybody in a depth image (Sec. 4), for all later steps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.config import DenoiseConfig, MountConfig, SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.core.labels import HIDDEN
from depth_pose.core.mount import rotation_sensor_upright, up_direction
from depth_pose.core.stamps import StampGuard, StampStep
from depth_pose.core.threads import ONE_THREAD, Threads
from depth_pose.core.zone import parse_zone
from depth_pose.denoise.denoise import denoise_depth
from depth_pose.denoise.tuning import DenoiseTuning
from depth_pose.detect.floor import FloorFinder
from depth_pose.detect.learned_segmenter import LearnedSegmenter
from depth_pose.detect.plane_segmenter import PlaneSegmenter
from depth_pose.detect.sample_frame import sample_frame
from depth_pose.detect.segmentation import Segmentation, Segmenter
from depth_pose.detect.tuning import DetectTuning
from depth_pose.track.choice import PeopleChoice
from depth_pose.track.person_view import MIN_POINTS, NO_FLOOR, FramePeople, see_people
from depth_pose.track.tracked_person import TrackedPerson
from depth_pose.track.tracks import PeopleTracks

_FLOOR_EVERY_NS = 1_000_000_000
"""Time from one search for the floor to the next (ns)."""

_METHODS: dict[str, Callable[..., Segmenter]] = {
    "learned": lambda config, tuning, threads: LearnedSegmenter(config, tuning=tuning, threads=threads),
    "planes": lambda config, tuning, _: PlaneSegmenter(config, tuning),
}


class Perception:
    """The first stage of the pipeline, run by `denoise_node`: finder, joint net, tracks, denoising, floor.

    Parameters
    ----------
    segment, denoise
        Settings.
    mount : MountConfig
        Orientation of the frames, which are upright here, in the sensor; the zone is in the sensor's frame.
    with_joints : bool
        Whether later stages receive the measured joints (`match.method` ``joints``).
    detect_tuning, denoise_tuning
        Constants.
    threads : Threads
        Measure several people.

    Attributes
    ----------
    segmenter : Segmenter
        Detects people, and keeps its state from frame to frame.
    tracks : PeopleTracks
    choice : PeopleChoice
    floor_finder : FloorFinder
        Searches every second, and holds the floor.
    rejected_counts : Counter of str
        Number of detections not used, over all frames: ``too near or too far``, ``not sure enough``,
        ``too few points``, and the exclusions by `PeopleChoice`.
    """

    def __init__(
        self,
        segment: SegmentConfig,
        denoise: DenoiseConfig,
        mount: MountConfig = MountConfig(),
        with_joints: bool = True,
        detect_tuning: DetectTuning = DetectTuning(),
        denoise_tuning: DenoiseTuning = DenoiseTuning(),
        threads: Threads = ONE_THREAD,
    ) -> None:
        self._with_joints = with_joints
        self.segmenter: Segmenter = _METHODS[segment.method](segment, detect_tuning, threads)
        self._denoise = denoise, denoise_tuning
        self.tracks = PeopleTracks()
        self.choice = PeopleChoice(
            parse_zone(segment.zone), segment.most_people, rotation_sensor_upright(mount.roll)
        )
        self.floor_finder = FloorFinder(segment, up_direction(mount))
        self._searched_ns: int | None = None
        self._guard = StampGuard()
        self.rejected_counts: Counter[str] = Counter()

    def reset(self) -> None:
        """Forget all tracks."""
        self.segmenter.reset()
        self.tracks.reset()
        self.choice.reset()
        self.floor_finder.reset()
        self._searched_ns = None

    def restart(self) -> None:
        """Forget all tracks and ids, as if new."""
        self.reset()
        self.tracks.restart()
        self.rejected_counts.clear()

    def warm_up(self) -> None:
        """Compile every kernel."""
        self.segmenter.warm_up()
        self.floor_finder.find(sample_frame())
        self.floor_finder.reset()
        camera = Camera(64, 48, 60.0, 60.0, 31.5, 23.5)
        depth = denoise_depth(np.full((48, 64), 2.0, np.float32), camera, *self._denoise)
        found = TrackedPerson(1, "", 1.0)
        see_people(0, "", camera, depth, np.ones((48, 64), np.uint8), [found])

    def perceive(self, frame: DepthFrame) -> FramePeople:
        """Find people, denoise their points, assign ids, select among them, and prepare a view of each."""
        step = self._guard.step(frame.stamp_ns)
        if step is StampStep.BREAK:
            self.reset()
        elif step is StampStep.SILENCE:
            self.segmenter.reset()
        seen = self.segmenter.segment(frame)
        depth = denoise_depth(seen.depth, seen.camera, *self._denoise)
        labels = np.where((seen.depth > 0) & ~(depth > 0), np.uint8(HIDDEN), seen.labels)
        people = self._name(seen, labels, frame.stamp_ns)
        if self._is_floor_due(frame.stamp_ns):
            points = seen.camera.back_project(depth)
            self.floor_finder.update(frame, [points[labels == person.label] for person in people])
        floor = NO_FLOOR if self.floor_finder.floor is None else self.floor_finder.floor.plane
        return see_people(frame.stamp_ns, frame.frame_id, seen.camera, depth, labels, people, floor)

    def _name(self, seen: Segmentation, labels: NDArray[np.uint8], stamp_ns: int) -> list[TrackedPerson]:
        """Return the chosen people with their ids; count the others."""
        names = self.tracks.assign(seen.detections, stamp_ns, seen.is_still)
        points_of = np.bincount(labels.ravel(), minlength=HIDDEN + 1)
        shown = [
            name if points_of[s.label] >= MIN_POINTS else None
            for s, name in zip(seen.detections, names, strict=True)
        ]
        chosen = self.choice.choose(shown, [s.place for s in seen.detections])
        self.rejected_counts["too near or too far"] += seen.out_of_range
        self.rejected_counts["not sure enough"] += names.count(None)
        self.rejected_counts["too few points"] += shown.count(None) - names.count(None)
        self.rejected_counts.update(self.choice.left_out)
        return [
            TrackedPerson(
                s.label,
                name,
                self.tracks.probability(name),
                s.measured if self._with_joints else None,
                s.is_calm,
            )
            for s, name in zip(seen.detections, chosen, strict=True)
            if name is not None
        ]

    def _is_floor_due(self, stamp_ns: int) -> bool:
        """Check whether the floor is searched in this frame: once a second."""
        if self._searched_ns is not None and stamp_ns - self._searched_ns < _FLOOR_EVERY_NS:
            return False
        self._searched_ns = stamp_ns
        return True
