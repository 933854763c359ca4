"""A person of whom the joint net cannot tell left from right, before a sensor with much noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from acted import frame_of, posed, the_bank
from depth_pose.core.config import PersonalConfig, PipelineConfig, SmoothConfig
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.skeleton import JOINTS, NODE_INDEX
from depth_pose.pipeline import FrameResult, PosePipeline
from depth_pose.track.person_view import FramePeople

CONFIG = PipelineConfig(build=PersonalConfig(scale=1.0), smooth=SmoothConfig(enabled=False))

NOISE_M = 0.05
"""Deviation of the depth: then the body agrees almost as well with its front where its back should be."""


def see(noise_m: float = NOISE_M) -> FrameResult:
    frame = frame_of(0)
    noise = np.random.default_rng(0).normal(0.0, noise_m, frame.depth.shape)
    noisy = replace(frame, depth=frame.depth + noise.astype(np.float32))
    return PosePipeline(the_bank(), CONFIG).process_frame(noisy)


def doubted(seen: FrameResult, sides: float) -> FramePeople:
    """The person as seen, with left and right named with a probability."""
    (person,) = seen.people.persons
    measured = JointMeasurement(
        places=posed(0).nodes[[NODE_INDEX[name] for name in JOINTS]].astype(np.float32),
        sigma=np.full((len(JOINTS), 2), 0.05, np.float32),
        confidence=np.full(len(JOINTS), 0.9, np.float32),
        sides=sides,
    )
    found = replace(person.found, measured=measured)
    return replace(seen.people, persons=(replace(person, found=found),))
