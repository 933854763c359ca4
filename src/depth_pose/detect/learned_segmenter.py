"""Segment all people in a depth image with the learned people finder (the default)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.config import SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.core.labels import BACKGROUND, HIDDEN
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.skeleton import JOINTS
from depth_pose.core.threads import ONE_THREAD, Threads
from depth_pose.detect import working_grid
from depth_pose.detect._border_kernels import mark_at_limbs, mark_nearer
from depth_pose.detect.candidates import CandidateFinder, Candidates
from depth_pose.detect.crop import Crop
from depth_pose.detect.crop_mask import add_and_remove, refuse
from depth_pose.detect.finder import TorsoDetection
from depth_pose.detect.joint_net import QUICK, JointNet, VotingNet
from depth_pose.detect.joint_net_schedule import JointNetSchedule, Look
from depth_pose.detect.mask_propagation import MaskPropagation
from depth_pose.detect.sample_frame import sample_frame
from depth_pose.detect.segmentation import Detection, Segmentation
from depth_pose.detect.tuning import DetectTuning

_ALONE_M = 1.2
"""Distance (m) to others beyond which the joint net's mask corrects a person's pixels. Half or double changes
.1 mm in rooms."""

_STEP_NS = 30_000_000
"""Time between the two frames of the warm-up, nanoseconds: the second is carried over (`MaskPropagation`)."""

_LEG_ENDS = np.array([k for k, name in enumerate(JOINTS) if name.endswith(("knee", "ankle", "foot"))])
"""Lower end of each part of a leg, whose upper end is the joint before it. Arms, too, would cost 2 mm where
people bend down or sit: they are seldom behind furniture."""


class LearnedSegmenter:
    """Finds people in the image, and measures each with the joint net.

    Masks of confident detections are carried over to the next frame without a search (`MaskPropagation`).

    Parameters
    ----------
    config : SegmentConfig
    weights : path, optional
        A folder of nets in place of the packaged ones.
    tuning : DetectTuning
    threads : Threads
        Measure several people.

    Attributes
    ----------
    candidates : CandidateFinder
    joint_net : JointNet
    quick_net : JointNet or None
        For people who were measured well, at a speed that has quick measurements.
    """

    def __init__(
        self,
        config: SegmentConfig,
        weights: Path | None = None,
        tuning: DetectTuning = DetectTuning(),
        threads: Threads = ONE_THREAD,
    ) -> None:
        self.config, self._tuning, self._threads = config, tuning, threads
        self.candidates = CandidateFinder(config, weights, tuning)
        self.joint_net: JointNet = VotingNet(weights, config.mirror)
        self._masks = MaskPropagation(config, tuning)
        self._schedule = JointNetSchedule(tuning.look_every, config.speed)
        self.quick_net: JointNet | None = None
        if self._schedule.pace.has_quick_net:
            self.quick_net = VotingNet(weights, config.mirror, QUICK)
        self.reset()

    def reset(self) -> None:
        """Forget the room."""
        self.candidates.reset()
        self._masks.reset()
        self._schedule.reset()

    def warm_up(self) -> None:
        """Compile every kernel, and load the net."""
        working_grid.warm_up(self.config)
        self.candidates.warm_up()
        frame = sample_frame()
        for k in range(2):  # the first frame is searched, the second carried over
            seen = self.segment(replace(frame, stamp_ns=k * _STEP_NS))
        place = np.array([0.0, 0.0, 3.0])
        crop = Crop(seen.depth, seen.labels, seen.camera, 1, place, 0.5, np.tile(place, (len(JOINTS), 1)))
        for net in filter(None, (self.joint_net, self.quick_net)):
            net.look(crop)  # the window of somebody who was measured well
        self.reset()

    def segment(self, frame: DepthFrame) -> Segmentation:
        """Label every pixel of the working grid."""
        found = self._masks.carry(frame, is_calm=self._schedule.is_calm)
        is_returned = None
        if found is None:
            found, is_returned = self._masks.give_back(self.candidates.find(frame), frame.stamp_ns)
        labels = self.candidates.mark_hidden(found, frame.filled)
        looks = self._schedule.renew(
            found,
            frame.stamp_ns,
            lambda person, expected: self._look_at(person, found, labels, expected),
            self._threads,
        )
        detections = [_detection(p, look) for p, look in zip(found.people, looks, strict=True)]
        sure = tuple(s for s in detections if s.probability >= self._tuning.keep)
        for thing, look in zip(detections, looks, strict=True):
            mask = look.seen.mask
            assert mask is not None, "it was measured in this process"
            if thing.probability < self._tuning.keep:
                labels[labels == thing.label] = BACKGROUND
                continue
            if is_returned is not None:
                refuse(mask, labels, is_returned, found.camera, thing.label)
            if _is_alone(thing, sure):
                add_and_remove(mask, found.depth, labels, found.camera, thing.label)
        self._masks.keep(found, sure, frame.stamp_ns, labels)
        if detections:  # removed pixels may occlude more of a person
            mark_nearer(found.depth, labels, found.camera, self._tuning.depth_jump)
        for person in sure:
            _mark_legs(person.measured, found, labels)
        is_person = (labels != BACKGROUND) & (labels != HIDDEN)
        return Segmentation(
            depth=np.where(is_person, found.depth, np.float32(0)),
            labels=labels,
            camera=found.camera,
            detections=sure,
            out_of_range=found.out_of_range,
            is_still=self.candidates.is_still,
        )

    def _look_at(
        self,
        person: TorsoDetection,
        found: Candidates,
        labels: NDArray[np.uint8],
        expected: NDArray[np.float64] | None,
    ) -> JointMeasurement:
        """Measure a person's joints in a crop around them, with the probability of a person."""
        net = self.joint_net if expected is None or self.quick_net is None else self.quick_net
        return net.look(
            Crop(found.depth, labels, found.camera, person.label, person.torso, person.probability, expected)
        )


def _mark_legs(measured: JointMeasurement | None, found: Candidates, labels: NDArray[np.uint8]) -> None:
    """Label as hidden what may hide a person's measured legs."""
    if measured is not None:
        mark_at_limbs(found.depth, labels, found.camera, _LEG_ENDS, measured.places, measured.sigma)


def _is_alone(person: Detection, people: Sequence[Detection]) -> bool:
    """Check that no other person is so near that the mask might include parts of them."""
    return all(p is person or np.linalg.norm(p.place - person.place) > _ALONE_M for p in people)


def _detection(person: TorsoDetection, look: Look) -> Detection:
    """Return the detection of a person with measured joints."""
    return Detection(person.label, person.torso, look.seen.probability, look.seen, look.is_calm)
