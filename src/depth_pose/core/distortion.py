"""Lens distortion: models of ``sensor_msgs/distortion_models``, with the names and lengths of drivers.

Both models map the ideal ray (a, b, 1) to the distorted ray (a', b', 1), with ``r^2 = a^2 + b^2``:

- `OPENCV`, ``d = k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4]]]``: ``plumb_bob``, ``rational_polynomial`` and
  the thin prism;
- `FISHEYE`, ``d = k1 k2 k3 k4``: ``equidistant``, a polynomial of the angle to the optical axis.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import InputError

Array = NDArray[np.float64]

OPENCV, FISHEYE = "opencv", "fisheye"
"""Names of the two models here."""

_NAMES = {
    OPENCV: (
        *("plumb_bob", "rational_polynomial", "thin_prism", "opencv", "radtan"),
        *("radial_tangential", "brown", "brown_conrady", "modified_brown_conrady", "brownconrady"),
        *("", "none", "pinhole"),
    ),
    FISHEYE: (
        *("equidistant", "equi", "fisheye", "opencv_fisheye", "kannala_brandt", "kannala_brandt4", "kb4"),
        *("kannalabrandt", "kannalabrandt4"),
    ),
}
"""Names of each model in CameraInfos and calibration files, in lower case, with underscores."""

_LENGTHS = {OPENCV: (4, 5, 8, 12), FISHEYE: (4,)}
"""Numbers of coefficients of each model; zeros may follow."""

_STEPS = 2000
"""Number of radii at which the model is checked for growth."""


def distortion_of(d: Sequence[float] | Array, name: str) -> tuple[str, tuple[float, ...]]:
    """Return the model and the coefficients of a CameraInfo's ``d`` and ``distortion_model``.

    Zeros that pad the coefficients to another length are ignored.

    Returns
    -------
    model : str
        `OPENCV`, `FISHEYE`, or empty without distortion.
    d : tuple of float
        Coefficients, as many as the model has at this length.

    Raises
    ------
    InputError
        If the model is unknown, or does not have these coefficients.
    """
    coefficients = tuple(float(x) for x in d)
    plain = name.strip().lower().replace("-", "_").replace(" ", "_").removeprefix("rs2_distortion_")
    model = next((model for model, names in _NAMES.items() if plain in names), "")
    is_zero = not any(coefficients)
    if is_zero and (model != FISHEYE or len(coefficients) < 4):
        return "", ()
    if not np.isfinite(coefficients).all():
        raise InputError(f"camera_info: d is {list(coefficients)}; all must be finite")
    if not model:
        raise InputError(
            f"camera_info: distortion_model is {name!r}; it must be plumb_bob, rational_polynomial or "
            "equidistant, or give a rectified image and its camera_info"
        )
    used = len(coefficients)
    while used and not coefficients[used - 1]:
        used -= 1
    lengths = _LENGTHS[model]
    if len(coefficients) < lengths[0] or used > lengths[-1] or (model == OPENCV and used in (6, 7)):
        raise InputError(
            f"camera_info: d has {len(coefficients)} numbers, {used} up to the last that is not zero; "
            f"{name or 'plumb_bob'} has {', '.join(map(str, lengths))}, followed by zeros"
        )
    length = next(n for n in lengths if n >= used)
    return model, (coefficients + (0.0,) * length)[:length]


def distort(a: Array, b: Array, d: Sequence[float], model: str) -> tuple[Array, Array]:
    """Distort the ray (a, b, 1).

    Parameters
    ----------
    a, b : (...) float64
        Ideal ``x/z`` and ``y/z``.
    d : sequence of float
        Coefficients, from `distortion_of`.
    model : str
        `OPENCV` or `FISHEYE`.

    Returns
    -------
    (...), (...) float64
        Distorted ``x/z`` and ``y/z``.
    """
    r2 = a * a + b * b
    if model == FISHEYE:
        r = np.sqrt(r2)
        theta = np.arctan(r)
        t2 = theta * theta
        radial = theta * (1 + t2 * (d[0] + t2 * (d[1] + t2 * (d[2] + t2 * d[3]))))
        factor = np.where(r > 1e-9, radial / np.maximum(r, 1e-9), 1.0)
        return a * factor, b * factor
    k1, k2, p1, p2 = d[:4]
    k3 = d[4] if len(d) > 4 else 0.0
    factor = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    if len(d) > 5:
        factor = factor / (1 + r2 * (d[5] + r2 * (d[6] + r2 * d[7])))
    x = a * factor + 2 * p1 * a * b + p2 * (r2 + 2 * a * a)
    y = b * factor + p1 * (r2 + 2 * b * b) + 2 * p2 * a * b
    if len(d) > 8:
        x, y = x + r2 * (d[8] + r2 * d[9]), y + r2 * (d[10] + r2 * d[11])
    return x, y


def largest_radius(d: Sequence[float], model: str, most: float) -> float:
    """Return the radius ``r`` up to ``most`` to which the distorted radius grows with the ideal one.

    Beyond it a polynomial fitted to the image turns back, and rays outside the view fall into the image.
    """
    radial = [0.0 if model == OPENCV and i in (2, 3, 8, 9, 10, 11) else x for i, x in enumerate(d)]
    r = np.linspace(0.0, most, _STEPS)
    with np.errstate(all="ignore"):  # poles of the rational model
        distorted, _ = distort(r, np.zeros_like(r), radial, model)
    turned = np.flatnonzero(~(np.diff(distorted) > 0.0))
    return most if len(turned) == 0 else float(r[turned[0]])
