"""Segmentation of one person in a depth image (Sec. 4, first paragraph).

The paper cuts with two fixed distances. Here nothing is set per recording. After generous distance limits,
large planes (walls, floor) are removed, the rest is split into surfaces, and the largest one of a person's
size is kept together with the smaller ones that touch it (a hand in front of the trunk is a separate
surface). Finally a pixel is kept only if enough of its neighbours are on its surface, which removes the
flying pixels at edges.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.config import SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.core.labels import BACKGROUND, HIDDEN, PERSON
from depth_pose.detect import _surface_kernels as kernels
from depth_pose.detect._border_kernels import mark_unsupported
from depth_pose.detect.planes import PlaneFinder
from depth_pose.detect.segmentation import Detection, Segmentation
from depth_pose.detect.tuning import DetectTuning
from depth_pose.detect.working_grid import reduce_frame
from depth_pose.detect.working_grid import warm_up as warm_up_grid

_BOX_FILL = 0.95
"""Maximum filled share of a person's bounding box; a curtain or a cupboard fills more."""

_SMALL_PIXELS = 6
"""Least number of pixels of a surface; smaller ones are flying pixels."""

_PERSON_AREA_M2 = (0.04, 2.5)
"""Least and greatest visible area of a person (m^2); set by hand."""
_PERSON_EXTENT_M = 2.6
"""Maximum extent of a person's box on any side (m); set by hand."""


_FOLLOW, _FOLLOW_M = 5.0, 0.25
"""Bonus of the surface at the person's last place, and depth difference (m) at which it ends."""

_KNOWN = 0.8
"""Least share of a surface's box inside the person's last box, for a part of the person."""


class PlaneSegmenter:
    """Finds one person; remembers the last place, to stay with the person."""

    def __init__(self, config: SegmentConfig, tuning: DetectTuning = DetectTuning()) -> None:
        self._tuning = tuning
        self.config = config
        self._planes = PlaneFinder()
        self._last_box: NDArray[np.float64] | None = None

    def reset(self) -> None:
        """Forget the person and the room."""
        self._planes.reset()
        self._last_box = None

    def warm_up(self) -> None:
        """Compile every kernel."""
        depth = np.full((48, 64), 3.0, np.float32)
        depth[8:40, 20:44] = 2.0
        PlaneSegmenter(self.config).segment(DepthFrame(0, "", depth, Camera(64, 48, 60.0, 60.0, 31.5, 23.5)))
        warm_up_grid(self.config)

    def segment(self, frame: DepthFrame) -> Segmentation:
        """Label every pixel of the working grid.

        Parameters
        ----------
        frame : DepthFrame

        Returns
        -------
        Segmentation
            Without `PERSON` pixels if nothing of a person's size is in view.
        """
        config = self.config
        depth, camera = reduce_frame(frame, config)
        points = camera.back_project(depth)

        planes = self._planes.mark(points, camera)
        foreground = (depth > 0) & ~planes
        person = self._find_person(depth, points, foreground, camera)
        own = person.astype(np.uint8)
        mark_unsupported(depth, own, self._tuning.depth_jump, self._tuning.min_support)
        person = own == PERSON

        labels = np.full(depth.shape, BACKGROUND, np.uint8)
        if person.any():
            nearer = foreground & (depth < np.median(depth[person]))
            labels[nearer] = HIDDEN
            missing = depth == 0
            if missing.mean() < 1.0 - 0.5 * frame.filled:  # otherwise the recording's background was removed
                labels[missing] = HIDDEN
            labels[person] = PERSON
            kernels.mark_mixed(depth, labels, PERSON, HIDDEN, 2.0 * self._tuning.depth_jump)
        return Segmentation(
            depth=np.where(person, depth, np.float32(0)),
            labels=labels,
            camera=camera,
            detections=_detections_of(points[person]),
        )

    def _find_person(
        self,
        depth: NDArray[np.float32],
        points: NDArray[np.float32],
        foreground: NDArray[np.bool_],
        camera: Camera,
    ) -> NDArray[np.bool_]:
        """Choose the surfaces that belong to the person."""
        labels, count = kernels.label_components(depth, foreground, self._tuning.depth_jump)
        if count == 0:
            self._last_box = None
            return np.zeros(depth.shape, np.bool_)
        stats = kernels.component_boxes(points, labels, count, camera.fx)
        area, low, high = stats[:, 0], stats[:, 1:4], stats[:, 4:7]
        extent = high - low
        fits = (
            (area >= _PERSON_AREA_M2[0])
            & (area <= _PERSON_AREA_M2[1])
            & (extent.max(axis=1) >= self._tuning.min_height)
            & (extent.max(axis=1) <= _PERSON_EXTENT_M)
        )
        if not fits.any():
            self._last_box = None
            return np.zeros(depth.shape, np.bool_)
        rank = np.where(fits, area, 0.0) * np.clip((_BOX_FILL - stats[:, 8]) / 0.3, 0.05, 1.0)
        if self._last_box is not None:
            same = _overlap(low[:, :2], high[:, :2], self._last_box[[0, 1, 3, 4]])
            gap = np.maximum(low[:, 2] - self._last_box[5], self._last_box[2] - high[:, 2])
            same = same * np.clip(1.0 - gap / _FOLLOW_M, 0.0, 1.0)
            rank = rank * (1.0 + _FOLLOW * same)
        seed = int(np.argmax(rank))

        small = np.append(True, stats[:, 7] < _SMALL_PIXELS)
        chosen = np.zeros(count + 1, np.bool_)
        chosen[seed + 1] = True
        box = np.concatenate([low[seed], high[seed]])
        reach = max(2, round(0.06 * camera.fx / float(np.median(depth[labels == seed + 1]))))
        for _ in range(3):
            touching = kernels.touching_components(depth, labels, chosen, small, reach, 0.5)
            grown = False
            for k in np.flatnonzero(touching[1:]):
                union = np.concatenate([np.minimum(box[:3], low[k]), np.maximum(box[3:], high[k])])
                # beside the person and away from the last place, only surfaces up to half the size belong to
                # the person
                beside = _overlap(low[k : k + 1, :1], high[k : k + 1, :1], box[[0, 3]])[0] < 0.5
                known = self._last_box is not None and _share_inside(low[k], high[k], self._last_box) > _KNOWN
                most = area[seed] * (0.5 if beside and not known else 1.2)
                if area[k] <= most and (union[3:] - union[:3]).max() <= _PERSON_EXTENT_M:
                    chosen[k + 1] = True
                    box, grown = union, True
            if not grown:
                break
        self._last_box = box
        return chosen[labels]


def _detections_of(points: NDArray[np.float32]) -> tuple[Detection, ...]:
    """Build the detection of the person with these points (N, 3); none without points."""
    if len(points) == 0:
        return ()
    place = np.median(points.astype(np.float64), axis=0)
    return (Detection(PERSON, place, 1.0),)


def _share_inside(low: NDArray[np.float64], high: NDArray[np.float64], box: NDArray[np.float64]) -> float:
    """Compute the share of one box (3,), (3,) that lies inside another (6,)."""
    side = np.minimum(high, box[3:]) - np.maximum(low, box[:3])
    return float(np.prod(np.clip(side / np.maximum(high - low, 1e-3), 0.0, 1.0)))


def _overlap(
    low: NDArray[np.float64], high: NDArray[np.float64], box: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Compute the overlap of many (n, d) boxes with one (2 d,), as a share of the smaller."""
    d = low.shape[1]
    side = np.minimum(high, box[d:]) - np.maximum(low, box[:d])
    whole = np.maximum(np.minimum(high - low, box[d:] - box[:d]), 1e-3)
    return np.asarray(np.prod(np.clip(side / whole, 0.0, 1.0), axis=1))
