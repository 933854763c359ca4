"""Arrays as one block of bytes, for files and other processes: each is copied once, and read without a copy.

A block begins with a checksum of the arrays' types and the number of bytes of each. The arrays follow, each
at a multiple of eight bytes.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from depth_pose.core.errors import InputError

_ALIGN = 8
"""Arrays begin at a multiple of this (bytes)."""


def pack(arrays: Sequence[NDArray[Any]]) -> bytes:
    """Return arrays as one block of bytes; `unpack` returns them flattened."""
    head = np.array([_checksum([a.dtype for a in arrays]), *(a.nbytes for a in arrays)], "<u8")
    parts = [head.tobytes()]
    for array in arrays:
        parts += [array.tobytes(), bytes(-array.nbytes % _ALIGN)]
    return b"".join(parts)


def unpack(data: bytes | memoryview, kinds: Sequence[DTypeLike]) -> list[NDArray[Any]]:
    """Return the arrays of a block, each with one axis: writable, and views of ``data`` unless that is not.

    Parameters
    ----------
    data : bytes or memoryview
        Result of `pack`, perhaps with other blocks behind it.
    kinds : sequence of dtype
        Types of the arrays.

    Raises
    ------
    InputError
        If the block has arrays of other types, or is too short.
    """
    types = [np.dtype(kind) for kind in kinds]
    size = 8 * (1 + len(types))
    if len(data) < size:
        raise InputError(f"{len(data)} bytes of data are no block of {len(types)} arrays")
    checksum, *sizes = np.frombuffer(data, "<u8", 1 + len(types)).tolist()
    if checksum != _checksum(types):
        raise InputError("the data has arrays of other types: it is from another version of depth_pose")
    if sum(sizes) > len(data) or any(n % kind.itemsize for n, kind in zip(sizes, types, strict=True)):
        raise InputError(f"the data has {len(data)} bytes, and its arrays {' + '.join(map(str, sizes))}")
    arrays, buffer = [], bytearray(data) if isinstance(data, bytes) else data
    for length, kind in zip(sizes, types, strict=True):
        if size + length > len(data):
            raise InputError(f"the data has {len(data)} bytes; an array ends at {size + length}")
        arrays.append(np.frombuffer(buffer, kind, length // kind.itemsize, size))
        size += length + -length % _ALIGN
    return arrays


def _checksum(types: Sequence[np.dtype[np.generic]]) -> int:
    return zlib.crc32(repr([(kind.str, kind.descr, kind.itemsize) for kind in types]).encode())
