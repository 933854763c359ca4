"""Segment all people in a depth image with the learned people finder (the default)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.config import SegmentConfig
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.types import BACKGROUND, HIDDEN, DepthFrame
from depth_pose.detect import working_grid
from depth_pose.detect._border_kernels import mark_nearer
from depth_pose.detect.beliefs import Beliefs
from depth_pose.detect.candidates import CandidateFinder, Candidates
from depth_pose.detect.crop_mask import add_and_remove, refuse
from depth_pose.detect.finder import Detection
from depth_pose.detect.joint_finder import JointFinder
from depth_pose.detect.last_looks import LastLooks
from depth_pose.detect.last_people import LastPeople
from depth_pose.detect.sample_frame import sample_frame
from depth_pose.detect.segmentation import Segmentation, Sighting

_CHANGE_M, _MOST_CHANGED, _NEWS = 0.15, 0.4, 0.3
"""Depth change (m) of a pixel that shows something new; share of changed pixels above which the camera moved;
share of new pixels above which a person counts as new content. Set by hand; not swept."""

_ALONE_M = 1.2
"""Distance (m) to others beyond which the second look's mask corrects a person's pixels; set by hand."""

_STEP_NS = 30_000_000
"""Time between the two frames of the warm-up, nanoseconds: the second is carried over (`LastPeople`)."""


class LearnedSegmenter:
    """Finds people by two looks: at the image, and at each detection.

    Confident detections are carried over to the next frame without the first look (`LastPeople`).

    Parameters
    ----------
    config : SegmentConfig
    weights : path, optional
        A folder of nets in place of the packaged ones.

    Attributes
    ----------
    candidates : CandidateFinder
        The first look.
    """

    def __init__(self, config: SegmentConfig, weights: Path | None = None) -> None:
        self.config = config
        self.candidates = CandidateFinder(config, weights)
        self._joints = JointFinder(weights, config.mirror)
        self._people = LastPeople(config)
        self._looks = LastLooks(config.look_every)
        self._beliefs = Beliefs(config.sure)
        self.reset()

    def reset(self) -> None:
        """Forget the room."""
        self.candidates.reset()
        self._people.reset()
        self._looks.reset()
        self._beliefs.reset()
        self._before = np.zeros((0, 0), np.float32)

    def warm_up(self) -> None:
        """Compile every kernel, and load the net."""
        working_grid.warm_up(self.config)
        frame = sample_frame()
        for k in range(2):  # searched, and carried over
            self.segment(replace(frame, stamp_ns=k * _STEP_NS))
        self.reset()

    def segment(self, frame: DepthFrame) -> Segmentation:
        """Label every pixel of the working grid."""
        found = self._people.carry(frame)
        is_returned = None
        if found is None:
            found, is_returned = self._people.give_back(self.candidates.find(frame), frame.stamp_ns)
        labels = self.candidates.mark_hidden(found, frame.filled)
        news = self._news(found.depth)
        seen = self._looks.renew(found.people, frame.stamp_ns, lambda p: self._look_closer(found, labels, p))
        sightings = [
            _sighting(person, looked, labels, news) for person, looked in zip(found.people, seen, strict=True)
        ]
        sightings = self._beliefs.renew(sightings, labels, found.depth, frame.stamp_ns)
        sure = tuple(s for s in sightings if s.probability >= self.config.keep)
        for thing, looked in zip(sightings, seen, strict=True):
            mask = looked.mask
            assert mask is not None, "it was measured in this process"
            if thing.probability < self.config.keep:
                labels[labels == thing.label] = BACKGROUND
                continue
            if is_returned is not None:
                refuse(mask, labels, is_returned, found.camera, thing.label)
            if _is_alone(thing, sure):
                add_and_remove(mask, found.depth, labels, found.camera, thing.label)
        self._people.keep(found, sure, frame.stamp_ns, labels)
        if sightings:  # removed pixels may occlude more of a person
            mark_nearer(found.depth, labels, found.camera, self.config.depth_jump)
        is_person = (labels != BACKGROUND) & (labels != HIDDEN)
        return Segmentation(
            depth=np.where(is_person, found.depth, np.float32(0)),
            labels=labels,
            camera=found.camera,
            sightings=sure,
            out_of_range=found.out_of_range,
        )

    def _news(self, depth: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Find the pixels that are nearer than in the previous frame; none if the view changed."""
        before, self._before = self._before, depth
        if before.shape != depth.shape:
            return np.zeros(depth.shape, np.bool_)
        known = (before > 0) & (depth > 0)
        changed = known & (np.abs(before - depth) > _CHANGE_M)
        is_another_view = changed.sum() > _MOST_CHANGED * known.sum()
        return changed & (depth < before) & ~is_another_view

    def _look_closer(
        self, found: Candidates, labels: NDArray[np.uint8], person: Detection
    ) -> JointMeasurement:
        """Propose a person's joints from a crop around them, and compute the probability of a person."""
        return self._joints.find(
            found.depth, labels, found.camera, person.label, person.torso, person.probability
        )


def _is_alone(person: Sighting, people: Sequence[Sighting]) -> bool:
    """Check that no other person is so near that the mask might include parts of them."""
    return all(p is person or np.linalg.norm(p.place - person.place) > _ALONE_M for p in people)


def _sighting(
    person: Detection, measured: JointMeasurement, labels: NDArray[np.uint8], news: NDArray[np.bool_]
) -> Sighting:
    """Return the detection of a person with measured joints."""
    own = labels == person.label
    return Sighting(
        label=person.label,
        place=person.torso,
        probability=measured.probability,
        measured=measured,
        is_new_content=bool(np.count_nonzero(news & own) > _NEWS * np.count_nonzero(own)),
    )
