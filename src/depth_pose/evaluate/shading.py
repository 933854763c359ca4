"""Render depth images for viewing: colour for distance, shading for shape."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_NO_RETURN = (0.082, 0.094, 0.114)
"""Colour of pixels without depth: red, green, blue, 0 to 1; for readability."""
_TONES = np.linspace(0.0, 1.0, 5)
_CIVIDIS = np.array([[0, 67, 125, 188, 254], [34, 78, 124, 175, 232], [78, 108, 120, 111, 56]]) / 255.0
"""Red, green and blue of the colour map cividis (Nunez et al. 2018) at five of its values."""
_SURFACE_JUMP = 0.12
"""Depth farther than this from its smoothed value is an edge and not smoothed, metres. For readability."""


def shade_depth(
    depth: NDArray[np.float32], positions: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Colour a depth image by distance and shade it like a relief lit from above.

    Parameters
    ----------
    depth : (H, W) float32
        Metres; 0 or NaN where nothing returned.
    positions : (N, 3) float64, optional
        Joints of the person: the colours spread over their range of depth.

    Returns
    -------
    (H, W, 3) float64
        Red, green, blue, 0 to 1.
    """
    valid = np.isfinite(depth) & (depth > 0)
    if not valid.any():
        return np.full((*depth.shape, 3), _NO_RETURN)
    if positions is not None and np.isfinite(positions[:, 2]).any():
        near, far = np.nanmin(positions[:, 2]) - 0.35, np.nanmax(positions[:, 2]) + 0.45
    else:
        near, far = np.percentile(depth[valid], [1, 97])
    share = np.clip((np.where(valid, depth, far) - near) / max(far - near, 0.3), 0, 1)
    colour = np.stack([np.interp(1.0 - 0.86 * share, _TONES, tone) for tone in _CIVIDIS], axis=-1)
    colour = 0.45 * colour + 0.55 * colour.mean(axis=-1, keepdims=True)  # muted: the bones carry the colour
    shaded = colour * (0.45 + 0.55 * _relief(np.where(valid, depth, 0.0)))[..., None]
    picture: NDArray[np.float64] = np.where(valid[..., None], shaded, np.array(_NO_RETURN))
    return picture


def _relief(depth: NDArray[np.floating]) -> NDArray[np.float64]:
    """Cosine between each pixel's surface and a light above the camera, 0 to 1."""
    from scipy.ndimage import gaussian_filter

    radius = max(1.0, depth.shape[0] / 200)
    weight = gaussian_filter((depth > 0).astype(float), radius)
    smooth = gaussian_filter(depth.astype(float), radius) / np.maximum(weight, 1e-6)
    # across an edge, the smoothed surface belongs to neither side
    smooth = np.where(np.abs(smooth - depth) < _SURFACE_JUMP, smooth, depth)
    dz_dv, dz_du = np.gradient(smooth)
    pixel = np.maximum(smooth, 0.1) / (1.3 * depth.shape[0])
    slope_u, slope_v = np.clip(dz_du / pixel, -3, 3), np.clip(dz_dv / pixel, -3, 3)
    light = np.array([-0.25, -0.5, -0.83])
    normal = np.stack([slope_u, slope_v, -np.ones_like(slope_u)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    cosine: NDArray[np.float64] = normal @ light / np.linalg.norm(light)
    return cosine.clip(0.0, 1.0)
