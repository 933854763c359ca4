"""The people of a frame, prepared once for all steps.

`see_people` builds `FramePeople`, with a `PersonView` of each: the data that matching, fitting and recovery
need. They are the points, and a window of the image from the view of that person, in which nearer people
occlude and farther people are free space.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.rendered_depth import DepthScorer, Observation, nearest_person_pixels
from depth_pose.core.camera import Camera
from depth_pose.core.measurement import NO_PROPOSALS, JointMeasurement, both_namings
from depth_pose.core.medians import median_of
from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.track import _person_kernels as kernels
from depth_pose.track.target import FitTarget
from depth_pose.track.tracked_person import TrackedPerson

MIN_POINTS = 100
"""Least number of points of a person that can be matched; set by hand."""

_MARGIN_M = 0.35
"""Margin of the window around the person (m), where hidden limbs may be."""

_CUT_WIDTH_M = 0.22
"""A cut through a trunk is wider than this (m); one through ankles or shins is narrower."""

_KNEE_M = 0.15
"""A measured knee is visible if a pixel of the person lies this close to it (m); set by hand."""

_KNEES = [JOINT_INDEX["left_knee"], JOINT_INDEX["right_knee"]]

_SIDE_PIXELS = 3
"""A person with more pixels than this in an outermost column may extend beyond the image."""


NO_FLOOR = np.zeros(4)
"""An unknown floor (`FramePeople.floor`)."""


@dataclass(frozen=True)
class PersonView:
    """One person in one frame: what matching, fitting and recovery need, each made once.

    Attributes
    ----------
    stamp_ns : int
    frame_id : str
    found : TrackedPerson
        Id, probability and measured joints.
    camera : Camera
        Camera of the whole working grid.
    points : (N, 3) float64
        The person's points, metres, camera frame.
    full : Observation
        A window around the person.
    is_cut_below : bool
        Whether the legs are invisible: the lower image border cuts the person above them, or
        both knees are occluded.
    is_cut_beside : bool
        Whether the image's left or right border may cut through the person.
    floor : (4,) float64
        As in `FramePeople`.
    """

    stamp_ns: int
    frame_id: str
    found: TrackedPerson
    camera: Camera
    points: NDArray[np.float64]
    full: Observation
    is_cut_below: bool
    is_cut_beside: bool
    floor: NDArray[np.float64]

    @cached_property
    def body_id(self) -> str:
        """Body id of the track."""
        return self.found.body_id

    @cached_property
    def centre(self) -> NDArray[np.float64]:
        """Mean (3,) of the points, metres."""
        return np.asarray(self.points.mean(axis=0))

    @cached_property
    def measured(self) -> JointMeasurement | None:
        """The person's joints, as the joint net measured them; None without."""
        return self.found.measured

    @cached_property
    def coarse(self) -> Observation:
        """The window at half resolution."""
        return self.full.strided(2)

    @cached_property
    def comparer(self) -> DepthScorer:
        """Compares posed bodies with the half-resolution window."""
        return DepthScorer(self.coarse)

    @cached_property
    def _targets(self) -> dict[int, FitTarget]:
        return {}

    @cached_property
    def _thinned(self) -> dict[float, Observation]:
        return {}

    def target(self, most_points: int, *, with_proposals: bool = True) -> FitTarget:
        """Return the data that a body is fitted to, with at most ``most_points`` points."""
        if not self._targets:
            nearest, proposals = nearest_person_pixels(self.full), both_namings(self.measured)
            self._targets[len(self.points)] = FitTarget(
                self.points, self.full, self.coarse, nearest, proposals, self.floor
            )
        count = min(most_points, len(self.points))
        if count not in self._targets:
            whole = self._targets[len(self.points)]
            self._targets[count] = whole._replace(points=thin(self.points, count))
        target = self._targets[count]
        return target if with_proposals else target._replace(proposals=NO_PROPOSALS)

    def thinned(self, spacing_m: float) -> Observation:
        """Return the half-resolution window with at most this pixel spacing at the person, metres."""
        if spacing_m not in self._thinned:
            distance = float(self.points[:, 2].mean())
            self._thinned[spacing_m] = thin_image(self.coarse, distance, spacing_m)
        return self._thinned[spacing_m]


@dataclass(frozen=True)
class FramePeople:
    """All people in one frame, on the working grid of the steps after denoising.

    Attributes
    ----------
    stamp_ns : int
    frame_id : str
    camera : Camera
        Camera of the working grid.
    depth : (h, w) float32
        Denoised depth of people's pixels, metres; 0 elsewhere. No pixels in other processes, which need the
        people alone.
    labels : (h, w) uint8
        Number of the person at each pixel; 0 for free space, `depth_pose.core.labels.HIDDEN` where
        something nearer, or nothing, was measured. No pixels in other processes.
    persons : tuple of PersonView
    floor : (4,) float64
        The floor's normal, upward, and the sensor's height above it, metres; 0 where it is unknown.
    """

    stamp_ns: int
    frame_id: str
    camera: Camera
    depth: NDArray[np.float32]
    labels: NDArray[np.uint8]
    persons: tuple[PersonView, ...]
    floor: NDArray[np.float64]

    @property
    def points(self) -> NDArray[np.float32]:
        """Points (h, w, 3), camera frame, metres; NaN where a pixel belongs to no person."""
        return self.camera.back_project(self.depth)


def see_people(
    stamp_ns: int,
    frame_id: str,
    camera: Camera,
    depth: NDArray[np.float32],
    labels: NDArray[np.uint8],
    found: Iterable[TrackedPerson],
    floor: NDArray[np.float64] = NO_FLOOR,
) -> FramePeople:
    """Prepare all people of a frame that have enough points.

    Parameters
    ----------
    stamp_ns, frame_id, camera, depth, labels, floor
        As in `FramePeople`.
    found : iterable of TrackedPerson
        The people that the labels denote.
    """
    boxes = np.empty((256, 5), np.int64)
    kernels.find_boxes(depth, labels, boxes)
    persons = tuple(
        _see_person(stamp_ns, frame_id, camera, depth, labels, f, floor, boxes[f.label])
        for f in found
        if boxes[f.label, 0] >= MIN_POINTS
    )
    return FramePeople(stamp_ns, frame_id, camera, depth, labels, persons, floor)


def _see_person(
    stamp_ns: int,
    frame_id: str,
    camera: Camera,
    depth: NDArray[np.float32],
    labels: NDArray[np.uint8],
    found: TrackedPerson,
    floor: NDArray[np.float64],
    box: NDArray[np.int64],
) -> PersonView:
    """Prepare one person, whose number of pixels, first and last row and column are ``box``."""
    count, first_row, last_row, first_column, last_column = box.tolist()
    depths = np.empty(count, np.float32)
    margin = round(_MARGIN_M * camera.fx / kernels.take_depths(depth, labels, found.label, box, depths))
    top, left = max(0, first_row - margin), max(0, first_column - margin)
    bottom, right = min(camera.height, last_row + margin + 1), min(camera.width, last_column + margin + 1)
    own = np.empty((bottom - top, right - left), np.uint8)
    window = Observation(
        np.empty(own.shape, np.float32), own, camera.cropped(left, top, right - left, bottom - top)
    )
    distance = float(median_of(depths.astype(np.float64)))
    kernels.cut_window(depth, labels, found.label, distance, top, left, window.depth, own)
    points = np.empty((count, 3))
    kernels.window_points(window.depth, own, camera, top, left, np.inf, points)
    outermost = labels[:, [0, 1, -2, -1]] == found.label
    return PersonView(
        stamp_ns=stamp_ns,
        frame_id=frame_id,
        found=found,
        camera=camera,
        points=points,
        full=window,
        is_cut_below=_is_cut(points[points.shape[0] - int((labels[-1] == found.label).sum()) :])
        or _hides_knees(labels == found.label, camera, found.measured),
        is_cut_beside=int(outermost.sum()) > _SIDE_PIXELS,
        floor=floor,
    )


def _is_cut(lowest: NDArray[np.float64]) -> bool:
    """Check whether the points (N, 3) in the image's last row are as wide as a trunk."""
    return len(lowest) > 0 and bool(np.ptp(lowest[:, 0]) > _CUT_WIDTH_M)


def _hides_knees(own: NDArray[np.bool_], camera: Camera, measured: JointMeasurement | None) -> bool:
    """Check that no pixel of the person lies near the measured knees."""
    if measured is None:
        return False
    for x, y, z in measured.places[_KNEES].tolist():
        if not z > 0.0:
            continue
        u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
        aside, along = _KNEE_M * camera.fx / z, _KNEE_M * camera.fy / z
        top, left = max(0, round(v - along)), max(0, round(u - aside))
        window = own[top : max(0, round(v + along) + 1), left : max(0, round(u + aside) + 1)]
        if window.any():
            return False
    return True


def thin_image(observed: Observation, distance: float, spacing_m: float) -> Observation:
    """Subsample an image to at most this pixel spacing at the person.

    Parameters
    ----------
    observed : Observation
    distance : float
        Distance of the person, metres.
    spacing_m : float
        Metres at the person.
    """
    step = int(spacing_m * observed.camera.fx / distance)
    return observed if step < 2 else observed.strided(step)


def thin(points: NDArray[np.float64], most: int) -> NDArray[np.float64]:
    """Return at most ``most`` points, evenly spread over their order in the image."""
    if len(points) <= most:
        return points
    return points[np.arange(most) * len(points) // most]
