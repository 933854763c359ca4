"""Pictures of scores."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from depth_pose.core.sketch import side_colour
from depth_pose.evaluate.pictures import plain_text, save_picture
from depth_pose.evaluate.score import Score


def save_joint_errors(score: Score, path: Path | str, title: str = "") -> None:
    """Draw the error of each joint as bars, with the offset-free error as a mark, into a PNG file.

    Parameters
    ----------
    score : Score
        The score.
    path : Path or str
        The picture; folders are made.
    title : str
        Text above the numbers.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    names = list(score.joints)
    errors = np.array([score.joints[name].mean_error_mm for name in names])
    offset_free = np.array([score.joints[name].offset_free_mm for name in names])
    rows = np.arange(len(names))
    figure = Figure(figsize=(8.0, 6.4), dpi=130)
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.barh(rows, np.nan_to_num(errors), color=[side_colour(n) for n in names], height=0.72, alpha=0.9)
    axes.scatter(offset_free, rows, marker="|", s=170, color="black", linewidths=1.8, zorder=3)
    most = float(np.nanmax(np.concatenate([errors, offset_free, [1.0]])))
    for row, name in enumerate(names):
        joint = score.joints[name]
        text = (
            f"{joint.mean_error_mm:.0f} mm   {joint.pck10:.0%}" if np.isfinite(errors[row]) else "no answer"
        )
        reach = np.nanmax([errors[row], offset_free[row], 0.0])
        axes.text(reach + 0.02 * most, row, text, va="center", fontsize=8, color="#333333")
    axes.set_yticks(rows, [name.replace("_", " ") for name in names])
    axes.invert_yaxis()
    axes.set_xlim(0, 1.25 * most)
    axes.set_xlabel(
        "mean error in mm; mark: without the joint's constant offset; percent: share within 10 cm"
    )
    axes.grid(axis="x", alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    numbers = (
        f"{score.mean_error_mm:.1f} mm, offset-free {score.offset_free_mm:.1f} mm, "
        f"within 10 cm {score.pck10:.1%}, coverage {score.coverage:.1%} of {score.frames} frames"
    )
    axes.set_title(f"{plain_text(title)}\n{numbers}" if title else numbers, fontsize=10, loc="left")
    figure.tight_layout()
    save_picture(figure, path)
