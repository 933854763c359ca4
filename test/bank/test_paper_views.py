"""The paper's canonical frames: principal axes of the whole mesh."""

import numpy as np
import pytest

import synthetic as syn
from depth_pose.bank import Bank, build_bank
from depth_pose.bank.build import BuildConfig
from depth_pose.bank.canonical import describe
from depth_pose.bank.views import paper_axes, paper_views, render_views
from depth_pose.core.errors import ConfigError
from depth_pose.motion.procedural.generator import make_clip


@pytest.fixture(scope="module")
def poses():
    return np.concatenate([make_clip(n, 3.0, 3.0, seed=3).rotations for n in ("walk", "reach_around")])


def test_two_proper_frames_and_two_mirror_images(body, poses):
    views = render_views(body, poses[:3], 0, "paper-mirrored")
    assert views.descriptors.shape == (3, 4, 48 * 48)
    np.testing.assert_allclose(np.linalg.det(views.rotations), np.tile([1, 1, -1, -1], (3, 1)), atol=1e-5)
    proper = render_views(body, poses[:3], 0, "paper")
    np.testing.assert_array_equal(proper.descriptors, views.descriptors[:, :2])


def test_frames_are_the_principal_axes(body, poses):
    vertices = body.pose(poses[0], np.zeros(3)).vertices
    spread = np.linalg.svd(vertices - vertices.mean(axis=0), compute_uv=False)
    for view in paper_views(vertices, 0):
        along = (vertices - view.target) @ view.rotation.T
        np.testing.assert_allclose(np.linalg.norm(along, axis=0), spread[[1, 0, 2]], rtol=1e-9)
        assert view.rotation[1] @ [0.0, 1.0, 0.0] < -0.7  # the camera's y points down
    front, back = (v.rotation for v in paper_views(vertices, 0))
    np.testing.assert_allclose(front[[0, 2]], -back[[0, 2]], atol=1e-12)


def test_mirror_image_is_the_other_frame_mirrored(body, poses):
    """Exchanging left and right of the picture turns a proper frame into a mirrored one."""
    views = render_views(body, poses[:4], 0, "paper-mirrored").descriptors.astype(np.float32)
    images = views.reshape(4, 4, 48, 48)
    off = np.abs(images[:, 3] - images[:, 0, :, ::-1]).mean(axis=(1, 2))
    apart = np.abs(images[:, 3] - images[:, 0]).mean(axis=(1, 2))
    assert (off < 0.5 * apart).all()


def test_axes_of_an_input_turn_with_it(body):
    points = body.pose(syn.FACING @ syn.varied(4, 30.0), np.array([0.0, 0.0, 3.0])).vertices
    (axes,) = paper_axes(points)
    assert np.linalg.det(axes.rotation) == pytest.approx(1.0)
    roll = syn.rotation("z", 30.0)
    (turned,) = paper_axes(points @ roll.T)
    image, again = describe(points, axes), describe(points @ roll.T, turned)
    same = np.abs(again - image).mean()
    other = np.abs(again.reshape(48, 48)[:, ::-1] - image.reshape(48, 48)).mean()
    assert same < 1e-3 or other < 0.1  # the second axis has either sign


def test_bank_of_the_papers_views(body, poses, tmp_path):
    bank = build_bank(body, poses, BuildConfig(dimensions=8, views="paper"), {}, workers=0)
    assert bank.views == 2
    bank.save(tmp_path / "paper.npz")
    assert Bank.load(tmp_path / "paper.npz").view_scheme == "paper"


def test_banks_hold_no_mirror_images():
    with pytest.raises(ConfigError, match="paper-mirrored"):
        BuildConfig(views="paper-mirrored")
