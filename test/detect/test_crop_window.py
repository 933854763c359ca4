"""The window of a crop around somebody whose joints are expected, and what the net is told of it."""

from __future__ import annotations

import json

import numpy as np
import pytest

import synthetic as syn
from depth_pose.core.measurement import CropView
from depth_pose.core.skeleton import JOINT_NODES
from depth_pose.detect.crop import Crop, CropSample
from depth_pose.detect.crop_window import STRIDE, CropGrid, Window, cells_of, window_around
from depth_pose.detect.joint_net import QUICK, THOROUGH, VotingNet
from depth_pose.detect.net import read_weights

SIDE, CELL_M = 128, 0.02
SETTINGS = json.loads(read_weights(f"{THOROUGH}.json"))
GRID = CropGrid(SIDE, CELL_M, len(SETTINGS["middle"]) // 4, SETTINGS["coarse_cell_m"])
WINDOWS = [Window(0, 112, 32, 96), Window(112, 128, 0, 16), Window(0, 128, 0, 128)]


def around(shown: np.ndarray, *joints: tuple[float, float]) -> Window:
    """Return the window of a crop 2 m away, in whose middle the camera looks."""
    sample = CropSample(CropView(0.0, 0.0, 2.0, CELL_M), shown.astype(np.float32), shown.astype(np.int64))
    return window_around(sample, 1, np.array([[x, y, 2.0] for x, y in joints]))


def test_a_window_holds_pixels_and_joints_with_a_margin() -> None:
    shown = np.zeros((SIDE, SIDE), np.bool_)
    shown[40:90, 50:70] = True
    window = around(shown, (-0.4, 0.0), (0.1, 0.6))
    joints = slice(round(64 + 0.6 / CELL_M)), slice(round(64 - 0.4 / CELL_M), None)
    assert window.top <= 40 - 7 and window.bottom >= joints[0].stop + 7
    assert window.left <= joints[1].start - 7 and window.right >= 70 + 7
    assert (window.bottom - window.top) % STRIDE == (window.right - window.left) % STRIDE == 0
    assert window.bottom - window.top < 94 - 40 + 2 * (8 + STRIDE)


@pytest.mark.parametrize("joints", [[(-9.0, -9.0), (9.0, 9.0)], [(9.0, 9.0)], [(-5.0, 0.0)]])
def test_a_window_stays_in_the_crop(joints: list[tuple[float, float]]) -> None:
    for shown in (np.zeros((SIDE, SIDE), np.bool_), np.ones((SIDE, SIDE), np.bool_)):
        window = around(shown, *joints)
        assert 0 <= window.top < window.bottom <= SIDE and 0 <= window.left < window.right <= SIDE
    assert window == GRID.whole


@pytest.mark.parametrize("window", WINDOWS)
def test_cells_of_a_window_lie_where_its_pixels_do(window: Window) -> None:
    told, pixels = cells_of(GRID, window), (np.arange(SIDE) + 0.5 - SIDE / 2) * CELL_M
    rows, columns = pixels[window.top : window.bottom], pixels[window.left : window.right]
    across, down, deep = told["cells"][0, 0]
    np.testing.assert_allclose(across.reshape(len(rows) // 4, -1)[0], columns.reshape(-1, 4).mean(1))
    np.testing.assert_allclose(down.reshape(len(rows) // 4, -1)[:, 0], rows.reshape(-1, 4).mean(1))
    assert not deep.any()
    coarse = (np.arange(GRID.coarse_cells) + 0.5 - GRID.coarse_cells / 2) * GRID.coarse_cell_m
    for nearest, at in ((told["coarse_rows"], rows), (told["coarse_columns"], columns)):
        assert np.abs(coarse[nearest] - at.reshape(-1, 8).mean(1)).max() <= 0.5 * GRID.coarse_cell_m + 1e-9
    assert list(cells_of(CropGrid(SIDE, CELL_M), window)) == ["cells"]


@pytest.mark.parametrize("name", [THOROUGH, QUICK])
@pytest.mark.parametrize("turn", [0.0, 70.0, 180.0])
def test_a_window_shows_the_net_as_much_as_the_crop(name: str, turn: float) -> None:
    body = syn.posed(syn.arms_down(), distance=2.6, turn=turn)
    depth = syn.to_frame(np.minimum(syn.room(), syn.draw(syn.mesh(body))), noise=0.004).depth
    labels = (np.abs(depth - 2.6) < 0.5).astype(np.uint8)
    crop = Crop(depth, labels, syn.CAMERA, 1, np.array([0.0, 0.2, 2.6]), 0.9)
    net = VotingNet(name=name)
    session, shapes = net.session, []

    class Watched:
        def run(self, outputs, inputs):
            shapes.append(inputs["features"].shape)
            return session.run(outputs, inputs)

    net.session = Watched()
    whole, window = seen = [net.look(crop._replace(expected=e)) for e in (None, body.nodes[JOINT_NODES])]
    assert np.prod(shapes[-1]) < 0.6 * np.prod(shapes[0])
    apart = np.linalg.norm(whole.places - window.places, axis=1)
    assert np.median(apart) < 0.05
    errors = [np.linalg.norm(m.places - body.nodes[JOINT_NODES], axis=1).mean() for m in seen]
    assert errors[1] < errors[0] + 0.015
    assert window.probability > 0.9
    assert window.mask.logits.shape == whole.mask.logits.shape
    assert ((whole.mask.logits > 0) != (window.mask.logits > 0)).mean() < 0.02
