"""A stereo camera: effects of block matching and of a driver's filters on the ideal depth of a scene.

Errors are in disparity, focal length times baseline by depth, so those of depth grow with its square. A
window is matched as one: its error is the same for neighbours (smooth bumps), near objects grow over their
edges (foreground fattening), and objects thinner than the window may vanish. Along rows edges are displaced
to either side (streaks), and weak surfaces are matched with others on the row, nearer or farther. Pixels
seen by only one camera, at the left of near objects, are lost, and so are those with too little texture. Then
drivers smooth (across steps below a limit), fill holes, and resample to a colour camera.

D. Scharstein and R. Szeliski, *A taxonomy and evaluation of dense two-frame stereo correspondence
algorithms*, IJCV 47, 2002; L. Keselman et al., *Intel RealSense stereoscopic depth cameras*, CVPR workshops
2017.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import grey_opening, maximum_filter, minimum_filter, uniform_filter

from depth_pose.sim._scene_kernels import cast_shadow, look_aside
from depth_pose.sim._stereo_kernels import fill_holes, smooth_rows
from depth_pose.sim.fields import smooth_field, streaky_field

Image = NDArray[np.float32]

_WEAK_LEAST, _WEAK_GAIN = 3.5, 2.5
"""Weakness of a surface (a unit field, and up to 2 for dark ones) above which it is lost. Set by eye."""
_WRONG_LEAST = 4.0
"""The same above which it is matched wrongly. Set by eye."""
_NEARER = np.float32(0.2)
"""Mean of wrong matches' disparity, deviations: more are nearer than farther."""
_LOGISTIC = 1.702
"""A normal distribution's quantile is about the logit divided by this."""


@dataclass(frozen=True)
class StereoConfig:
    """Parameters of a stereo camera's matching and driver; lengths in its own pixels."""

    baseline: float = 0.05
    """Left to right camera (m)."""
    window: int = 7
    """Side of the matching window (pixels)."""
    fattening: float = 0.6
    """Share of edges over which near surfaces grow."""
    thin: float = 0.3
    """Share of objects thinner than half a window that vanish."""
    error: float = 0.13
    """Standard deviation of disparity (pixels)."""
    blob: float = 9.0
    """Size of the bumps of that error (pixels)."""
    flat: float = 1.5
    """Steps of disparity within a window that are matched as one surface (pixels)."""
    step: float = 1 / 32
    """Steps of disparity (pixels)."""
    lost: float = 0.1
    """Share of weak surfaces (dark, slanted, without texture) lost."""
    edge_loss: float = 0.2
    """Share of edges lost."""
    smoothing: float = 0.5
    """The driver's spatial filter: weight of neighbours."""
    smooth_step: float = 0.6
    """Steps of disparity that it smooths over (pixels)."""
    temporal: float = 0.3
    """The driver's temporal filter: share of the error that it removes."""
    fill: int = 0
    """Holes: 0 left, 1 filled from the left, 2 from the farther side, 3 from the nearer."""
    rim: float = 0.0
    """Standard deviation of the edges' displacement along rows (pixels)."""
    mismatch: float = 0.0
    """Share of weak surfaces that are matched wrongly, too near or too far."""
    jump: float = 4.0
    """Standard deviation of disparity where matched wrongly (pixels)."""
    margin: int = 0
    """Columns that the second camera does not show: 0 matched all the same, 1 lost."""
    colour_offset: float = 0.0
    """Depth is aligned to a colour camera this far to the right; 0 for none (m)."""

    def scaled(self, factor: float) -> StereoConfig:
        """Return the same camera with images scaled in width by a factor."""
        return replace(
            self,
            window=max(1, round(self.window * factor)),
            error=self.error * factor,
            blob=max(1.0, self.blob * factor),
            flat=self.flat * factor,
            step=self.step * factor,
            smooth_step=self.smooth_step * factor,
            rim=self.rim * factor,
            jump=self.jump * factor,
        )


def measure_stereo(
    depth: Image, light: Image, focal: float, config: StereoConfig, rng: np.random.Generator
) -> Image:
    """Measure ideal depth with a stereo camera.

    Parameters
    ----------
    depth : (H, W) float32
        Metres; 0 where there is nothing.
    light : (H, W) float32
        Quality of matching a surface, about 1; less where it is dark or slanted.
    focal : float
        Pixels.
    config : StereoConfig
    rng : numpy.random.Generator
        Same state, same noise.

    Returns
    -------
    (H, W) float32
        Metres; 0 where nothing is matched.
    """
    shape, reach = depth.shape, focal * config.baseline
    shadow = np.zeros(shape, np.bool_)
    cast_shadow(depth, reach, 1.0, shadow)
    ideal = np.divide(reach, depth, out=np.zeros(shape, np.float32), where=depth > 0)
    matched, edge = _match(ideal, config, rng)
    lost = shadow
    if config.margin:
        lost |= np.arange(shape[1]) < ideal
    if config.rim > 0:
        matched = _displace_edges(matched, edge, config, rng)
    if config.lost > 0:
        weak = smooth_field(rng, shape, config.blob) + 2.0 * (1.0 - np.minimum(light, 1.0))
        lost |= weak > _WEAK_LEAST - _WEAK_GAIN * config.lost
    if config.mismatch > 0:
        matched = _match_wrongly(matched, light, config, rng)
    if config.edge_loss > 0:
        lost |= edge & (smooth_field(rng, shape, 4.0) > _threshold(config.edge_loss))
    error = config.error * (1.0 - config.temporal) / np.clip(light, 0.3, 1.0)
    bumps = 0.85 * smooth_field(rng, shape, config.blob) + 0.5 * smooth_field(rng, shape, 0.3 * config.blob)
    disparity = np.where(lost | (matched <= 0), np.float32(0), np.maximum(matched + error * bumps, 0.05))
    if config.step > 0:
        disparity = np.rint(disparity / config.step) * config.step
    return _filter(disparity.astype(np.float32), reach, config, rng)


def _match(ideal: Image, config: StereoConfig, rng: np.random.Generator) -> tuple[Image, NDArray[np.bool_]]:
    """Match windows: thin objects vanish, near ones grow, flat surfaces are averaged. Also return edges."""
    matched, shape = ideal, ideal.shape
    thin, half = max(1, config.window // 2), config.window // 2
    if config.thin > 0 and thin > 1:
        opened = grey_opening(matched, (thin, thin))
        matched = np.where(
            smooth_field(rng, shape, 2.0 * config.window) > _threshold(config.thin), opened, matched
        )
    if config.fattening > 0 and half > 0:
        grown = maximum_filter(matched, 2 * half + 1)
        grows = smooth_field(rng, shape, 1.5 * config.window) > _threshold(config.fattening)
        matched = np.where(grows, grown, matched)
    high, low = maximum_filter(matched, config.window), minimum_filter(matched, config.window)
    flat = (high - low < config.flat) & (low > 0)
    matched = np.where(flat, uniform_filter(matched, config.window), matched)
    return matched.astype(np.float32), (high - low) > config.flat


def _displace_edges(
    matched: Image, edge: NDArray[np.bool_], config: StereoConfig, rng: np.random.Generator
) -> Image:
    """Displace edges along rows by streaks: near surfaces grow or shrink, a few rows at once."""
    long = max(2.0, 1.5 * config.rim)
    around = maximum_filter(edge, (1, 2 * int(2 * config.rim) + 1))
    across = np.float32(config.rim) * streaky_field(rng, matched.shape, 1.5, long)
    out = np.empty_like(matched)
    look_aside(matched, np.zeros_like(across), np.where(around, across, np.float32(0.0)), out)
    return out


def _match_wrongly(matched: Image, light: Image, config: StereoConfig, rng: np.random.Generator) -> Image:
    """Match weak surfaces with another place on the row: patches longer than high, nearer or farther."""
    shape, high = matched.shape, max(1.5, 0.4 * config.window)
    weak = streaky_field(rng, shape, high, 2.5 * high) + 2.0 * (1.0 - np.minimum(light, 1.0))
    wrong = (weak > _WRONG_LEAST - _WEAK_GAIN * config.mismatch) & (matched > 0)
    off = np.float32(config.jump) * (streaky_field(rng, shape, high, 2.0 * high) + _NEARER)
    return np.where(wrong, np.maximum(matched + off, np.float32(0.05)), matched)


def _filter(disparity: Image, reach: float, config: StereoConfig, rng: np.random.Generator) -> Image:
    """Apply the driver's filters: smooth, fill holes, align."""
    if config.fill:
        fill_holes(disparity, config.fill, int(6 * config.window))
    if config.smoothing > 0:
        alpha, delta = np.float32(1.0 - config.smoothing), np.float32(config.smooth_step)
        turned = np.ascontiguousarray(disparity.T)
        for _ in range(2):
            smooth_rows(turned, alpha, delta)
            disparity = np.ascontiguousarray(turned.T)
            smooth_rows(disparity, alpha, delta)
            turned = np.ascontiguousarray(disparity.T)
    depth = np.divide(reach, disparity, out=np.zeros_like(disparity), where=disparity > 0)
    if config.colour_offset:
        depth = _align(depth, reach * config.colour_offset / config.baseline, rng)
    return depth


def _align(depth: Image, reach: float, rng: np.random.Generator) -> Image:
    """Resample as alignment to another camera does: rows and columns repeat, hidden pixels are lost."""
    hidden = np.zeros(depth.shape, np.bool_)
    cast_shadow(depth, -reach, 1.5, hidden)
    depth = np.where(hidden, np.float32(0), depth)
    coarse = rng.uniform(1.0, 1.8)
    rows, columns = ((np.floor(np.arange(n) / coarse + 0.5) * coarse).astype(int) for n in depth.shape)
    return depth[np.minimum(rows, len(rows) - 1)[:, None], np.minimum(columns, len(columns) - 1)]


def _threshold(share: float) -> float:
    """Return the value that a smooth field exceeds in about a given share of the image."""
    return float(np.log((1.0 - share + 1e-3) / (share + 1e-3)) / _LOGISTIC)
