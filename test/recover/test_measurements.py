"""Joints as means of what the fit and the joint net say, by their variances."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.skeleton import JOINTS, MIRROR_JOINTS
from depth_pose.recover.measurements import covariances, weigh_joints

RNG = np.random.default_rng(0)
FITTED = RNG.normal(0.0, 0.4, (len(JOINTS), 3)) + [0.0, 0.0, 3.0]


def found(places, across=0.05, along=0.05):
    count = len(places)
    sigmas = np.tile(np.array([across, along], np.float32), (count, 1))
    confidences = np.full(count, 0.5, np.float32)
    return JointMeasurement(np.asarray(places, np.float32), sigmas, confidences)


SEEN = np.zeros(len(JOINTS), np.uint8)
SURE, EVEN = np.full(len(JOINTS), 1.0), np.full(len(JOINTS), 0.5)


def test_furniture_beside_a_fit_says_nothing_against_it():
    """The disagreement is high, but where body and person overlap they are equally far away."""
    shares = [
        weigh_joints(FITTED, 0.5, SURE, found(FITTED), gap).share.max() for gap in (0.01, 0.03, 0.1, np.inf)
    ]
    assert shares[0] == weigh_joints(FITTED, 0.2, SURE, found(FITTED)).share.max()
    assert shares[0] < shares[1] < shares[2] == shares[3]


def test_a_fit_that_explains_the_depth_is_kept():
    measured = weigh_joints(FITTED, 0.2, SURE, found(FITTED + 0.1))
    assert (measured.share < 0.04).all()
    np.testing.assert_allclose(measured.joints, FITTED, atol=0.004)


@pytest.mark.parametrize(("across", "along"), [(0.03, 0.03), (0.03, 0.2), (0.1, 0.05)])
def test_a_fit_that_explains_nothing_gives_way_by_covariances(across, along):
    """The plain formula, with matrices."""
    proposed = FITTED + [0.1, -0.05, 0.08]
    measured = weigh_joints(FITTED, 0.7, EVEN, found(proposed, across, along))
    of_fit = (0.01**2 + (0.3 * 0.45) ** 2 + 0.07**2) * np.eye(3)
    for fitted, place, joint in zip(FITTED, proposed, measured.joints, strict=True):
        ray = np.outer(place, place) / (place @ place)
        covariance = (across**2 + 0.02**2) * (np.eye(3) - ray) + (along**2 + 0.02**2) * ray
        expected = fitted + of_fit @ np.linalg.inv(of_fit + covariance) @ (place - fitted)
        np.testing.assert_allclose(joint, expected, atol=1e-5)


def test_shares_rise_with_the_score_and_fall_with_deviation_and_confidence():
    shares = [
        weigh_joints(FITTED, score, SURE, found(FITTED, deviation)).share[0, 0]
        for score in (0.3, 0.5, 0.7)
        for deviation in (0.2, 0.05)
    ]
    assert shares[1] > shares[0] and shares[3] > shares[2] and shares[5] > shares[4]
    assert shares[0] < shares[2] < shares[4]
    doubted = weigh_joints(FITTED, 0.3, EVEN, found(FITTED)).share
    assert (doubted > weigh_joints(FITTED, 0.3, SURE, found(FITTED)).share).all()


def test_left_and_right_are_named_as_in_the_fit():
    plain = weigh_joints(FITTED, 0.7, EVEN, found(FITTED + 0.05))
    exchanged = weigh_joints(FITTED, 0.7, EVEN, found((FITTED + 0.05)[MIRROR_JOINTS]))
    np.testing.assert_allclose(exchanged.joints, plain.joints, atol=1e-6)


def test_without_proposals_the_fit_is_all():
    measured = weigh_joints(FITTED, 0.7, EVEN, None)
    assert measured.joints is FITTED
    assert not measured.share.any()


def test_covariances_are_those_of_the_mean():
    """The plain formula, with matrices."""
    proposed = FITTED + [0.1, -0.05, 0.08]
    measured = weigh_joints(FITTED, 0.6, EVEN, found(proposed, 0.04, 0.15))
    of_fit = (0.01**2 + (0.3 * 0.35) ** 2 + 0.07**2) * np.eye(3)
    computed = covariances(proposed, measured.variance, SEEN)
    for place, covariance in zip(proposed, computed, strict=True):
        ray = np.outer(place, place) / (place @ place)
        of_net = (0.04**2 + 0.02**2) * (np.eye(3) - ray) + (0.15**2 + 0.02**2) * ray
        expected = np.linalg.inv(np.linalg.inv(of_fit) + np.linalg.inv(of_net))
        np.testing.assert_allclose(covariance, expected, atol=1e-9)
    alone = covariances(FITTED, weigh_joints(FITTED, 0.6, EVEN, None).variance, SEEN + 1)
    np.testing.assert_allclose(alone, np.broadcast_to(1.4**2 * of_fit, (19, 3, 3)), atol=1e-12)
