"""Per-pixel person labels at sensor resolution, mapped back from the working grid."""

from __future__ import annotations

import re
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.config import MountConfig
from depth_pose.core.mount import rotation_sensor_upright
from depth_pose.core.types import MOST_LABEL, DepthFrame
from depth_pose.track.person_view import FramePeople


def person_number(body_id: str) -> int:
    """Return a person's number in the label image: 7 for ``body_7``, from 1 to `MOST_LABEL`.

    After the last number the numbers repeat from 1.
    """
    digits = re.findall(r"\d+", body_id)
    return (int(digits[-1]) - 1) % MOST_LABEL + 1 if digits else 1


def draw_labels(people: FramePeople, frame: DepthFrame, mount: MountConfig) -> NDArray[np.uint8]:
    """Draw the label image at sensor resolution.

    Parameters
    ----------
    people : FramePeople
        People of this frame, on the upright working grid.
    frame : DepthFrame
        The sensor's original frame.
    mount : MountConfig
        Rotation of the sensor.

    Returns
    -------
    (H, W) uint8
        `person_number` of the person at each pixel; 0 elsewhere, and where the frame has no depth.
    """
    numbers = np.zeros(256, np.uint8)
    for person in people.persons:
        numbers[person.found.label] = person_number(person.body_id)
    cells, inside = _lookup(frame.camera, people.camera, mount.roll)
    labels = numbers[people.labels].ravel()[cells]
    return np.where(inside & (frame.depth > 0.0), labels, np.uint8(0))


@lru_cache(maxsize=4)
def _lookup(camera: Camera, grid: Camera, roll_deg: float) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """Return for each sensor pixel its cell of the working grid, and whether there is one."""
    v, u = np.mgrid[: camera.height, : camera.width]
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy], axis=-1)
    x, y = np.moveaxis(rays @ rotation_sensor_upright(roll_deg)[:2, :2], -1, 0)
    column = np.rint(grid.fx * x + grid.cx).astype(np.int32)
    row = np.rint(grid.fy * y + grid.cy).astype(np.int32)
    inside = (column >= 0) & (column < grid.width) & (row >= 0) & (row < grid.height)
    return np.where(inside, row * grid.width + column, 0), inside
