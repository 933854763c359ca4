"""Find skeletons with an OpenNI2 camera (Xtion, Astra, Kinect v1), without ROS; send them to other programs.

pip install openni 'depth_pose[live]'      # and the camera's OpenNI2 library: https://structure.io/openni
python openni2.py [--websocket 8765] [--osc 9000]

``examples/live`` is a page that shows them. Not tested with a camera; the test replays recorded frames
through the same calls.
"""

import argparse
from contextlib import ExitStack

import numpy as np
from openni import openni2

import depth_pose


def frames(stream):
    """Yield time in seconds and depth in millimetres."""
    while True:
        frame = stream.read_frame()
        depth = np.frombuffer(frame.get_buffer_as_uint16(), np.uint16)
        yield frame.timestamp * 1e-6, depth.reshape(frame.height, frame.width)


def main(arguments=None):
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    options.add_argument("--websocket", type=int, metavar="PORT")
    options.add_argument("--osc", type=int, metavar="PORT")
    chosen = options.parse_args(arguments)
    openni2.initialize()
    stream = openni2.Device.open_any().create_depth_stream()
    stream.start()
    mode = stream.get_video_mode()
    camera = depth_pose.Camera.from_fov(
        np.degrees(stream.get_horizontal_fov()),
        vertical=np.degrees(stream.get_vertical_fov()),
        width=mode.resolutionX,
        height=mode.resolutionY,
    )
    tracker = depth_pose.Tracker()
    with ExitStack() as stack:
        senders = []
        if chosen.websocket:
            senders.append(stack.enter_context(depth_pose.WebSocketSender(chosen.websocket)))
        if chosen.osc:
            senders.append(stack.enter_context(depth_pose.OscSender(chosen.osc)))
        for time, depth in frames(stream):
            people = tracker(depth, camera, time=time)
            for sender in senders:
                sender.send(people)
            print(people)


if __name__ == "__main__":
    main()
