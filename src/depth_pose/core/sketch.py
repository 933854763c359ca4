"""Stick figures of skeletons, for notebooks and plots."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.extras import require
from depth_pose.core.skeleton import BONES, JOINTS

Array = NDArray[np.float64]

LEFT, RIGHT, MIDDLE = "#f08a24", "#1f9bcf", "#8a8f98"
"""Colours of the person's left, right and middle, the same in every picture."""

_SVG_PIXELS, _MARGIN_M = 260, 0.12
"""Height of a sketch in a notebook, and the margin around the joints; for readability."""


def side_colour(joint: str) -> str:
    """Return the colour of a joint's side."""
    if joint.startswith("left_"):
        return LEFT
    return RIGHT if joint.startswith("right_") else MIDDLE


def html(figures: Sequence[tuple[Array, NDArray[np.float32]]], caption: str) -> str:
    """Return stick figures as HTML with an SVG picture, as the camera sees them without perspective.

    Parameters
    ----------
    figures : sequence of ((19, 3), (19,)) arrays
        Joints, camera frame, metres, and their confidences; uncertain bones are pale. Lost ones are empty.
    caption : str
        Text below the picture.
    """
    text = f"<div><code>{escape(caption)}</code></div>"
    known = [figure for figure in figures if len(figure[0])]
    if not known:
        return text
    places = np.concatenate([positions[:, :2] for positions, _ in known])
    low, high = places.min(axis=0) - _MARGIN_M, places.max(axis=0) + _MARGIN_M
    width, height = high - low
    lines = []
    for positions, confidence in sorted(known, key=lambda figure: -float(figure[0][0, 2])):
        for a, b in BONES:
            (x1, y1), (x2, y2) = positions[[a, b], :2] - low
            sure = 0.25 + 0.75 * float(min(confidence[a], confidence[b]))
            lines.append(
                f'<line x1="{x1:.3f}" y1="{y1:.3f}" x2="{x2:.3f}" y2="{y2:.3f}" '
                f'stroke="{side_colour(JOINTS[b])}" stroke-opacity="{sure:.2f}"/>'
            )
    return (
        f'<div><svg xmlns="http://www.w3.org/2000/svg" height="{_SVG_PIXELS}" '
        f'viewBox="0 0 {width:.3f} {height:.3f}" stroke-width="0.03" stroke-linecap="round">'
        f"{''.join(lines)}</svg>{text}</div>"
    )


def plot(figures: Sequence[Array], axes: Any = None) -> Any:
    """Draw stick figures into 3D axes of matplotlib, upright; return the axes.

    Parameters
    ----------
    figures : sequence of (19, 3) arrays
        Joints, camera frame, metres; lost ones are empty.
    axes : matplotlib axes in 3D, optional
        New ones by default.

    Raises
    ------
    ConfigError
        Where matplotlib is not installed.
    """
    require("matplotlib", "plot")
    from matplotlib.ticker import MaxNLocator

    if axes is None:
        from matplotlib import pyplot

        axes = pyplot.figure(figsize=(5, 5)).add_subplot(projection="3d")
    for positions in (figure for figure in figures if len(figure)):
        for a, b in BONES:
            x, y, z = positions[[a, b]].T
            axes.plot(x, z, -y, color=side_colour(JOINTS[b]), lw=3, solid_capstyle="round")
    axes.set(xlabel="x: right (m)", ylabel="z: away (m)", zlabel="-y: up (m)")
    axes.set_aspect("equal")
    axes.yaxis.set_major_locator(MaxNLocator(2))
    axes.view_init(elev=15, azim=-65)
    return axes
