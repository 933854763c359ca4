"""Noise model of a depth sensor.

In order: pixels that straddle an edge get a depth between its two surfaces (flying pixels), every
pixel gets Gaussian noise that grows with range and with the angle of incidence, some pixels
return nothing, and the rest is quantised.

The growth with range and angle follows C. V. Nguyen, S. Izadi and D. Lovell, *Modeling
Kinect sensor noise for improved 3D reconstruction and tracking*, 3DIMPVT 2012, and for time
of flight the law of a sensor in ambient light (noise inverse to the light that returns, which
falls with the square of the range and the cosine of the angle); the steps of structured light
follow K. Khoshelham and S. O. Elberink, *Accuracy and resolution of Kinect
depth data*, Sensors 12, 2012, eq. 6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class NoiseConfig:
    """Parameters of the noise: sigma = (constant + linear z + quadratic z^2) / cos(angle)^power."""

    constant: float = 0.002
    """Standard deviation at no distance (m)."""
    linear: float = 0.0
    """Standard deviation gained per metre (m/m)."""
    quadratic: float = 0.0
    """Standard deviation gained per square metre (1/m)."""
    grazing_power: float = 0.5
    """Growth of the noise with the angle of view."""
    edge_jump: float = 0.06
    """Depth step between neighbours that is an edge (m)."""
    flying: float = 0.0
    """Share of edge pixels that land between the surfaces."""
    edge_loss: float = 0.0
    """Share of edge pixels that return nothing."""
    dropout: float = 0.0
    """Share of all pixels that return nothing."""
    grazing_limit: float = 80.0
    """Beyond this angle to the surface's normal most pixels return nothing (deg)."""
    depth_step: float = 0.001
    """Quantisation of depth; 0 for none (m)."""
    disparity_step: float = 0.0
    """Quantisation of 1/depth, as structured light has it; 0 for none (1/m)."""


NO_NOISE = NoiseConfig(constant=0.0, grazing_limit=90.0, depth_step=0.0)
"""An ideal sensor."""


def add_noise(
    depth: NDArray[np.float32],
    incidence_cos: NDArray[np.float32],
    config: NoiseConfig,
    rng: np.random.Generator,
) -> NDArray[np.float32]:
    """Add noise to an ideal depth image.

    Parameters
    ----------
    depth : (H, W) float32
        Ideal depth, metres; 0 where there is no surface.
    incidence_cos : (H, W) float32
        Cosine of the angle between the ray and the surface's normal, 0 to 1.
    config : NoiseConfig
        Parameters of the noise.
    rng : numpy.random.Generator
        Same state, same noise.

    Returns
    -------
    (H, W) float32
        Metres; 0 where nothing returns.
    """
    near, far = _neighbour_range(depth)
    edge = (depth > 0) & (far - near > config.edge_jump)
    draws = rng.random((4, *depth.shape))
    flies = edge & (draws[0] < config.flying)
    # most of a straddling pixel's light comes from one of the surfaces
    mix = 0.5 - 0.5 * np.cos(np.pi * draws[1])
    ideal = np.where(flies, near + (far - near) * mix, depth.astype(np.float64))
    cos = np.clip(incidence_cos.astype(np.float64), 0.05, 1.0)
    sigma = (
        config.constant + config.linear * ideal + config.quadratic * ideal**2
    ) / cos**config.grazing_power
    noisy = ideal + sigma * rng.standard_normal(depth.shape)
    grazing_loss = np.where(incidence_cos < np.cos(np.deg2rad(config.grazing_limit)), 0.7, 0.0)
    lost = (draws[2] < config.dropout) | (draws[3] < grazing_loss)
    lost |= edge & ~flies & (rng.random(depth.shape) < config.edge_loss)
    noisy = np.where((depth > 0) & ~lost & (noisy > 0), noisy, 0.0)
    return _quantise(noisy, config).astype(np.float32)


def _neighbour_range(depth: NDArray[np.float32]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Least and greatest depth among a pixel and its four neighbours that have a surface."""
    padded = np.pad(depth.astype(np.float64), 1)
    around = np.stack(
        [padded[1:-1, 1:-1], padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]]
    )
    near = np.where(around > 0, around, np.inf).min(axis=0)
    return np.where(np.isfinite(near), near, 0.0), around.max(axis=0)


def _quantise(depth: NDArray[np.float64], config: NoiseConfig) -> NDArray[np.float64]:
    if config.disparity_step > 0:
        inverse = np.divide(1.0, depth, out=np.zeros_like(depth), where=depth > 0)
        inverse = np.maximum(np.rint(inverse / config.disparity_step), 1.0) * config.disparity_step
        depth = np.where(depth > 0, 1.0 / inverse, 0.0)
    if config.depth_step > 0:
        depth = np.rint(depth / config.depth_step) * config.depth_step
    return depth
