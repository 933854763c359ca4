"""Skeletons from a RealSense camera, without ROS: realsense.py, until Ctrl-C.

Needs ``pip install pyrealsense2``.
"""

from collections.abc import Iterator

import numpy as np

import depth_pose


def frames() -> Iterator[tuple[float, np.ndarray, depth_pose.Camera]]:
    """Yield time, depth image in metres, and camera of each frame of the first RealSense."""
    import pyrealsense2 as rs

    pipeline = rs.pipeline()
    config = rs.config()
    config.enable_stream(rs.stream.depth, 640, 480, rs.format.z16, 30)
    profile = pipeline.start(config)
    metres = profile.get_device().first_depth_sensor().get_depth_scale()
    lens = profile.get_stream(rs.stream.depth).as_video_stream_profile().get_intrinsics()
    camera = depth_pose.Camera(lens.width, lens.height, lens.fx, lens.fy, lens.ppx, lens.ppy)
    try:
        while True:
            frame = pipeline.wait_for_frames().get_depth_frame()
            depth = np.asanyarray(frame.get_data()).astype(np.float32) * metres
            yield frame.get_timestamp() / 1000.0, depth, camera
    finally:
        pipeline.stop()


def main() -> None:
    """Print where everybody's wrists are."""
    tracker = depth_pose.Tracker()
    for time, depth, camera in frames():
        for person in tracker(depth, camera, time=time):
            for name in ("left_wrist", "right_wrist"):
                joint = person[name]
                x, y, z = joint.position
                print(f"{person.id} {name}: {x:.2f} {y:.2f} {z:.2f} m, confidence {joint.confidence:.2f}")


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        pass
