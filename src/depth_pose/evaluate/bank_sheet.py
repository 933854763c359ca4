"""Contact sheets: exemplars of a bank as the matcher sees them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.bank.views import DISTANCE_M
from depth_pose.body.rendered_depth import render_depth
from depth_pose.core.camera import Camera
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL, quat_to_matrix
from depth_pose.core.skeleton import BONES, JOINT_NODES
from depth_pose.evaluate.overlay import bone_colour
from depth_pose.evaluate.pictures import save_picture
from depth_pose.evaluate.shading import shade_depth

_PIXELS = 150
"""Width and height of an exemplar's image, pixels; for readability."""
_HALF_WIDTH_M = 1.15
"""Half the width of an exemplar's image at the body's distance, metres; a person with raised arms fits."""
_CAMERA = Camera(
    _PIXELS,
    _PIXELS,
    0.5 * _PIXELS * DISTANCE_M / _HALF_WIDTH_M,
    0.5 * _PIXELS * DISTANCE_M / _HALF_WIDTH_M,
    0.5 * (_PIXELS - 1),
    0.5 * (_PIXELS - 1),
)
"""The sheet's camera: it shows `_HALF_WIDTH_M` to each side at the body's distance."""
_COLUMNS = 12
"""Exemplars in a row; for readability."""
_DARK = "#15181d"


def save_contact_sheet(bank: Bank, path: str | Path, count: int = 48) -> None:
    """Draw exemplars, spread evenly over the bank, each in the canonical axes of one of its views.

    Bones are orange on the person's left and blue on the right.

    Parameters
    ----------
    bank : Bank
    path : path
        The picture; folders are made.
    count : int
        Number of exemplars, at most all.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    chosen = np.unique(np.linspace(0, bank.poses - 1, min(count, bank.poses)).round().astype(int))
    columns = min(_COLUMNS, len(chosen))
    rows = -(-len(chosen) // columns)
    figure = Figure(figsize=(1.2 * columns, 1.2 * rows + 0.3), dpi=110, facecolor=_DARK)
    FigureCanvasAgg(figure)
    top = 1 - 0.3 / figure.get_figheight()
    grid = figure.add_gridspec(
        rows, columns, left=0.003, right=0.997, bottom=0.003, top=top, wspace=0.02, hspace=0.02
    )
    for i, exemplar in enumerate(chosen.tolist()):
        axes = figure.add_subplot(grid[divmod(i, columns)])
        _draw_exemplar(axes, bank, exemplar, i % bank.views)
    title = f"{len(chosen)} of {bank.poses} poses, one of {bank.views} views each; bank {bank.bank_id}"
    figure.text(0.006, (1 + top) / 2, title, color="white", fontsize=9, va="center")
    save_picture(figure, path, facecolor=_DARK)


def exemplar_depth(bank: Bank, exemplar: int, view: int) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Render an exemplar in the canonical axes of one of its views.

    Returns
    -------
    depth : (150, 150) float32
        Metres; infinite where there is nothing.
    joints : (19, 3) float64
        In the frame of the sheet's camera, metres.
    """
    turn = R_CAMERA_FACING_MODEL @ quat_to_matrix(bank.view_quats[exemplar, view].astype(np.float64))
    root = np.array([0.0, 0.0, DISTANCE_M]) - turn @ bank.view_origins[exemplar, view].astype(np.float64)
    posed = bank.body.pose(turn @ bank.rotations(exemplar), root)
    return render_depth(posed.vertices, bank.body.faces, _CAMERA), posed.nodes[JOINT_NODES]


def _draw_exemplar(axes: Any, bank: Bank, exemplar: int, view: int) -> None:
    depth, joints = exemplar_depth(bank, exemplar, view)
    shown = np.where(np.isfinite(depth), depth, 0.0).astype(np.float32)
    draw_depth(axes, shown, joints, _CAMERA)
    axes.text(0.03, 0.97, str(exemplar), transform=axes.transAxes, va="top", color="white", fontsize=6)


def draw_depth(
    axes: Any, depth: NDArray[np.float32], joints: NDArray[np.float64] | None, camera: Camera
) -> None:
    """Draw a depth image, (h, w) metres with 0 for nothing, and over it a skeleton, (19, 3), or none."""
    axes.imshow(shade_depth(depth, joints), interpolation="nearest")
    if joints is not None:
        pixels = camera.project(joints)
        for a, b in sorted(BONES, key=lambda bone: -float(joints[list(bone), 2].sum())):
            axes.plot(*pixels[[a, b]].T, color=bone_colour(b), lw=1.4, solid_capstyle="round")
    axes.set(xlim=(-0.5, depth.shape[1] - 0.5), ylim=(depth.shape[0] - 0.5, -0.5), xticks=[], yticks=[])
    axes.set_facecolor(_DARK)
    for spine in axes.spines.values():
        spine.set_visible(False)
