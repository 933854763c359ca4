"""Exponential functions in plain arithmetic, so that loops over many numbers can be vectorised.

Both use a power series for a fraction of the exponent and square the result: `falling_exp` in as few steps
as weights need, `gauss` in more, where accuracy and the tail matter.
"""

from __future__ import annotations

import numpy as np

from depth_pose.core.kernels import njit

CUT = 16.0
"""`gauss` is 0 from here on, that is beyond 5.7 sigma (1e-7)."""

_ONE, _HALF, _SIXTH, _24TH, _120TH, _720TH = (np.float32(1 / n) for n in (1, 2, 6, 24, 120, 720))
"""Factors of the power series."""
_16TH, _32ND, _CUT = np.float32(1 / 16), np.float32(-1 / 32), np.float32(CUT)
"""Scales of the exponents: `falling_exp` squares the series four times, `gauss` five; `CUT` as float32."""


@njit(cache=True, fastmath=True, forceinline=True)
def falling_exp(x):
    """``exp(-x)`` for 0 <= x <= 7 in single precision, to 0.4 % (0.02 % up to 4)."""
    t = x * _16TH
    e = _ONE - t * (_ONE - t * (_HALF - t * (_SIXTH - t * _24TH)))
    e *= e
    e *= e
    e *= e
    return e * e


@njit(cache=True, fastmath=True, inline="always")
def gauss(x):
    """``exp(-x)`` for x >= 0 in single precision, to 1e-5; 0 from `CUT` on."""
    t = min(x, _CUT) * _32ND
    e = _ONE + t * (_ONE + t * (_HALF + t * (_SIXTH + t * (_24TH + t * (_120TH + t * _720TH)))))
    e = e * e
    e = e * e
    e = e * e
    e = e * e
    e = e * e
    return e if x < _CUT else np.float32(0.0)
