"""RVL, run lengths and variable lengths: lossless coding of depth images.

A. Wilson, *Fast Lossless Depth Image Compression*, ACM ISS 2017. The pixels are coded as runs: number of
zeros, number of other values, and for each of those the difference to the previous one, its sign in the
lowest bit. Each number is written in groups of three bits, lowest first, each in half a byte whose highest
bit marks a continuation. The half bytes fill 32-bit little-endian words from the top.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.kernels import njit


@njit(cache=True)
def _read(nibbles: NDArray[np.uint8], at: int) -> tuple[int, int]:
    """Read a number at a half byte; return it and the next position, -1 if it is cut off."""
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
    """Decode half bytes into pixels; return False if there are too few or too many."""
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
