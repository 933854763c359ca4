"""Vertices of a body's feet: their soles, and the backs of their heels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.core.skeleton import NODE_INDEX

_SOLE_M = 0.012
"""Height of a sole's vertices above the lowest one (m); set by hand."""


def find_balls(body: Body) -> list[NDArray[np.int64]]:
    """Find the lowest vertices of the balls of both feet, left and right."""
    return [_lowest(body, ball) for ball, _ in _feet(body)]


def find_heels(body: Body) -> list[NDArray[np.int64]]:
    """Find the lowest vertices of both heels, left and right."""
    return [_lowest(body, heel) for _, heel in _feet(body)]


def heel_vertices(body: Body) -> NDArray[np.int64]:
    """Find the rearmost vertex of each foot, left and right, (2,)."""
    return np.array([heel[np.argmin(body.vertices[heel, 2])] for _, heel in _feet(body)], np.int64)


def _feet(body: Body) -> list[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Return the vertices of each foot in front of the middle of its bone, and behind."""
    parts = []
    for side in ("left", "right"):
        ankle, ball = (NODE_INDEX[f"{side}_{name}"] for name in ("ankle", "foot"))
        foot = np.flatnonzero(np.isin(body.skin.influence[:, 0], [ankle, ball]))
        behind = body.vertices[foot, 2] < body.nodes[[ankle, ball], 2].mean()
        parts.append((foot[~behind], foot[behind]))
    return parts


def _lowest(body: Body, part: NDArray[np.int64]) -> NDArray[np.int64]:
    height = body.vertices[part, 1]
    return part[height < height.min(initial=np.inf) + _SOLE_M]
