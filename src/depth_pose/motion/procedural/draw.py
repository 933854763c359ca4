"""Variation and timing of the procedural motions.

Every motion is one function of time and of a `Draw`. For a clip the draw gives one value of
each parameter and the function is called with the times of all frames; for a set of poses the
draw gives one value for each pose and the function is called with one moment of each. So the
same code makes smooth motion and thousands of unrelated poses.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.angles import ANGLE_INDEX, ARM, LEG, N_ANGLES, TRUNK

Array = NDArray[np.float64]


class Draw:
    """Random parameters: one of each for a clip, one for each pose of a set.

    Parameters
    ----------
    rng : numpy.random.Generator
    shape : tuple of int
        () for a clip, (N,) for N poses.
    """

    def __init__(self, rng: np.random.Generator, shape: tuple[int, ...]) -> None:
        self.rng = rng
        self.shape = shape

    @property
    def is_clip(self) -> bool:
        """Whether one set of parameters serves all times."""
        return self.shape == ()

    def uniform(self, low: float, high: float) -> Array:
        """Draw from [low, high)."""
        return np.asarray(self.rng.uniform(low, high, self.shape))

    def normal(self, mean: float, spread: float) -> Array:
        """Draw from a normal distribution cut at 2.2 standard deviations."""
        return mean + spread * np.clip(self.rng.normal(size=self.shape), -2.2, 2.2)

    def chance(self, probability: float) -> NDArray[np.bool_]:
        """Draw whether something happens."""
        return np.asarray(self.rng.uniform(size=self.shape) < probability)

    def pick(self, low: float, high: float, skew: float) -> Array:
        """Draw from [low, high) with values near ``low`` more frequent for skew > 1."""
        return low + (high - low) * np.asarray(self.rng.uniform(size=self.shape)) ** skew

    def vector(self, mean: Sequence[float], spread: Sequence[float]) -> Array:
        """Draw vectors, uniform in mean +- spread, (..., len(mean))."""
        m, s = np.asarray(mean, dtype=np.float64), np.asarray(spread, dtype=np.float64)
        return m + s * self.rng.uniform(-1, 1, self.shape + m.shape)

    def mix(self, options: Sequence[Callable[[Draw], Array]], weights: Sequence[float], width: int) -> Array:
        """Draw each value from one of several samplers, chosen at random, (..., width)."""
        p = np.asarray(weights, dtype=np.float64)
        which = self.rng.choice(len(options), size=self.shape, p=p / p.sum())
        out = np.zeros((*self.shape, width))
        for i, option in enumerate(options):
            rows = np.asarray(which) == i
            if rows.any():
                out[rows] = option(Draw(self.rng, (int(rows.sum()),)))
        return out


def ease(fraction: Array) -> Array:
    """Minimum-jerk progress of a movement, 0 to 1 (T. Flash, N. Hogan, J. Neurosci. 5, 1985)."""
    x = np.clip(fraction, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


def wander(
    draw: Draw, t: Array, sampler: Callable[[Draw], Array], move_s: float = 0.9, dwell_s: float = 0.7
) -> Array:
    """Move from one sampled posture to the next, dwelling at each.

    Parameters
    ----------
    draw : Draw
    t : (T,)
        Seconds, increasing from 0 in a clip.
    sampler : callable
        Gives (..., K) values for a `Draw`.
    move_s, dwell_s : float
        Durations of a movement and of a dwell.

    Returns
    -------
    (T, K) float64
    """
    period = move_s + dwell_s
    if draw.is_clip:
        phase = t / period + float(draw.uniform(0.0, 1.0))
        step = np.floor(phase).astype(np.int64)
        keys = sampler(Draw(draw.rng, (int(step.max()) + 2,)))
        before, after = keys[step], keys[step + 1]
        progress = ease((phase - step) * period / move_s)
    else:
        before, after = sampler(draw), sampler(draw)
        progress = ease(draw.uniform(0.0, 1.0) * period / move_s)
    return before + progress[..., None] * (after - before)


def sway(draw: Draw, t: Array, amplitude: float, rate_hz: float = 0.35) -> Array:
    """Slow irregular movement about zero, of about the given amplitude, (T,)."""
    total = np.zeros_like(t)
    for factor in (1.0, 1.7, 2.6):
        total = total + np.sin(2 * np.pi * (rate_hz * factor * t + draw.uniform(0, 1))) / factor
    return amplitude * total * draw.uniform(0.2, 0.8)


def harmonic(phase: Array, points: Sequence[tuple[float, float]], order: int = 6) -> Array:
    """Periodic curve through published control points, as a Fourier series.

    Parameters
    ----------
    phase : (T,)
        In cycles.
    points : sequence of (percent of cycle, value)
    order : int
        Number of harmonics, fitted to the points' periodic cubic spline.
    """
    mean, cosines, sines = _series(tuple(points), order)
    k = np.arange(1, order + 1)
    angle = 2 * np.pi * phase[..., None] * k
    result: Array = mean + np.cos(angle) @ cosines + np.sin(angle) @ sines
    return result


_SERIES: dict[tuple[tuple[tuple[float, float], ...], int], tuple[float, Array, Array]] = {}


def _series(points: tuple[tuple[float, float], ...], order: int) -> tuple[float, Array, Array]:
    from scipy.interpolate import PchipInterpolator

    key = (points, order)
    if key not in _SERIES:
        x = np.array([p for p, _ in points]) / 100.0
        y = np.array([v for _, v in points])
        x, y = np.concatenate([x - 1, x, x + 1]), np.concatenate([y, y, y])
        grid = np.arange(256) / 256.0
        spectrum = np.fft.rfft(PchipInterpolator(x, y)(grid)) / 256.0
        _SERIES[key] = (
            float(spectrum[0].real),
            2 * spectrum[1 : order + 1].real,
            -2 * spectrum[1 : order + 1].imag,
        )
    return _SERIES[key]


def keyed(phase: Array, table: Sequence[tuple[float, dict[str, float]]]) -> Array:
    """Posture at a phase of an action given by key postures.

    Parameters
    ----------
    phase : (T,)
        0 to 1.
    table : sequence of (phase, {angle: degrees})
        Key postures; an angle that a key leaves out stays what it was in the one before.

    Returns
    -------
    (T, 47) float64
        Degrees; monotone cubic interpolation, so that nothing overshoots its keys.
    """
    from scipy.interpolate import PchipInterpolator

    times = np.array([time for time, _ in table])
    keys = np.zeros((len(table), N_ANGLES))
    for i, (_, values) in enumerate(table):
        if i:
            keys[i] = keys[i - 1]
        for name, value in values.items():
            keys[i, ANGLE_INDEX[name]] = value
    result: Array = PchipInterpolator(times, keys)(np.clip(phase, times[0], times[-1]))
    return result


def zero_angles(shape: tuple[int, ...]) -> Array:
    """Angles of the anatomical zero posture, (..., 47)."""
    return np.zeros((*shape, N_ANGLES))


def assemble(
    t: Array, trunk: Array | None = None, arms: Array | None = None, legs: Array | None = None
) -> Array:
    """Combine trunk (..., 15), two arms (..., 18) and two legs (..., 14), (T, 47)."""
    out = zero_angles(t.shape)
    if trunk is not None:
        out[..., TRUNK] = trunk
    if arms is not None:
        out[..., ARM[0].start : ARM[1].stop] = arms
    if legs is not None:
        out[..., LEG[0].start : LEG[1].stop] = legs
    return out


def swap_sides(angles: Array, rows: NDArray[np.bool_]) -> Array:
    """Exchange left and right (mirror the posture) in some rows of (T, 47) angles."""
    out = angles.copy()
    for block in (ARM, LEG):
        out[..., block[0]], out[..., block[1]] = angles[..., block[1]], angles[..., block[0]]
    for name in ("side", "twist"):
        for part in ("pelvis", "spine", "chest", "neck", "head"):
            out[..., ANGLE_INDEX[f"{part}_{name}"]] *= -1.0
    result: Array = np.where(np.asarray(rows)[..., None], out, angles)
    return result
