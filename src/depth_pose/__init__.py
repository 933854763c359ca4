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
    from depth_pose.core.camera import Camera
    from depth_pose.core.errors import BankError, ConfigError, DepthPoseError, InputError
    from depth_pose.core.skeleton import BONES, JOINTS, JointState
    from depth_pose.core.types import DepthFrame, Joint, Skeleton
    from depth_pose.io.mcap_read import read_frames as read_recording
    from depth_pose.io.skeleton_read import read_people as read_skeletons
    from depth_pose.tracker import Tracker

__version__ = "0.2.0"

__all__ = [
    "BONES",
    "JOINTS",
    "BankError",
    "Camera",
    "ConfigError",
    "DepthFrame",
    "DepthPoseError",
    "InputError",
    "Joint",
    "JointState",
    "Skeleton",
    "Tracker",
    "read_recording",
    "read_skeletons",
]

_PLACES = {
    "core.camera": ("Camera",),
    "core.errors": ("BankError", "ConfigError", "DepthPoseError", "InputError"),
    "core.skeleton": ("BONES", "JOINTS", "JointState"),
    "core.types": ("DepthFrame", "Joint", "Skeleton"),
    "io.mcap_read": ("read_frames",),
    "io.skeleton_read": ("read_people",),
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
