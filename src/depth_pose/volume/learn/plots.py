"""Pictures of the volume tracker: latent space (the paper's Figs. 1, 4) and poses (Fig. 3)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.skeleton import BONES, JOINTS
from depth_pose.core.sketch import side_colour
from depth_pose.evaluate.pictures import save_picture
from depth_pose.volume.gp import Kernel, Regression
from depth_pose.volume.learn.performances import Performance
from depth_pose.volume.learn.report import Report
from depth_pose.volume.model import VolumeModel
from depth_pose.volume.pipeline import VolumePose
from depth_pose.volume.scoring import joint_positions
from depth_pose.volume.tracker import describe_headings

Array = NDArray[np.float64]

_MODEL, _SEEN, _TRACKED = "#2ca02c", "#1f77ff", "#e02020"
_GRID = 120
"""Points along each side of the map of variance."""


def _figure(width: float, height: float) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=110)
    FigureCanvasAgg(figure)
    return figure


def _save(figure: Any, path: Path) -> None:
    save_picture(figure, path, bbox_inches="tight")


def _plane(latent: Array) -> tuple[Array, Array]:
    """Mean and first two principal directions of latent points."""
    mean = latent.mean(axis=0)
    _, _, vt = np.linalg.svd(latent - mean, full_matrices=False)
    return mean, vt[:2]


def _seen_points(model: VolumeModel, poses: Sequence[VolumePose]) -> Array:
    """Latent points regressed from the volumes alone, each under the tracked heading."""
    rows = []
    for p in poses:
        if p.tracked is None:
            continue
        descriptors = describe_headings(p.volume, p.stature, model.bins)[0].descriptors
        components, _ = model.space.split(descriptors[[round(p.tracked.step) % model.bins.fine]])
        rows.append(model.to_latent[p.tracked.views[0]].predict(components)[0])
    return np.array(rows)


def save_latent(model: VolumeModel, reports: Sequence[Report], path: Path, titles: Sequence[str]) -> None:
    """Draw the latent space with its variance, one panel for each report; the first alone without any."""
    figure = _figure(6.2 * max(len(reports), 1), 5.6)
    mean, axes_2d = _plane(model.latent)
    flat = (model.latent - mean) @ axes_2d.T
    plane = Regression(flat, model.volumes[0], Kernel.from_array(model.volume_kernel))
    low, high = flat.min(axis=0) - 0.4, flat.max(axis=0) + 0.4
    x, y = np.meshgrid(np.linspace(low[0], high[0], _GRID), np.linspace(low[1], high[1], _GRID))
    variance = plane.variance(np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape)
    for i in range(max(len(reports), 1)):
        axes = figure.add_subplot(1, max(len(reports), 1), i + 1)
        # red where the model is sure, blue where it is not, as in the paper
        extent = (low[0], high[0], low[1], high[1])
        axes.imshow(
            np.log(variance), extent=extent, origin="lower", cmap="RdYlBu", alpha=0.55, aspect="auto",
            interpolation="bilinear",
        )  # fmt: skip
        first = 0
        for n in model.lengths:
            axes.plot(*flat[first : first + n].T, color=_MODEL, lw=1.0, alpha=0.8,
                      label="learned" if first == 0 else None)  # fmt: skip
            first += int(n)
        if reports:
            seen = (_seen_points(model, reports[i].poses) - mean) @ axes_2d.T
            axes.plot(*seen.T, color=_SEEN, lw=0.7, alpha=0.8, label="volumes, each on its own")
            tracked = np.array([p.tracked.latent for p in reports[i].poses if p.tracked is not None])
            axes.plot(*((tracked - mean) @ axes_2d.T).T, color=_TRACKED, lw=1.3, label="tracked")
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xticks=[], yticks=[])
        axes.set_title(titles[i] if i < len(titles) else "", fontsize=11)
        axes.legend(loc="lower right", fontsize=8)
    _save(figure, path)


def save_report(report: Report, performance: Performance, path: Path, frames: Sequence[int]) -> None:
    """Draw some frames of a tracked performance, each with its time and error."""
    truth = joint_positions(performance.rotations, performance.stature) + performance.pelvis[:, None]
    titles = [f"{i / performance.fps:.1f} s, {report.fitted.frames_deg[i]:.1f}°" for i in frames]
    save_frames([report.poses[i] for i in frames], [truth[i] for i in frames], path, titles)


def save_frames(
    poses: Sequence[VolumePose], truths: Sequence[Array | None], path: Path, titles: Sequence[str]
) -> None:
    """Draw volumes with the found skeleton in colour, and the true one (19, 3) in black, seen from +z."""
    figure = _figure(2.4 * len(poses), 4.2)
    for i, (pose, truth) in enumerate(zip(poses, truths, strict=True)):
        axes = figure.add_subplot(1, len(poses), i + 1)
        surface = pose.volume.surface
        order = np.argsort(surface[:, 2])
        shade = surface[order, 2]
        axes.scatter(*surface[order][:, :2].T, c=shade, cmap="Greys", s=2.0, alpha=0.35, linewidths=0)
        if truth is not None:
            _bones(axes, truth, "black", 1.2)
        if not pose.skeleton.is_lost:
            _bones(axes, pose.skeleton.positions, None, 2.6)
        centre = surface[:, 0].mean() if len(surface) else 0.0
        axes.set(xlim=(centre - 0.85, centre + 0.85), ylim=(-0.05, 2.2), xticks=[], yticks=[], aspect="equal")
        axes.set_title(titles[i] if i < len(titles) else "", fontsize=9)
    _save(figure, path)


def _bones(axes: Any, joints: Array, colour: str | None, width: float) -> None:
    for a, b in BONES:
        axes.plot(
            joints[[a, b], 0], joints[[a, b], 1], color=colour or side_colour(JOINTS[b]), lw=width,
            solid_capstyle="round", zorder=3 if colour is None else 4,
        )  # fmt: skip
