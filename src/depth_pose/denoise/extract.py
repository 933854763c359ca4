"""People extraction: detect and denoise the points of all people in a depth image (Sec. 4)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np

from depth_pose.core.camera import Camera
from depth_pose.core.config import DenoiseConfig, MatchConfig, MountConfig, SegmentConfig
from depth_pose.core.mount import rotation_sensor_upright, up_direction
from depth_pose.core.stamps import StampGuard
from depth_pose.core.types import HIDDEN, DepthFrame, TrackedPerson
from depth_pose.core.zone import parse_zone
from depth_pose.denoise.denoise import denoise_depth
from depth_pose.detect.floor import FloorFinder
from depth_pose.detect.learned_segmenter import LearnedSegmenter
from depth_pose.detect.plane_segmenter import PlaneSegmenter
from depth_pose.detect.sample_frame import sample_frame
from depth_pose.detect.segmentation import Detection, Segmenter
from depth_pose.track.choice import PeopleChoice
from depth_pose.track.person_view import MIN_POINTS, NO_FLOOR, FramePeople, see_people
from depth_pose.track.tracks import PeopleTracks

_FLOOR_EVERY_NS = 1_000_000_000
"""Time from one search for the floor to the next (ns); set by hand."""

_METHODS: dict[str, Callable[[SegmentConfig], Segmenter]] = {
    "learned": LearnedSegmenter,
    "planes": PlaneSegmenter,
}


class PeopleExtractor:
    """The first stage of the pipeline, run by `denoise_node`.

    Parameters
    ----------
    segment, denoise
        Settings.
    mount : MountConfig
        Orientation of the frames, which are upright here, in the sensor; the zone is in the sensor's frame.
    match : MatchConfig
        With method ``exemplars`` the second look's joints are withheld from all later stages.

    Attributes
    ----------
    segmenter : Segmenter
        Detects people, and keeps its state from frame to frame.
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
        mount: MountConfig = MountConfig(),  # noqa: B008
        match: MatchConfig = MatchConfig(),  # noqa: B008
    ) -> None:
        self._with_joints = match.method == "joints"
        self.segmenter: Segmenter = _METHODS[segment.method](segment)
        self._denoise = denoise
        self._tracks = PeopleTracks(segment.start, segment.sure, segment.keep)
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
        self._tracks.reset()
        self.choice.reset()
        self.floor_finder.reset()
        self._searched_ns = None

    def restart(self) -> None:
        """Forget all tracks and ids, as if new."""
        self.reset()
        self._tracks.restart()
        self.rejected_counts.clear()

    def warm_up(self) -> None:
        """Compile every kernel."""
        self.segmenter.warm_up()
        self.floor_finder.find(sample_frame())
        self.floor_finder.reset()
        camera = Camera(64, 48, 60.0, 60.0, 31.5, 23.5)
        depth = denoise_depth(np.full((48, 64), 2.0, np.float32), camera, self._denoise)
        found = TrackedPerson(1, "", 1.0)
        see_people(0, "", camera, camera.back_project(depth), np.ones((48, 64), np.uint8), [found])

    def extract(self, frame: DepthFrame) -> FramePeople:
        """Detect people, assign ids, select among them, and denoise their points.

        Denoising computes depths; x and y follow along each pixel's ray (Ye et al. eqs. 2 and 4).
        """
        if self._guard.is_break(frame.stamp_ns):
            self.reset()
        seen = self.segmenter.segment(frame)
        depth = denoise_depth(seen.depth, seen.camera, self._denoise)
        labels = np.where((seen.depth > 0) & (depth <= 0), np.uint8(HIDDEN), seen.labels)
        names = self._tracks.assign(seen.detections, frame.stamp_ns)
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
        found = [
            self._found(s, name) for s, name in zip(seen.detections, chosen, strict=True) if name is not None
        ]
        # Ye et al. eq. 2: x and y follow the depth along the pixel's ray
        # Ye et al. eq. 4: also in further iterations, if `denoise.iterations` is above 1
        points = seen.camera.back_project(depth)
        if self._searched_ns is None or frame.stamp_ns - self._searched_ns >= _FLOOR_EVERY_NS:
            self._searched_ns = frame.stamp_ns
            self.floor_finder.update(frame, [points[labels == person.label] for person in found])
        floor = self.floor_finder.floor
        plane = NO_FLOOR if floor is None else floor.plane
        return see_people(frame.stamp_ns, frame.frame_id, seen.camera, points, labels, found, plane)

    def _found(self, seen: Detection, name: str) -> TrackedPerson:
        """Return a detection with its id, and without measured joints where they are not wanted."""
        measured = seen.measured if self._with_joints else None
        return TrackedPerson(seen.label, name, self._tracks.probability(name), measured)
