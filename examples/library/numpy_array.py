"""Skeletons of depth images in a NumPy file: numpy_array.py FRAMES.npz.

The file holds ``depth`` (T, H, W), uint16 millimetres or float metres, ``times`` (T,), seconds, and ``K``
(3, 3), the intrinsic matrix. The skeletons go to FRAMES_skeletons.npy, one row a person and frame.
"""

import sys
from pathlib import Path

import numpy as np

import depth_pose


def main(path: str) -> None:
    """Track everybody and keep the result as one table."""
    frames = np.load(path)
    height, width = frames["depth"].shape[1:]
    camera = depth_pose.Camera.from_matrix(frames["K"], width=width, height=height)
    tracker = depth_pose.Tracker()
    rows = []
    for time, depth in zip(frames["times"], frames["depth"], strict=True):
        for person in tracker(depth, camera, time=time):
            rows.append(person.to_record())
            x, y, z = person["left_wrist"].position
            print(f"{person.time:.3f} s  {person.id}: left wrist at {x:.2f} {y:.2f} {z:.2f} m")
    table = np.array(rows)  # table["positions"] is (rows, 19, 3), in the order of depth_pose.JOINTS
    np.save(Path(path).with_name(Path(path).stem + "_skeletons.npy"), table)


if __name__ == "__main__":
    main(sys.argv[1])
