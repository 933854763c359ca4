"""The bank that comes with the package is what its command makes of today's sources.

Where these tests fail after a change of the body, the poses or the views, make it again:
``depth-pose bank build -o src/depth_pose/bank/data/default_bank.npz``.
"""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.bank import Bank, default_bank_path
from depth_pose.bank.build import BuildConfig, Subspace, project
from depth_pose.bank.sources import gather_poses
from depth_pose.bank.views import render_views
from depth_pose.core.rotations import matrix_to_quat

MOST_MB = 12.0


@pytest.fixture(scope="module")
def packaged():
    """The packaged bank, whatever ``$DEPTH_POSE_BANK`` says."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("DEPTH_POSE_BANK", raising=False)
        path = default_bank_path()
    assert path.stat().st_size < 1e6 * MOST_MB
    return Bank.load(path)


def test_body_and_size(packaged, body):
    assert packaged.body.content_hash() == body.content_hash()
    config = BuildConfig()
    assert packaged.coefficients.shape == (config.poses, 16, config.dimensions)
    assert packaged.source["body"] == "embedded"
    assert packaged.view_scheme == config.views


def test_views_are_those_of_its_poses(packaged):
    subspace = Subspace(packaged.mean, packaged.components)
    half_a_step = np.abs(packaged.coefficients).max(axis=(0, 1)) / 254
    for number in (0, 4321, 9999):
        views = render_views(packaged.body, packaged.rotations(number)[None], number)
        again = project(views.descriptors, subspace)[0]
        off = np.abs(again - packaged.coefficients[number])
        # a ray that just misses an edge moves a descriptor a little, on another processor
        assert np.mean(off < half_a_step + 2e-3) > 0.99
        assert off.max() < 0.5
        np.testing.assert_allclose(views.origins[0], packaged.view_origins[number], atol=2e-3)


@pytest.mark.slow
def test_poses_are_those_of_the_embedded_source(packaged):
    config = BuildConfig()
    made = gather_poses(None, config.seed, embedded_count=config.poses)
    assert packaged.source.items() >= made.header.items()
    quats = matrix_to_quat(made.poses.rotations)
    assert np.abs(np.sum(quats * packaged.pose_quats, axis=-1)).min() > 0.9999
