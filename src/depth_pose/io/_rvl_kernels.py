"""RVL, run lengths and variable lengths: lossless coding of depth images.

A. Wilson, *Fast Lossless Depth Image Compression*, ACM ISS 2017. The pixels are runs: how many are
zero, how many are not, and of the latter each one's difference to the one before, its sign in the
lowest bit. Every number is written in groups of three bits, lowest first, each in half a byte whose
highest bit says that more follow; the half bytes fill 32-bit little-endian words from the top.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.kernels import njit


@njit(cache=True)
def _read(nibbles: NDArray[np.uint8], at: int) -> tuple[int, int]:
    """Read a number at a half byte; gives it and where the next begins, -1 where it is cut off."""
    value, shift = 0, 0
    while at < nibbles.size and shift < 33:
        nibble = nibbles[at]
        at += 1
        value |= (int(nibble) & 7) << shift
        if nibble < 8:
            return value, at
        shift += 3
    return 0, -1


@njit(cache=True)
def decode(nibbles: NDArray[np.uint8], out: NDArray[np.uint16]) -> bool:
    """Decode half bytes into pixels; false where they end early or are too many."""
    done, at, previous = 0, 0, 0
    while done < out.size:
        zeros, at = _read(nibbles, at)
        if at < 0 or done + zeros > out.size:
            return False
        out[done : done + zeros] = 0
        done += zeros
        if done == out.size and at == nibbles.size:
            return True
        count, at = _read(nibbles, at)
        if at < 0 or done + count > out.size or zeros + count == 0:
            return False
        for _ in range(count):
            coded, at = _read(nibbles, at)
            if at < 0:
                return False
            previous += (coded >> 1) ^ -(coded & 1)
            out[done] = previous & 0xFFFF
            done += 1
    return True
