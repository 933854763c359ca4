"""Skeletons of depth images and of a point cloud, read with Open3D: open3d_images.py FOLDER.

The folder holds depth images, PNG of 16 bits in millimetres, and ``camera.json`` as
`open3d.io.write_pinhole_camera_intrinsic` writes it; or point clouds, PLY or PCD, in the camera's frame.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import open3d as o3d

import depth_pose

FRAMES_A_SECOND = 30.0


def read(folder: Path) -> Iterator[tuple[np.ndarray, depth_pose.Camera | None]]:
    """Yield the folder's depth images, each with its camera, then its point clouds."""
    images = sorted(folder.glob("*.png"))
    if images:
        found = o3d.io.read_pinhole_camera_intrinsic(str(folder / "camera.json"))
        camera = depth_pose.Camera.from_matrix(found.intrinsic_matrix, width=found.width, height=found.height)
    for file in images:
        yield np.asarray(o3d.io.read_image(str(file))), camera
    for file in sorted([*folder.glob("*.ply"), *folder.glob("*.pcd")]):
        yield np.asarray(o3d.io.read_point_cloud(str(file)).points), None


def main(folder: str) -> None:
    """Print where everybody's head is."""
    tracker = depth_pose.Tracker()
    for number, (depth, camera) in enumerate(read(Path(folder))):
        for person in tracker(depth, camera, time=number / FRAMES_A_SECOND):
            x, y, z = person["head"].position
            print(f"frame {number}  {person.id}: head at {x:.2f} {y:.2f} {z:.2f} m")


if __name__ == "__main__":
    main(sys.argv[1])
