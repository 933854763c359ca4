"""The exponential of the kernels, against NumPy's."""

from __future__ import annotations

import numpy as np

from depth_pose.core._fast_exp import falling_exp


def test_falling_exp_twin():
    x = np.linspace(0.0, 7.0, 700, dtype=np.float32)
    found = np.array([falling_exp(v) for v in x])
    np.testing.assert_allclose(found, np.exp(-x), rtol=4e-3)
    np.testing.assert_allclose(found[x < 4], np.exp(-x[x < 4]), rtol=2e-4)
