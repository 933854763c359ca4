"""Check of network interfaces: even nodes on one machine need one for discovery."""

from __future__ import annotations

import fcntl
import os
import socket
import struct

from depth_pose.core.errors import ConfigError
from depth_pose.ros import LOCAL_PROFILE_PATH, PROFILE_VARIABLE

_GET_FLAGS, _UP = 0x8913, 0x1
"""Of Linux' netdevice(7): the request SIOCGIFFLAGS, and the flag IFF_UP."""


def check_interfaces() -> None:
    """Check that nodes can find one another: the loopback interface is up, or without ``--local`` any other.

    Raises
    ------
    ConfigError
        If none is.
    """
    names = ["lo"]
    if os.environ.get(PROFILE_VARIABLE) != str(LOCAL_PROFILE_PATH):
        names += [name for _, name in socket.if_nameindex()]
    if not any(map(_is_up, names)):
        raise ConfigError(
            "no network interface is up, and nodes find one another through one; bring up the machine's own: "
            "ip link set lo up"
        )


def _is_up(name: str) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        try:
            told = fcntl.ioctl(any_socket, _GET_FLAGS, struct.pack("16sh14x", name.encode(), 0))
        except OSError:  # it has disappeared
            return False
    return bool(struct.unpack("16sh14x", told)[1] & _UP)
