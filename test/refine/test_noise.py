"""Noise that neighbouring points share is measured, and points with much of it count as fewer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import zoom

import synthetic as syn
from depth_pose.body.pose import BodyPose
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.skeleton import JOINT_NODES, JOINTS
from depth_pose.refine.articulated import ArticulatedFitter
from depth_pose.refine.noise import renew_noise, skin_noise
from depth_pose.track.tracked_person import TrackedPerson


def board(noise: np.ndarray):
    """A flat board at 3 m with noise."""
    depth = np.full((144, 176), np.inf)
    depth[30:110, 60:120] = 3.0
    return syn.to_person(depth + noise)


@pytest.mark.parametrize("sigma", [0.01, 0.03])
def test_noise_of_single_pixels_is_not_shared_and_blotches_are(sigma: float) -> None:
    rng = np.random.default_rng(3)
    white = sigma * rng.standard_normal((144, 176))
    blotches = zoom(sigma * rng.standard_normal((24, 22)), (6, 8), order=3)
    blotches *= sigma / blotches.std()
    gap = np.sqrt(2.0 / np.pi) * sigma
    assert skin_noise(board(white), gap) < 0.5 * sigma
    assert skin_noise(board(blotches), gap) == pytest.approx(sigma, rel=0.1)
    both = skin_noise(board(white + blotches), np.sqrt(2.0) * gap)
    assert both == pytest.approx(sigma, rel=0.25)


def test_the_running_mean_begins_with_the_first_frame() -> None:
    assert renew_noise(0.0, 0.03) == 0.03
    assert 0.03 > renew_noise(0.03, 0.01) > 0.02


def test_points_with_shared_noise_count_less_against_measured_joints(body) -> None:
    """A person whose depth is 5 cm off: with more known noise, joints are nearer to the proposals."""
    posed = syn.posed(syn.arms_down(), distance=2.8)
    truth, fitter = posed.nodes[JOINT_NODES], ArticulatedFitter(body)
    sigma = np.full((len(JOINTS), 2), 0.02, np.float32)
    measured = JointMeasurement(truth.astype(np.float32), sigma, np.ones(len(JOINTS), np.float32))
    person = syn.to_person(syn.draw(syn.mesh(posed)) + 0.05)
    target = replace(person, found=TrackedPerson(1, "body_1", 1.0, measured)).target(800)
    start = BodyPose(syn.FACING @ syn.arms_down(), posed.nodes[0], 1.0)
    errors = []
    for noise in (0.0, 0.02, 0.04, 0.06, 0.2):
        pose = fitter.fit(target._replace(noise=noise), start).pose
        fitted = body.pose(pose.rotations, pose.root, pose.scale).nodes[JOINT_NODES]
        errors.append(syn.joint_error(fitted, truth))
    assert errors[0] == errors[1] > errors[2] > errors[3] == errors[4]
