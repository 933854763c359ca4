"""Contact sheets: skeletons drawn over their depth images."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import BONES, JOINT_INDEX, JOINTS, JointState
from depth_pose.core.sketch import LEFT, MIDDLE, RIGHT, side_colour
from depth_pose.evaluate.panels import Panel, collect_panels, project
from depth_pose.evaluate.pictures import plain_text, save_picture
from depth_pose.evaluate.shading import shade_depth
from depth_pose.io.schemas import PEOPLE_TOPIC
from depth_pose.rooms.placed_camera import PlacedCamera

_PANEL_INCHES = (2.9, 3.6)
"""Width and height of a panel among three or more columns; for readability."""
_MOST_COLUMNS = 6
"""Maximum number of panels in a row; for readability."""
_CROP_MARGIN = 0.22
"""Margin around the skeletons, as a share of their larger extent; for readability."""
_MOST_DRAWN = 40
"""Maximum number of people drawn in a frame, by confidence: each takes 20 ms."""
_TRUTH, _DARK = "#ffffff", "#15181d"
_LEAST_COLUMNS_FOR_ONE_LINE = 4
"""With fewer columns the title gets a line above the legend; for readability."""


def save_overlay(
    recording_path: Path | str,
    skeleton_path: Path | str,
    png_path: Path | str,
    frames: int = 6,
    truth_path: Path | str | None = None,
    *,
    depth_topic: str | None = None,
    skeleton_topic: str = PEOPLE_TOPIC,
    camera: PlacedCamera | None = None,
) -> None:
    """Draw the skeletons over the depth of several frames, spread over the recording.

    Bones are orange on the person's left and blue on the right; joints go from green to red
    with falling confidence, and are hollow where the joint is hidden.

    Parameters
    ----------
    recording_path : Path or str
        The depth recording.
    skeleton_path : Path or str
        The recording of its skeletons; may be the same file.
    png_path : Path or str
        The picture; folders are made.
    frames : int
        Number of frames to show.
    truth_path : Path or str, optional
        A truth file; its skeletons are drawn dashed. For one person each frame's error is shown.
    depth_topic, skeleton_topic : str, optional
        The topics.
    camera : PlacedCamera, optional
        The camera of the depth recording; needed where skeletons or truth are in a room's frame.

    Raises
    ------
    InputError
        Where a file cannot be used.
    ConfigError
        Where the camera is needed and not given.
    """
    panels = collect_panels(
        recording_path, skeleton_path, frames, truth_path, depth_topic, skeleton_topic, camera
    )
    draw_sheet(panels, Path(png_path), Path(recording_path).stem)


def draw_sheet(panels: list[Panel], path: Path, title: str) -> None:
    """Draw panels, at least one, into a PNG file; folders are made."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns = min(len(panels), _MOST_COLUMNS)
    if len(panels) > _MOST_COLUMNS:
        columns = -(-len(panels) // -(-len(panels) // _MOST_COLUMNS))
    rows = -(-len(panels) // columns)
    larger = {1: 2.2, 2: 1.3}.get(columns, 1.0)
    width, height = larger * _PANEL_INCHES[0], larger * _PANEL_INCHES[1]
    footer = 0.42 if columns >= _LEAST_COLUMNS_FOR_ONE_LINE else 0.68
    figure = Figure(figsize=(columns * width, rows * height + footer + 0.13), dpi=120, facecolor=_DARK)
    FigureCanvasAgg(figure)
    bottom = footer / figure.get_figheight()
    grid = figure.add_gridspec(
        rows,
        columns,
        left=0.006,
        right=0.994,
        top=1 - 0.05 / figure.get_figheight(),
        bottom=bottom,
        wspace=0.025,
        hspace=0.03,
    )
    for i, panel in enumerate(panels):
        _draw_panel(figure.add_subplot(grid[divmod(i, columns)]), panel, width / height)
    _draw_legend(figure, title, any(len(p.truth) for p in panels))
    save_picture(figure, path, facecolor=figure.get_facecolor())


def _draw_panel(axes: Any, panel: Panel, aspect: float) -> None:
    frame = panel.frame
    skeletons = sorted(panel.skeletons or (), key=lambda s: -s.confidence)[:_MOST_DRAWN]
    shown = [s.positions for s in skeletons] + list(panel.truth)
    positions = np.concatenate(shown) if shown else None
    left, right, top, bottom = _crop(positions, frame.camera, aspect)
    axes.imshow(shade_depth(frame.depth, positions), interpolation="nearest")
    axes.set(xlim=(left, right), ylim=(bottom, top), xticks=[], yticks=[], facecolor=_DARK)
    for spine in axes.spines.values():
        spine.set_visible(False)
    for known in panel.truth:
        pixels = project(known, frame.camera)
        for a, b in BONES:
            axes.plot(*pixels[[a, b]].T, color=_TRUTH, lw=1.1, ls=(0, (3, 2)), zorder=3, alpha=0.85)
    for skeleton in sorted(skeletons, key=lambda s: -float(s.positions[0, 2])):
        _draw_skeleton(axes, skeleton, frame.camera)
        if len(skeletons) > 1:
            _draw_name(axes, skeleton, frame.camera)
    _label(axes, panel)


def _crop(
    positions: NDArray[np.float64] | None, camera: Camera, aspect: float
) -> tuple[float, float, float, float]:
    """Left, right, top and bottom of the part to show, of the given width by height."""
    low, high = np.array([-0.5, -0.5]), np.array([camera.width - 0.5, camera.height - 0.5])
    image_low, image_high = low, high
    if positions is not None:
        pixels = project(positions, camera)
        pixels = pixels[np.isfinite(pixels).all(axis=1)]
        if len(pixels):
            margin = _CROP_MARGIN * max(np.ptp(pixels, axis=0).max(), 16.0)
            low, high = pixels.min(axis=0) - margin, pixels.max(axis=0) + 0.6 * margin
    centre, size = (low + high) / 2, high - low
    half = max(size[0], size[1] * aspect) / 2 * np.array([1.0, 1 / aspect])
    # stay inside the image where it is large enough
    room = np.maximum(image_high - image_low - 2 * half, 0.0)
    middle = (image_low + image_high) / 2
    centre = np.clip(centre, middle - room / 2, middle + room / 2)
    return centre[0] - half[0], centre[0] + half[0], centre[1] - half[1], centre[1] + half[1]


def bone_colour(child: int) -> str:
    """Return the colour of the bone that ends at a joint."""
    return side_colour(JOINTS[child])


def _draw_skeleton(axes: Any, skeleton: Skeleton, camera: Camera) -> None:
    from matplotlib import colormaps
    from matplotlib.patheffects import Normal, Stroke

    pixels = project(skeleton.positions, camera)
    dark = [Stroke(linewidth=5.2, foreground="#0b0d10"), Normal()]
    order = sorted(BONES, key=lambda bone: -float(np.nansum(skeleton.positions[list(bone), 2])))
    for a, b in order:
        colour = bone_colour(b) if bone_colour(b) != MIDDLE else "#f4f4f4"
        axes.plot(
            *pixels[[a, b]].T, color=colour, lw=3.0, zorder=4, path_effects=dark, solid_capstyle="round"
        )
    colours = colormaps["RdYlGn"](np.clip(skeleton.joint_confidence.astype(float), 0, 1))
    hidden = skeleton.joint_states != JointState.SEEN
    colours_inside = np.where(hidden[:, None], np.array([0.04, 0.05, 0.06, 1.0]), colours)
    edges = np.where(hidden[:, None], colours, np.array([0.04, 0.05, 0.06, 1.0]))
    axes.scatter(*pixels.T, s=27, c=colours_inside, edgecolors=edges, linewidths=1.3, zorder=5)


def _draw_name(axes: Any, skeleton: Skeleton, camera: Camera) -> None:
    """Write the person's id and confidence above the head."""
    u, v = project(skeleton.positions[JOINT_INDEX["head"]], camera)
    text = f"{plain_text(skeleton.body_id)} {skeleton.confidence:.2f}"
    box = {"facecolor": _DARK, "alpha": 0.6, "edgecolor": "none", "pad": 1.5}
    style = {"color": "white", "fontsize": 7, "ha": "center", "va": "bottom", "zorder": 6, "clip_on": True}
    axes.annotate(text, (u, v), (0, 9), textcoords="offset points", bbox=box, **style)


def _label(axes: Any, panel: Panel) -> None:
    """Write the time and the result."""
    text, skeletons = f"{plain_text(panel.name)}  {panel.seconds:.2f} s  ".lstrip(), panel.skeletons
    if skeletons is None:
        text += "no answer"
    elif not skeletons:
        text += "nobody in view"
    elif len(skeletons) > 1:
        text += f"{len(skeletons)} people"
        text += f", {_MOST_DRAWN} drawn" if len(skeletons) > _MOST_DRAWN else ""
    else:
        text += f"{skeletons[0].source.name.lower()}  {skeletons[0].confidence:.2f}"
        if len(panel.truth) == 1:
            error = np.nanmean(np.linalg.norm(skeletons[0].positions - panel.truth[0], axis=1))
            text += f"  {error * 1e3:.0f} mm"
    box = {"facecolor": _DARK, "alpha": 0.75, "edgecolor": "none", "pad": 2.5}
    axes.text(
        0.03, 0.975, text, transform=axes.transAxes, va="top", color="white", fontsize=8.5, bbox=box, zorder=6
    )


def _draw_legend(figure: Any, title: str, with_truth: bool) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=LEFT, lw=3, label="person's left"),
        Line2D([], [], color=RIGHT, lw=3, label="person's right"),
        Line2D([], [], color="#1a9850", marker="o", lw=0, label="certain"),
        Line2D([], [], color="#d73027", marker="o", lw=0, label="uncertain"),
        Line2D([], [], color="#1a9850", marker="o", lw=0, mfc="none", mew=1.5, label="hidden"),
    ]
    if with_truth:
        handles.append(Line2D([], [], color=_TRUTH, lw=1.1, ls=(0, (3, 2)), label="known pose"))
    figure.legend(
        handles=handles,
        loc="lower right",
        ncols=len(handles),
        frameon=False,
        fontsize=8.5 if figure.get_figwidth() > 7.4 else 7.5,
        labelcolor="white",
        borderaxespad=0.3,
        handletextpad=0.5,
        columnspacing=1.3,
    )
    above = 0.16 if figure.get_figwidth() > _LEAST_COLUMNS_FOR_ONE_LINE * _PANEL_INCHES[0] - 0.1 else 0.47
    figure.text(
        0.008, above / figure.get_figheight(), plain_text(title), color="white", fontsize=10, va="center"
    )
