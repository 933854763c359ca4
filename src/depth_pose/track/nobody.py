"""Why nobody is found for a while: the most likely cause, with what to do.

An empty room is no reason for a warning: a cause is named where the images or the detections show one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.config import SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.detect.working_grid import reduce_frame
from depth_pose.io.depth_unit import is_indoors

_FEWEST = 8
"""Consecutive frames without anybody after which a cause is named. Set by hand."""

_FEW_PIXELS = 0.01
"""Least share of pixels with depth; people who were cut out have .06. Set by hand."""

_IN_VIEW = 0.5
"""Least share of a cloud's points in view of the camera. Set by hand."""

_SCATTERED = 0.25
"""Share of the pixels with depth in range that are left on the working grid, below which they are scattered.
Set by hand."""

_NEARLY_ALL = 0.95
"""Share of the pixels with depth that are out of range if all are. Set by hand."""

_ROUGH_M, _SMOOTHER = 0.2, 0.1
"""Median depth step (m) between different neighbours of swapped bytes, of which 1 mm becomes .256 m, and the
share of it that swapping them back leaves. Set by hand."""

_ALL_NEAR_M, _MOSTLY = 1.0, 99.0
"""Depth (m) below which nearly all of an image in centimetres lies that is taken for millimetres, and the
percentile of its depths. Set by hand."""

_SLOPE, _STEEP = 0.08, 0.4
"""Relative change of depth over a stretch of a surface that tells its curvature, least and most. Set by
hand."""

_STRETCHES, _FEWEST_STRETCHES = 24, 0.005
"""Stretches along an image's side, and the least share of its pixels in such a stretch. Set by hand."""

_CURVED = 0.3
"""Median curvature of surfaces below which an image is of inverse depth: 0 there, 1 in depth images. In
recordings depth images have .60 and more. Set by hand."""

_STEP = 4
"""Rows from one to the next in which depths are looked at."""


class NobodyWatch:
    """Finds the most likely cause where frames pass and nobody is found.

    Frames 1, 2, 4, 8 and so on without anybody are looked at, so that it costs nothing over time.

    Parameters
    ----------
    config : SegmentConfig, optional
    """

    def __init__(self, config: SegmentConfig | None = None) -> None:
        self._config = config or SegmentConfig()
        self.reset()

    def reset(self, fewest: int = _FEWEST) -> None:
        """Forget all earlier frames; name a cause after this many frames, 1 for single images."""
        self._fewest = fewest
        self._has_answered = False
        self._rejected: dict[str, int] | None = None
        self._begin()

    def _begin(self) -> None:
        self._frames = self._looks = 0
        self._causes: Counter[str] = Counter()

    def look(
        self, frame: DepthFrame | None, *, is_found: bool, is_answered: bool, rejected: Mapping[str, int]
    ) -> None:
        """Add a frame.

        Parameters
        ----------
        frame : DepthFrame, optional
            None where only its people are known.
        is_found, is_answered : bool
            Whether a person was found in it, and whether one has a pose.
        rejected : mapping of str to int
            Number of detections that were not used so far, by reason (`Perception.rejected_counts`).
        """
        before, self._rejected = self._rejected, dict(rejected)
        new = {r for r, count in rejected.items() if before is not None and count > before.get(r, 0)}
        if is_answered:
            self._has_answered = True
            self._begin()
            return
        self._frames += 1
        if self._frames & (self._frames - 1):
            return
        self._looks += 1
        cause = self._cause_in_image(frame) if frame is not None else ""
        cause = cause or self._cause_in_people(is_found, new)
        if cause:
            self._causes[cause] += 1

    @property
    def cause(self) -> str:
        """Name of the most likely cause; empty where there is none to see."""
        if self._frames < self._fewest or not self._causes:
            return ""
        (cause, count), *_ = self._causes.most_common(1)
        return cause if 2 * count > self._looks else ""

    @property
    def doubt(self) -> str:
        """Why nobody is found, and what to do; empty where there is no cause to see."""
        return f"nobody is found: {self.words[self.cause]}" if self.cause else ""

    def _cause_in_image(self, frame: DepthFrame) -> str:
        """Return the name of what is wrong with the depths; empty if nothing is."""
        if frame.in_view < _IN_VIEW:
            return "axes"
        depth = frame.depth[::_STEP]
        is_set = np.isfinite(depth) & (depth > 0)
        share = is_set.mean() / frame.filled
        if share < _FEW_PIXELS:
            return "few"
        if _is_swapped(depth, is_set):
            return "bytes"
        values = depth[is_set]
        if not is_indoors(float(np.median(values))):
            return "unit"
        if is_inverse(frame.depth):
            return "inverse"
        if (values > self._config.far).mean() > _NEARLY_ALL:
            return "far"
        if (values < self._config.near).mean() > _NEARLY_ALL:
            return "near"
        if np.percentile(values, _MOSTLY) < _ALL_NEAR_M:
            return "centimetres"
        usable = share * ((values >= self._config.near) & (values <= self._config.far)).mean()
        kept = (reduce_frame(frame, self._config)[0] > 0).mean() / frame.filled
        return "scattered" if kept < _SCATTERED * usable else ""

    def _cause_in_people(self, is_found: bool, new: set[str]) -> str:
        """Return the name of why people are not answered; empty if there are none, or some were before."""
        if self._has_answered:
            return ""
        if is_found:
            return "doubtful"
        return next((reason for reason in ("outside the zone", "too near or too far") if reason in new), "")

    @property
    def words(self) -> dict[str, str]:
        """What is said of each cause."""
        c = self._config
        return {
            "few": "less than 1 % of the pixels have depth: the lens may be covered, everything too near or "
            "too far for the sensor, or in the sun",
            "scattered": "the pixels with depth are scattered, and too few lie side by side: fill or filter "
            "the depth at the source",
            "bytes": "the depths look byte-swapped: the images' is_bigendian is wrong",
            "axes": "most points of the cloud lie beside or behind the camera: give one in an optical frame "
            "(x right, y down, z forward) or in a body frame at the sensor (x forward, y left, z up)",
            "unit": "the depths look like another unit: a frame has metres, and the median is not between "
            "0.1 and 10",
            "centimetres": f"everything is nearer than {_ALL_NEAR_M:g} m: the depths may be centimetres that "
            "are taken for millimetres",
            "inverse": "surfaces are curved as in images of inverse depth or disparity: convert it to "
            "depth (baseline x focal length / disparity)",
            "far": f"all depths are beyond segment.far, {c.far:g} m",
            "near": f"all depths are nearer than segment.near, {c.near:g} m: the lens may be covered, or the "
            "depths be centimetres that are taken for millimetres",
            "outside the zone": f"people are seen, but outside segment.zone, {c.zone}",
            "too near or too far": "people are seen, but nearer than segment.near or farther than "
            f"segment.far, {c.near:g} to {c.far:g} m",
            "doubtful": "people are seen, but no pose fits them: most of them may be hidden, or the camera's "
            "intrinsics wrong",
        }


def is_inverse(depth: NDArray[np.float32]) -> bool:
    """Whether an image holds inverse depth.

    Along a line of an image the inverse depth of a plane is linear, and its depth convex: by the square of
    the relative slope, which is the unit of the curvature here.
    """
    found = np.concatenate([_curvatures(depth), _curvatures(depth.T)])
    enough = len(found) >= _FEWEST_STRETCHES * depth.size
    return bool(enough and np.median(found) < _CURVED)


def _curvatures(depth: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the curvature of smooth stretches of columns that are neither flat nor steep."""
    half = max(1, depth.shape[0] // (2 * _STRETCHES))
    if depth.shape[0] <= 4 * half:
        return np.zeros(0)
    last = depth.shape[0] - 4 * half
    five = np.stack([depth[k * half : k * half + last] for k in range(5)]).reshape(5, -1)
    five = five[:, np.isfinite(five).all(axis=0) & (five > 0.0).all(axis=0)].astype(np.float64)
    steps, rise = np.diff(five, axis=0), five[4] - five[0]
    slope = rise / (2.0 * five[2])
    is_smooth = (steps * rise > 0.0).all(axis=0) & (np.abs(steps).max(axis=0) < 0.5 * np.abs(rise))
    used = is_smooth & (np.abs(slope) > _SLOPE) & (np.abs(slope) < _STEEP)
    bow = 0.5 * (five[0] + five[4]) - five[2]
    return np.asarray(bow[used] / five[2][used] / slope[used] ** 2)


def _is_swapped(depth: NDArray[np.float32], is_set: NDArray[np.bool_]) -> bool:
    """Whether swapping the two bytes of the depths' millimetres makes rough surfaces smooth."""
    millimetres = np.rint(1000.0 * np.where(is_set, depth, 0.0))
    if millimetres.max() > np.iinfo(np.uint16).max:
        return False
    steps = np.abs(np.diff(millimetres, axis=1)) / 1000.0
    differs = is_set[:, 1:] & is_set[:, :-1] & (steps > 0.0)
    if not differs.any():
        return False
    back = np.abs(np.diff(millimetres.astype(np.uint16).byteswap() / 1000.0, axis=1))
    rough, smooth = np.median(steps[differs]), np.median(back[differs])
    return bool(rough > _ROUGH_M and smooth < _SMOOTHER * rough)
