"""3D skeletons of everybody in view, from depth images alone, on a CPU.

>>> import depth_pose
>>> tracker = depth_pose.Tracker()  # doctest: +SKIP
>>> for person in tracker(depth, camera, time=0.0):  # doctest: +SKIP
...     print(person.id, person["left_wrist"].position)

The public names are imported on first use, so that ``import depth_pose`` itself is quick.
`depth_pose.pipeline.PosePipeline` is the method; only `depth_pose.ros` imports ROS.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from depth_pose.bank.bank import Bank
    from depth_pose.body.angle_definitions import JOINT_ANGLES
    from depth_pose.body.joint_angles import JointAngle, JointAngles, joint_angles
    from depth_pose.core.camera import Camera, Lens
    from depth_pose.core.config import PipelineConfig
    from depth_pose.core.errors import BankError, ConfigError, DepthPoseError, InputError
    from depth_pose.core.frame import DepthFrame
    from depth_pose.core.joint import Joint
    from depth_pose.core.result import Skeleton
    from depth_pose.core.skeleton import BONES, JOINTS, JointName, JointState, Source, Tracking
    from depth_pose.detect.floor import Floor
    from depth_pose.evaluate.drawing import draw
    from depth_pose.io.mcap_read import read_frames as read_recording
    from depth_pose.io.messages import SkeletonsMessage
    from depth_pose.io.skeleton_read import read_people as read_skeletons
    from depth_pose.people import People
    from depth_pose.senders.osc import OscSender
    from depth_pose.senders.websocket import WebSocketSender
    from depth_pose.tracker import Tracker

__version__ = "0.2.0"

__all__ = [
    "BONES",
    "JOINTS",
    "JOINT_ANGLES",
    "Bank",
    "BankError",
    "Camera",
    "ConfigError",
    "DepthFrame",
    "DepthPoseError",
    "Floor",
    "InputError",
    "Joint",
    "JointAngle",
    "JointAngles",
    "JointName",
    "JointState",
    "Lens",
    "OscSender",
    "People",
    "PipelineConfig",
    "Skeleton",
    "SkeletonsMessage",
    "Source",
    "Tracker",
    "Tracking",
    "WebSocketSender",
    "draw",
    "joint_angles",
    "read_recording",
    "read_skeletons",
]

_PLACES = {
    "bank.bank": ("Bank",),
    "core.camera": ("Camera", "Lens"),
    "core.config": ("PipelineConfig",),
    "body.angle_definitions": ("JOINT_ANGLES",),
    "body.joint_angles": ("JointAngle", "JointAngles", "joint_angles"),
    "core.errors": ("BankError", "ConfigError", "DepthPoseError", "InputError"),
    "core.frame": ("DepthFrame",),
    "core.joint": ("Joint",),
    "core.result": ("Skeleton",),
    "core.skeleton": ("BONES", "JOINTS", "JointName", "JointState", "Source", "Tracking"),
    "detect.floor": ("Floor",),
    "evaluate.drawing": ("draw",),
    "io.mcap_read": ("read_frames",),
    "io.messages": ("SkeletonsMessage",),
    "io.skeleton_read": ("read_people",),
    "people": ("People",),
    "senders.osc": ("OscSender",),
    "senders.websocket": ("WebSocketSender",),
    "tracker": ("Tracker",),
}
_OTHER_NAMES = {"read_recording": "read_frames", "read_skeletons": "read_people"}
_MODULES = {name: module for module, names in _PLACES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import an exported name on its first use."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    original = _OTHER_NAMES.get(name, name)
    value = getattr(import_module(f"{__name__}.{_MODULES[original]}"), original)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
