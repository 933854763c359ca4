"""Shared by all messages: stamps, headers, quaternions."""

from __future__ import annotations

import struct

from builtin_interfaces.msg import Time
from std_msgs.msg import Header

from depth_pose.core.errors import InputError

_NS_PER_S = 1_000_000_000
"""Nanoseconds in a second."""
_STAMP = struct.Struct("<xB2xiI")
"""Start of a serialised message with a header: byte order, seconds, nanoseconds."""


def stamp_to_ns(stamp: Time) -> int:
    """Convert a message's stamp to nanoseconds."""
    return int(stamp.sec) * _NS_PER_S + int(stamp.nanosec)


def first_stamp_ns(raw: bytes) -> int:
    """Return the stamp of a serialised message (CDR) that begins with a header."""
    if len(raw) < _STAMP.size:
        raise InputError(f"{len(raw)} bytes hold no header")
    little, sec, nanosec = _STAMP.unpack_from(raw)
    if not little:
        raise InputError("it is not little-endian")
    return int(sec) * _NS_PER_S + int(nanosec)


def ns_to_stamp(stamp_ns: int) -> Time:
    """Convert nanoseconds to a message's stamp."""
    return Time(sec=stamp_ns // _NS_PER_S, nanosec=stamp_ns % _NS_PER_S)


def make_header(stamp_ns: int, frame_id: str) -> Header:
    """Build a header with the given stamp and frame."""
    return Header(stamp=ns_to_stamp(stamp_ns), frame_id=frame_id)
