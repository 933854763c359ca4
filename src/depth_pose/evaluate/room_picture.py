"""Picture of a calibrated room from above: cameras, what they see, people's tracks and the walls."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.evaluate.pictures import plain_text, save_picture
from depth_pose.rooms.calibration_result import Calibration

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

_COLOURS = ("#1f9bcf", "#f08a24", "#3a9d5d", "#b0559f", "#8a8f98", "#c44e52")
_LOW_M = 0.15
"""Points of the empty room below this are the floor, metres."""
_REACH_M = 1.2
"""Length of a drawn field of view, metres."""


def save_room_picture(calibration: Calibration, path: Path | str) -> None:
    """Draw a calibrated room from above into a picture file.

    Parameters
    ----------
    calibration : Calibration
    path : Path or str
        The picture; folders are made.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 7.5), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for c, record in enumerate(calibration.records):
        colour = _COLOURS[c % len(_COLOURS)]
        points = calibration.surfaces[c]
        walls = points[points[:, 2] > _LOW_M]
        axes.scatter(walls[:, 0], walls[:, 1], s=1.5, color=colour, alpha=0.25, linewidths=0, zorder=1)
        for places in calibration.places[c]:
            axes.plot(places[:, 0], places[:, 1], color=colour, linewidth=0.9, alpha=0.8, zorder=2)
        T = calibration.T_room_camera[c]
        if record.camera is not None:
            _draw_view(axes, T, record.camera, colour)
        label = f"{plain_text(record.name)}, {T[2, 3]:.2f} m high"
        if c:
            label += f", ± {1e3 * calibration.deviation_m[c]:.0f} mm, {calibration.deviation_deg[c]:.1f}°"
        axes.plot(*T[:2, 3], "o", color=colour, markersize=8, markeredgecolor="black", label=label, zorder=4)
    axes.set_aspect("equal")
    axes.grid(alpha=0.25)
    axes.set_xlabel("x in m: along the first camera's view")
    axes.set_ylabel("y in m")
    axes.set_title("The room from above: dots are walls and furniture, lines are people", fontsize=10)
    figure.legend(loc="outside lower center", fontsize=8, frameon=False)
    width, height = np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())
    figure.set_size_inches(7.5, float(np.clip(7.0 * height / width + 1.2, 3.5, 10.0)))
    save_picture(figure, path)


def _draw_view(axes: Axes, T_room_camera: Array, camera: Camera, colour: str) -> None:
    """Draw the horizontal field of view."""
    middle = camera.height / 2.0
    pixels = np.array([[0.0, middle], [camera.width - 1.0, middle]])
    rays = np.column_stack([(pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy], np.ones(2)])
    rays = (rays @ T_room_camera[:3, :3].T)[:, :2]
    rays *= _REACH_M / np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-6)
    corners = T_room_camera[:2, 3] + np.array([[0.0, 0.0], *rays])
    axes.fill(corners[:, 0], corners[:, 1], color=colour, alpha=0.3, zorder=3)
