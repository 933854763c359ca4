"""One measurement of a person's joints: both namings, motion, and what leaves the process."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from depth_pose.core.measurement import NO_PROPOSALS, CropMask, CropView, JointMeasurement, both_namings
from depth_pose.core.odds import logistic, logit
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES, NODES

STILL = np.zeros(3)


@pytest.fixture
def measured():
    rng = np.random.default_rng(3)
    places, sigma, confidence, heels = (
        rng.random(shape).astype(np.float32) for shape in ((19, 3), (19, 2), 19, (2, 5))
    )
    mask = CropMask(np.zeros((8, 8), np.float32), CropView(0.1, 0.2, 3.0, 0.02))
    told = {"left_right_confidence": 0.8, "probability": 0.9}
    return JointMeasurement(places, sigma, confidence, heels, mask=mask, **told)


def test_both_namings_are_made_once_and_differ_by_the_sides(measured):
    both = measured.both
    assert measured.both is both
    left, right = JOINT_INDEX["left_knee"], JOINT_INDEX["right_knee"]
    np.testing.assert_array_equal(both.places[0], measured.places)
    np.testing.assert_array_equal(both.places[1, left], measured.places[right])
    np.testing.assert_array_equal(both.sigmas[1, right], measured.sigma[left])
    np.testing.assert_array_equal(both.weights[1, left], measured.confidence[right])
    np.testing.assert_array_equal(both.heels[1], measured.heels[::-1])
    assert [NODES[n] for n in both.nodes[[left, right]]] == ["left_knee", "right_knee"]
    assert both.nodes.tolist() == JOINT_NODES.tolist()


def test_without_a_measurement_the_namings_are_empty():
    assert both_namings(None) is NO_PROPOSALS
    assert len(NO_PROPOSALS.nodes) == 0


def test_moved_joints_are_less_exact_and_the_mask_goes_along(measured):
    by = np.array([0.1, -0.2, 0.3])
    moved = measured.moved(by, 0.05)
    np.testing.assert_allclose(moved.places, measured.places + by, atol=1e-6)
    np.testing.assert_allclose(moved.heels[:, :3], measured.heels[:, :3] + by, atol=1e-6)
    np.testing.assert_allclose(moved.sigma**2, measured.sigma**2 + 0.05**2, atol=1e-6)
    assert moved.mask.view[:3] == pytest.approx((0.2, 0.0, 3.3))
    assert moved.places.dtype == moved.sigma.dtype == moved.heels.dtype == np.float32
    assert (moved.left_right_confidence, moved.probability) == (0.8, 0.9)
    assert replace(moved, mask=None).moved(STILL, 0.0).mask is None


@pytest.mark.parametrize("name", ["places", "sigma", "confidence"])
def test_another_number_of_joints_is_refused(measured, name):
    parts = {n: getattr(measured, n) for n in ("places", "sigma", "confidence")}
    with pytest.raises(ValueError, match=name):
        JointMeasurement(**(parts | {name: parts[name][:5]}))


def test_log_odds_and_probabilities():
    for p in (0.001, 0.3, 0.5, 0.999):
        assert logistic(logit(p)) == pytest.approx(p)
    assert logit(0.0) == pytest.approx(-logit(1.0))
    assert logit(0.0) == pytest.approx(np.log(1e-4 / (1.0 - 1e-4)))
    np.testing.assert_allclose(logistic(np.array([-50.0, 0.0, 50.0])), [0.0, 0.5, 1.0], atol=1e-12)
