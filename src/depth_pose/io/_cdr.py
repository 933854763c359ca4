"""Common Data Representation (XCDR1), as much of it as ROS 2 messages on disk need.

A message is four bytes that say the byte order, then the fields, each number at a multiple
of its own size from there (OMG, *DDS-XTYPES 1.3*, 7.4.1).
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import InputError

_SIZES = {"b": 1, "B": 1, "?": 1, "h": 2, "H": 2, "i": 4, "I": 4, "f": 4, "q": 8, "Q": 8, "d": 8}


class CdrReader:
    """Reads fields one after the other; what does not fit raises `InputError` with the offset."""

    def __init__(self, data: bytes | memoryview, what: str) -> None:
        self._what = what
        self._at = 4
        view = memoryview(data)
        if len(view) < 4 or view[0] != 0 or view[1] not in (0, 1):
            raise InputError(f"{what}: not a CDR message (its first bytes are {bytes(view[:4]).hex()})")
        self._order = "<" if view[1] else ">"
        self._view = view

    def _take(self, size: int, align: int) -> int:
        start = self._at + (4 - self._at) % align
        if size < 0 or start + size > len(self._view):
            raise InputError(
                f"{self._what}: the message ends at byte {len(self._view)}; "
                f"a field of {size} bytes begins at byte {start}"
            )
        self._at = start + size
        return start

    def number(self, code: str) -> int:
        """Read one whole number or bool of the given `struct` code."""
        value = struct.unpack_from(self._order + code, self._view, self._take(_SIZES[code], _SIZES[code]))[0]
        return int(value)

    def real(self, code: str = "d") -> float:
        """Read one floating-point number."""
        return float(
            struct.unpack_from(self._order + code, self._view, self._take(_SIZES[code], _SIZES[code]))[0]
        )

    def reals(self, count: int) -> NDArray[np.float64]:
        """Read an array of float64, shape (count,)."""
        start = self._take(8 * count, 8 if count else 1)
        return np.frombuffer(self._view, self._order + "f8", count, start).astype(np.float64)

    def text(self) -> str:
        """Read a string."""
        length = self.number("I")
        start = self._take(length, 1)
        return bytes(self._view[start : start + max(length - 1, 0)]).decode("utf-8", "replace")

    def octets(self) -> memoryview:
        """Read a sequence of bytes, without a copy."""
        length = self.number("I")
        start = self._take(length, 1)
        return self._view[start : start + length]

    def header(self) -> tuple[int, str]:
        """Read a ``std_msgs/Header``: the stamp, nanoseconds, and the frame's name."""
        seconds, nanoseconds = self.number("i"), self.number("I")
        return seconds * 1_000_000_000 + nanoseconds, self.text()


class CdrWriter:
    """Writes fields one after the other, little-endian."""

    def __init__(self) -> None:
        self._out = bytearray(b"\x00\x01\x00\x00")

    def _align(self, size: int) -> None:
        self._out += bytes((4 - len(self._out)) % size)

    def number(self, code: str, *values: float) -> None:
        """Write numbers of one `struct` code."""
        self._align(_SIZES[code])
        self._out += struct.pack(f"<{len(values)}{code}", *values)

    def text(self, value: str) -> None:
        """Write a string."""
        raw = value.encode() + b"\x00"
        self.number("I", len(raw))
        self._out += raw

    def octets(self, value: bytes) -> None:
        """Write a sequence of bytes."""
        self.number("I", len(value))
        self._out += value

    def header(self, stamp_ns: int, frame_id: str) -> None:
        """Write a ``std_msgs/Header``."""
        seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
        self.number("i", seconds)
        self.number("I", nanoseconds)
        self.text(frame_id)

    def bytes(self) -> bytes:
        """Give the message."""
        return bytes(self._out)
