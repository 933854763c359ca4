"""Whose each pixel of the sensor's own image is: people's labels, brought back from the working grid."""

from __future__ import annotations

import re
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.config import MountConfig
from depth_pose.core.mount import rotation_sensor_upright
from depth_pose.core.types import MOST_LABEL, DepthFrame
from depth_pose.track.person import People


def person_number(body_id: str) -> int:
    """Give the number that stands for somebody in a label image: 7 for ``body_7``, 1 to `MOST_LABEL`.

    After the last number the first comes again.
    """
    digits = re.findall(r"\d+", body_id)
    return (int(digits[-1]) - 1) % MOST_LABEL + 1 if digits else 1


def draw_labels(people: People, frame: DepthFrame, mount: MountConfig) -> NDArray[np.uint8]:
    """Draw who is where in the sensor's image.

    Parameters
    ----------
    people : People
        Of this frame, on the upright working grid.
    frame : DepthFrame
        As the sensor gave it.
    mount : MountConfig
        How the sensor is turned.

    Returns
    -------
    (H, W) uint8
        `person_number` of whom a pixel shows; 0 elsewhere, and where the frame has no depth.
    """
    numbers = np.zeros(256, np.uint8)
    for person in people.persons:
        numbers[person.found.label] = person_number(person.body_id)
    cells, inside = _lookup(frame.camera, people.camera, mount.roll)
    labels = numbers[people.labels].ravel()[cells]
    return np.where(inside & (frame.depth > 0.0), labels, np.uint8(0))


@lru_cache(maxsize=4)
def _lookup(camera: Camera, grid: Camera, roll_deg: float) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """For each pixel of the sensor, its cell of the working grid, and whether there is one."""
    v, u = np.mgrid[: camera.height, : camera.width]
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy], axis=-1)
    x, y = np.moveaxis(rays @ rotation_sensor_upright(roll_deg)[:2, :2], -1, 0)
    column = np.rint(grid.fx * x + grid.cx).astype(np.int32)
    row = np.rint(grid.fy * y + grid.cy).astype(np.int32)
    inside = (column >= 0) & (column < grid.width) & (row >= 0) & (row < grid.height)
    return np.where(inside, row * grid.width + column, 0), inside
