"""Addresses of the form HOST:PORT."""

from __future__ import annotations

from typing import NamedTuple

from depth_pose.core.errors import ConfigError

LOCAL = "127.0.0.1"
"""Host of an address without one: this machine."""

_MOST_PORT = 65535
"""Largest number of a port."""


class Address(NamedTuple):
    """A host, by name or number, and a port, from 0 to 65535."""

    host: str
    port: int


def parse_address(text: str, name: str) -> Address:
    """Parse ``HOST:PORT``, ``[HOST]:PORT`` or ``PORT``.

    Parameters
    ----------
    text : str
    name : str
        What is given, for the error.

    Raises
    ------
    ConfigError
        Where it is no address.

    Examples
    --------
    >>> parse_address("studio.local:9000", "--osc")
    Address(host='studio.local', port=9000)
    >>> parse_address("8765", "--websocket")
    Address(host='127.0.0.1', port=8765)
    """
    host, _, port = text.rpartition(":")
    if not port.isdecimal() or int(port) > _MOST_PORT or (":" in host and not host.startswith("[")):
        raise ConfigError(f"{name} is {text!r:.80}; give HOST:PORT or PORT, for instance 127.0.0.1:9000")
    return Address(host.strip("[]") or LOCAL, int(port))
