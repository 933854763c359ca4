"""The still background: what is known of the room behind a person."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.detect._finder_kernels import CHANNELS, COLS, ROWS, NetImage, fill_features
from depth_pose.detect.background import StillBackground

_STEP_NS = 100_000_000
_CAMERA = Camera(COLS, ROWS, 140.0, 140.0, 79.5, 59.5)
_BODY = np.s_[30:110, 60:90]


def room() -> NDArray[np.float32]:
    """Return a slanted wall, 3 to 4.6 m away."""
    return np.broadcast_to(np.linspace(3.0, 4.6, COLS, dtype=np.float32), (ROWS, COLS)).copy()


def image(depth: NDArray[np.float32]) -> NetImage:
    return NetImage(depth, ROWS, COLS, 1.0, _CAMERA)


def features(depth: NDArray[np.float32], behind: NDArray[np.float32]) -> NDArray[np.float32]:
    out = np.empty((CHANNELS, ROWS, COLS), np.float32)
    sums, counts = np.zeros((ROWS + 1, COLS + 1)), np.zeros((ROWS + 1, COLS + 1), np.int64)
    fill_features(image(depth), behind, sums, counts, out)
    return out


def test_a_first_image_has_no_background() -> None:
    assert not StillBackground().look(image(room()), 0).any()


def test_what_is_dark_or_nearer_than_the_room_shows_in_the_features() -> None:
    background = StillBackground()
    background.look(image(room()), 0)
    seen = room()
    seen[_BODY] = 2.0
    seen[70:110, 60:90] = 0.0  # dark trousers
    behind = background.look(image(seen), _STEP_NS)
    np.testing.assert_array_equal(behind, room())
    out = features(seen, behind)
    is_hole = seen == 0.0
    np.testing.assert_allclose(out[10][is_hole], 1.0 / room()[is_hole], rtol=1e-6)
    assert not out[10][~is_hole].any()
    assert (out[11][30:70, 60:90] > 2.0).all()
    assert (out[11][:20] == -0.5).all()


def test_an_unknown_background_has_no_features() -> None:
    seen = room()
    seen[_BODY] = 0.0
    out = features(seen, np.zeros((ROWS, COLS), np.float32))
    assert not out[10:].any()


def test_what_a_person_hid_is_learned_when_they_step_aside() -> None:
    background = StillBackground()
    first = room()
    first[_BODY] = 2.0
    background.look(image(first), 0)
    background.look(image(room()), _STEP_NS)
    np.testing.assert_array_equal(background.look(image(first), 2 * _STEP_NS), room())


@pytest.mark.parametrize("shift", [8, -8])
def test_a_camera_that_pans_has_no_background(shift: int) -> None:
    wall = room()
    wall[:, 20:60], wall[40:, 100:130] = 2.2, 1.7  # furniture
    background = StillBackground()
    background.look(image(wall), 0)
    assert not background.look(image(np.roll(wall, shift, axis=1)), _STEP_NS).any()


def test_a_camera_that_drives_has_no_background() -> None:
    background = StillBackground()
    background.look(image(room()), 0)
    assert not background.look(image(room() - np.float32(0.4)), _STEP_NS).any()


@pytest.mark.parametrize("later_ns", [-_STEP_NS, 600_000_000])
def test_a_jump_of_the_stamps_forgets_the_view(later_ns: int) -> None:
    background = StillBackground()
    background.look(image(room()), _STEP_NS)
    assert not background.look(image(room()), _STEP_NS + later_ns).any()


def test_furniture_that_was_moved_becomes_background() -> None:
    background = StillBackground()
    background.look(image(room()), 0)
    seen = room()
    seen[_BODY] = 2.0
    behind = room()
    for k in range(1, 650):
        behind = background.look(image(seen), k * _STEP_NS)
    np.testing.assert_array_equal(behind, seen)
