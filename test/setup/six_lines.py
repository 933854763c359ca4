"""The six lines of the README, on simulated frames; it needs nothing but the installed package."""

import importlib.util

from depth_pose.detect.sample_frame import sample_frame

frame = sample_frame()
K, frames = frame.camera.matrix(), [(0.04 * i, (1000 * frame.depth).astype("uint16")) for i in range(3)]

import depth_pose  # noqa: E402

tracker = depth_pose.Tracker()
camera = depth_pose.Camera.from_matrix(K, width=176, height=144)
found = []
for t, depth in frames:
    for person in tracker(depth, camera, time=t):
        print(person.id, person["left_wrist"].position, person["left_wrist"].confidence)
        found.append(person.id)

assert found == ["body_1"] * 3, found
assert not any(
    importlib.util.find_spec(name) for name in ("rclpy", "viser", "distributed", "torch", "open3d")
)
