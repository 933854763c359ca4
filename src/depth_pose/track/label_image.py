"""Per-pixel person labels at sensor resolution, mapped back from the working grid."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera, Lens
from depth_pose.core.config import MountConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.core.labels import MOST_LABEL
from depth_pose.core.mount import rotation_sensor_upright
from depth_pose.io.rectification import unrectify_labels
from depth_pose.track.person_view import FramePeople


def person_number(body_id: str) -> int:
    """Return a person's number in the label image: 7 for ``body_7``, from 1 to `MOST_LABEL`.

    After the last number the numbers repeat from 1.
    """
    digits = re.findall(r"\d+", body_id)
    return (int(digits[-1]) - 1) % MOST_LABEL + 1 if digits else 1


@dataclass(frozen=True, eq=False)
class LabelImage:
    """The people of a frame, from which their labels at sensor resolution are drawn.

    Attributes
    ----------
    numbers : (h, w) uint8
        `person_number` of the person at each cell of the upright working grid; 0 elsewhere.
    grid : Camera
        Camera of that grid.
    measured : (N,) uint8
        Bits of the sensor's pixels that have depth.
    camera : Camera
        Camera of the sensor's image, without distortion.
    roll : float
        Rotation of the sensor, degrees.
    lens : Lens or None
        The lens of the sensor's image, if it is distorted.
    """

    numbers: NDArray[np.uint8]
    grid: Camera
    measured: NDArray[np.uint8]
    camera: Camera
    roll: float
    lens: Lens | None = None

    @classmethod
    def of(
        cls, people: FramePeople, frame: DepthFrame, mount: MountConfig, lens: Lens | None = None
    ) -> LabelImage:
        """Keep what is needed of a frame.

        Parameters
        ----------
        people : FramePeople
            People of this frame, on the upright working grid.
        frame : DepthFrame
            The sensor's frame, rectified.
        mount : MountConfig
            Rotation of the sensor.
        lens : Lens, optional
            Of the sensor's image before it was rectified.
        """
        numbers = np.zeros(256, np.uint8)
        for person in people.persons:
            numbers[person.found.label] = person_number(person.body_id)
        measured = np.packbits(frame.depth > 0.0)
        return cls(numbers[people.labels], people.camera, measured, frame.camera, mount.roll, lens)

    def draw(self) -> NDArray[np.uint8]:
        """Return the labels (H, W) of the sensor's image; 0 where there is nobody, or no depth."""
        cells, inside = _lookup(self.camera, self.grid, self.roll)
        shape = self.camera.height, self.camera.width
        measured = np.unpackbits(self.measured, count=shape[0] * shape[1]).reshape(shape) > 0
        labels = np.where(inside & measured, self.numbers.ravel()[cells], np.uint8(0))
        return labels if self.lens is None else unrectify_labels(labels, self.lens)


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
