"""RVL, run lengths and variable lengths: lossless coding of depth images.

A. Wilson, *Fast Lossless Depth Image Compression*, ACM ISS 2017. The pixels are runs: how many are
zero, how many are not, and of the latter each one's difference to the one before, its sign in the
lowest bit. Every number is written in groups of three bits, lowest first, each in half a byte whose
highest bit says that more follow; the half bytes fill 32-bit little-endian words from the top.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


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


@njit(cache=True)
def unfilter(rows: NDArray[np.uint8], step: int, out: NDArray[np.uint8]) -> bool:
    """Undo PNG's filters: rows (h, 1 + w), out (h, w) bytes, pixels of ``step`` bytes."""
    height, width = out.shape
    for r in range(height):
        kind = rows[r, 0]
        if kind > 4:
            return False
        for c in range(width):
            left = int(out[r, c - step]) if c >= step else 0
            up = int(out[r - 1, c]) if r > 0 else 0
            corner = int(out[r - 1, c - step]) if r > 0 and c >= step else 0
            guess = 0
            if kind == 1:
                guess = left
            elif kind == 2:
                guess = up
            elif kind == 3:
                guess = (left + up) // 2
            elif kind == 4:
                base = left + up - corner
                a, b, d = abs(base - left), abs(base - up), abs(base - corner)
                guess = left if a <= b and a <= d else (up if b <= d else corner)
            out[r, c] = (int(rows[r, c + 1]) + guess) & 0xFF
    return True
