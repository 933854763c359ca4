"""Run one node by itself on messages in a file, and print which kernels its first frames compile or load.

A kernel that another one calls is part of it: numba loads only the outer one.
"""

import json
import pickle
import sys
from importlib import import_module
from pathlib import Path

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CameraInfo

INFO = "/camera/depth/camera_info"


def loaded():
    """All kernels of the package with their signatures."""
    found = set()
    for name, module in list(sys.modules.items()):
        if name.startswith("depth_pose."):
            kernels = (v for v in vars(module).values() if hasattr(v, "py_func") and hasattr(v, "signatures"))
            found |= {
                f"{k.py_func.__module__}.{k.py_func.__name__}{s}" for k in kernels for s in k.signatures
            }
    return found


def main(name, path, *arguments):
    rclpy.init(args=["--ros-args", *arguments, "-p", "reliable:=true"])
    kind = getattr(import_module(f"depth_pose.ros.nodes.{name}_node"), f"{name.title()}Node")
    node = kind()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    infos, frames = pickle.loads(Path(path).read_bytes())
    sender = node.create_publisher(CameraInfo, INFO, 10)
    before, news = loaded(), []
    for count, (info, frame) in enumerate(zip(infos, frames, strict=True), start=1):
        sender.publish(deserialize_message(info, CameraInfo))
        node.process(tuple(deserialize_message(data, message) for message, data in frame))
        while node.statistics.answered < count and not node.statistics.drops:  # it waits for the CameraInfo
            executor.spin_once(timeout_sec=0.1)
        news.append(sorted(loaded() - before))
        before = loaded()
    print(json.dumps({"known": len(before), "answered": node.statistics.answered, "news": news}), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
