"""Skeletons of people far from the axis of a wide, distorting lens."""

from __future__ import annotations

import numpy as np

import synthetic as syn
from calibrations import AZURE
from depth_pose.core.camera import Camera, Lens
from depth_pose.core.distortion import OPENCV
from depth_pose.pipeline import PosePipeline
from wide_scene import lens_frame

WFOV = Lens(Camera(512, 512, 252.0, 252.0, 255.5, 255.5), OPENCV, AZURE)
"""Wide field of view of an Azure Kinect, binned; its view is a cone of 120 degrees."""


def test_a_person_far_from_the_axis_is_where_they_are(bank) -> None:
    pipeline, errors = PosePipeline(bank), []
    for i in range(4):
        frame, joints = lens_frame(50.0, 2.5, 4.0 * i, WFOV, 120.0, syn.START_NS + i * syn.STEP_NS)
        skeletons = pipeline.process_frame(frame).skeletons
        assert len(skeletons) == 1
        errors.append(np.linalg.norm(skeletons[0].positions - joints, axis=1).mean())
    assert np.mean(errors) < 0.04
