"""Why nobody is found for a while: the most likely cause, with what to do.

An empty room is no reason for a warning: a cause is named where the images or the detections show one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.config import SegmentConfig
from depth_pose.core.types import DepthFrame
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

    def reset(self) -> None:
        """Forget all earlier frames."""
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
        if self._frames < _FEWEST or not self._causes:
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
        if (values > self._config.far).mean() > _NEARLY_ALL:
            return "far"
        if (values < self._config.near).mean() > _NEARLY_ALL:
            return "near"
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
            "far": f"all depths are beyond segment.far, {c.far:g} m",
            "near": f"all depths are nearer than segment.near, {c.near:g} m",
            "outside the zone": f"people are seen, but outside segment.zone, {c.zone}",
            "too near or too far": "people are seen, but nearer than segment.near or farther than "
            f"segment.far, {c.near:g} to {c.far:g} m",
            "doubtful": "people are seen, but no pose fits them: most of them may be hidden, or the camera's "
            "intrinsics wrong",
        }


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
