"""SROS2: where it is asked for and ROS does not start, or starts without it, say so in one line."""

from __future__ import annotations

import itertools
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from depth_pose.core.errors import ConfigError
from depth_pose.core.printable import printable

_SAID = "DEPTH_POSE_SECURITY_SAID"
"""Set in the environment once a start without security was reported: nodes of one start say it once."""


_NO = ("", "0", "false", "no", "off")
"""Values of ``ROS_SECURITY_ENABLE`` by which nobody asks for security; of others rcl knows ``true``."""


def check_security() -> None:
    """Start ROS and end it where security is asked for, so that one process speaks for all that follow.

    Raises
    ------
    ConfigError
        As `init_context`.
    """
    if not os.environ.get("ROS_SECURITY_ENABLE"):
        return
    import rclpy
    from rclpy.context import Context

    context = Context()
    init_context(context, args=[])
    rclpy.try_shutdown(context=context)


def init_context(context: Any = None, args: Sequence[str] | None = None, **options: Any) -> None:
    """Initialise rclpy, as `rclpy.init`; print a line where security is asked for and ROS starts without it.

    Raises
    ------
    ConfigError
        Where ROS does not start and ``ROS_SECURITY_ENABLE`` asks for SROS2.
    """
    import rclpy

    wanted = os.environ.get("ROS_SECURITY_ENABLE", "")
    enclave = _Enclave(sys.argv if args is None else args)
    try:
        rclpy.init(args=args, context=context, **options)
        if wanted == "true" and not enclave.missing:
            _try_keys(context)
    except RuntimeError as error:
        if wanted != "true":
            raise
        rclpy.try_shutdown(context=context)
        reason, cure = enclave.missing, enclave.cure
        if not reason:
            reason = str(error).partition("\n")[0].rpartition("error creating node: ")[2]
            cure = f"check the keys and permissions in {enclave.folder}"
        raise ConfigError(
            f"ROS does not start, and ROS_SECURITY_ENABLE asks for SROS2 ({reason}): {cure}, or unset "
            "ROS_SECURITY_ENABLE; ROS 2 from the Python package index has no SROS2"
        ) from error
    if wanted == "true" and enclave.missing:
        _say_once(
            f"without security: {enclave.missing}; with ROS_SECURITY_STRATEGY=Enforce it would not start"
        )
    elif wanted != "true" and wanted.lower() not in _NO:
        _say_once(f"without security: ROS_SECURITY_ENABLE is {wanted!r}, and only 'true' asks for SROS2")


class _Enclave:
    """The keys that the environment and the arguments name, as rcl looks for them."""

    def __init__(self, args: Sequence[str]) -> None:
        given = [value for option, value in itertools.pairwise(args) if option == "--enclave"]
        name = os.environ.get("ROS_SECURITY_ENCLAVE_OVERRIDE") or (given[-1] if given else "/")
        keystore = os.environ.get("ROS_SECURITY_KEYSTORE", "")
        self.folder = Path(keystore, "enclaves", name.strip("/"))
        self.missing, self.cure = "", ""
        if not keystore or not Path(keystore, "enclaves").is_dir():
            named = f"is no keystore: {keystore}" if keystore else "is not set"
            self.missing = f"ROS_SECURITY_KEYSTORE {named}"
            self.cure = "set ROS_SECURITY_KEYSTORE to a keystore of `ros2 security create_keystore`"
        elif not self.folder.is_dir():
            self.missing = f"the keystore {keystore} has no enclave {name}"
            self.cure = f"make it with `ros2 security create_enclave {keystore} {name}`"


def _try_keys(context: Any) -> None:
    """Create a node and destroy it: keys are read with the first node of a context."""
    import rclpy

    rclpy.create_node(
        "depth_pose_security",
        context=context,
        use_global_arguments=False,
        enable_rosout=False,
        start_parameter_services=False,
    ).destroy_node()


def _say_once(line: str) -> None:
    if not os.environ.get(_SAID):
        os.environ[_SAID] = "1"
        sys.stderr.write(f"depth_pose: ROS starts {printable(line)}\n")
