"""Encoding of skeletons as CDR, for recordings and for topics: all joints of one in one call of `struct`."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.joint import six_numbers
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import JOINTS

_NAMES = [(len(name) + 1, name.encode()) for name in JOINTS]
_NS_PER_S = 1_000_000_000
"""Nanoseconds in a second."""
_BEGIN = b"\x00\x01\x00\x00"
"""Start of a message: CDR, little endian."""


def write_skeleton(skeleton: Skeleton) -> bytes:
    """Return a ``depth_pose_msgs/msg/Skeleton``."""
    out = bytearray()
    _add_skeleton(out, skeleton)
    return _BEGIN + bytes(out)


def write_people(skeletons: Sequence[Skeleton], stamp_ns: int, frame_id: str) -> bytes:
    """Return a ``depth_pose_msgs/msg/SkeletonArray`` of everybody in a frame."""
    out = bytearray()
    _add_header(out, stamp_ns, frame_id)
    _add(out, "I", len(skeletons))
    for skeleton in skeletons:
        _add_skeleton(out, skeleton)
    return _BEGIN + bytes(out)


def _add_skeleton(out: bytearray, skeleton: Skeleton) -> None:
    _add_header(out, skeleton.stamp_ns, skeleton.frame_id)
    _add_text(out, skeleton.body_id)
    out.append(int(skeleton.source))
    _add(out, "3f", skeleton.confidence, skeleton.residual, skeleton.scale)
    if len(skeleton.positions):
        places, turns = skeleton.positions.tolist(), skeleton.quats_xyzw.tolist()
        confidence, states = skeleton.joint_confidence.tolist(), skeleton.joint_states.tolist()
        rows = zip(_NAMES, places, turns, confidence, states, strict=True)
        values = [value for name, p, q, c, s in rows for value in (*name, *p, *q, c, s)]
        out += _joints_format(-len(out) % 8).pack(len(JOINTS), *values)
    else:
        _add(out, "I", 0)
    _add_floats(out, skeleton.build)
    out.append(int(skeleton.tracking))
    places = (skeleton.centre, skeleton.velocity, *skeleton.box)
    out += struct.pack(f"<{-len(out) % 8}x12d", *(x for place in places for x in place.tolist()))
    _add_floats(out, skeleton.velocities)
    _add_floats(out, six_numbers(skeleton.covariances))


@cache
def _joints_format(before: int) -> struct.Struct:
    """Return the format of a skeleton's joints that begin this number of bytes before a multiple of 8."""
    at, parts = -before % 8, ["<"]
    parts.append(f"{-at % 4}xI")
    at += -at % 4 + 4
    for size, _ in _NAMES:
        start = at + -at % 4 + 4 + size
        parts.append(f"{-at % 4}xI{size}s{-start % 8}x7dfB")
        at = start + -start % 8 + 7 * 8 + 5
    return struct.Struct("".join(parts))


def _add_header(out: bytearray, stamp_ns: int, frame_id: str) -> None:
    _add(out, "iI", *divmod(stamp_ns, _NS_PER_S))
    _add_text(out, frame_id)


def _add_floats(out: bytearray, values: NDArray[np.floating]) -> None:
    _add(out, "I", values.size)
    out += values.astype("<f4").tobytes()


def _add_text(out: bytearray, text: str) -> None:
    data = text.encode()
    _add(out, f"I{len(data) + 1}s", len(data) + 1, data)


def _add(out: bytearray, kinds: str, *values: float | bytes) -> None:
    """Append values, the first of four bytes, at a multiple of four."""
    out += struct.pack(f"<{-len(out) % 4}x{kinds}", *values)
