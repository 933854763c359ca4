"""An exponential function that loops over many numbers can be vectorised with."""

from __future__ import annotations

import numpy as np
from numba import njit

_ONE, _HALF, _SIXTH, _24TH, _16TH = (np.float32(x) for x in (1.0, 0.5, 1 / 6, 1 / 24, 1 / 16))


@njit(cache=True, fastmath=True)
def falling_exp(x):
    """``exp(-x)`` for 0 <= x <= 7 in single precision, to 0.4 % (0.02 % up to 4)."""
    t = x * _16TH
    e = _ONE - t * (_ONE - t * (_HALF - t * (_SIXTH - t * _24TH)))
    e *= e
    e *= e
    e *= e
    return e * e
