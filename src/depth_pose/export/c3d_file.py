"""Writer of C3D files, the format of motion laboratories (c3d.org), by the package c3d.

A joint is a point; frames without the person have points of residual -1, which readers take for missing.
"""

from __future__ import annotations

import warnings
from typing import BinaryIO

import numpy as np

from depth_pose.core.errors import InputError
from depth_pose.core.skeleton import JOINTS
from depth_pose.export.tracks import Track

_MOST_FRAMES = 65_535
"""Maximum number of frames: its header counts them in 16 bits."""


def write_c3d(stream: BinaryIO, track: Track, step_s: float, unit: str, factor: float) -> None:
    """Write a C3D file of a motion at an even rate, y up.

    Parameters
    ----------
    stream : binary file
    track : Track
    step_s : float
        Time between frames, seconds.
    unit : str
        ``m``, ``cm`` or ``mm``.
    factor : float
        Units in a metre.

    Raises
    ------
    InputError
        Where there are more than 65,535 frames.
    """
    if len(track) > _MOST_FRAMES:
        raise InputError(
            f"{track.body_id} has {len(track)} frames; a .c3d holds at most {_MOST_FRAMES}: write .trc"
        )
    import c3d

    writer = c3d.Writer(point_rate=1.0 / step_s, point_scale=-1.0, point_units=f"{unit:4}")
    writer.set_point_labels(list(JOINTS))
    writer.set_screen_axis("+X", "+Y")
    points = np.zeros((len(track), len(JOINTS), 5), np.float32)
    points[..., :3] = np.nan_to_num(track.positions * factor)
    points[~np.isfinite(track.positions).all(axis=-1), 3] = -1.0
    no_analog = np.zeros((0, 0), np.float32)
    writer.add_frames([(frame, no_analog) for frame in points])
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "No analog data")
        writer.write(stream)
