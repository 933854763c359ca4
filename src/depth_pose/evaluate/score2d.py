"""Score skeletons against 2D joints of an image, in pixels, for real frames without truth.

The reference is a JSON list, one entry per depth frame in the recording's order, each with the
joints' ``[u, v, visibility]``. Distances are relative to the person's height in pixels.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import InputError
from depth_pose.core.frame import DepthFrame
from depth_pose.core.reading import parse_json, read_text
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.evaluate.panels import project
from depth_pose.evaluate.truth import require_camera_frame
from depth_pose.io.mcap_read import DepthReader
from depth_pose.io.schemas import SKELETON_TOPIC
from depth_pose.io.skeleton_read import read_skeletons

_MOST_BYTES = 1 << 28
"""Largest reference file: 256 MiB, some ten hours at 30 frames a second."""

LEAST_VISIBILITY = 0.5
"""Reference joints less visible than this are not scored."""


@dataclass(frozen=True)
class Score2D:
    """Agreement with a 2D reference.

    Attributes
    ----------
    frames, answered : int
        Frames of the reference, and those with a skeleton.
    joints : int
        Visible reference joints; one without an answer counts as a miss.
    within_10, within_05 : float
        Share of them within 0.10 and 0.05 of the person's height in pixels.
    median : float
        Median distance of the answered ones, as a share of the height; NaN if there are none.
    per_joint : mapping of str to float
        Share within 0.10 of each joint.
    per_frame : tuple of float
        Share within 0.10 of each frame; NaN where no joint is visible.
    """

    frames: int
    answered: int
    joints: int
    within_10: float
    within_05: float
    median: float
    per_joint: Mapping[str, float]
    per_frame: tuple[float, ...]


def score_2d(
    recording: Path | str,
    skeletons: Path | str,
    reference: Path | str,
    topic: str = SKELETON_TOPIC,
    depth_topic: str | None = None,
) -> Score2D:
    """Compare skeletons with a 2D reference.

    Parameters
    ----------
    recording : Path or str
        The depth recording: its cameras project the joints, its images define the persons' heights.
    skeletons : Path or str
        The recording of the skeletons.
    reference : Path or str
        The JSON file.
    topic : str
        The skeletons' topic.
    depth_topic : str, optional
        The depth topic, where there are several.

    Raises
    ------
    InputError
        Where a file cannot be used, or the reference has another number of frames.
    """
    known = load_reference(Path(reference))
    frames = list(DepthReader(recording, depth_topic))
    if len(frames) != len(known):
        raise InputError(f"{reference} has {len(known)} frames, {recording} has {len(frames)}")
    answers = {s.stamp_ns: s for s in read_skeletons(skeletons, topic)}
    for skeleton in list(answers.values())[:1]:
        require_camera_frame(skeletons, skeleton.frame_id)
    found = [answers.get(frame.stamp_ns) for frame in frames]
    distances = [_distances(f, s, k) for f, s, k in zip(frames, found, known, strict=True)]
    rows = [(name, d) for frame in distances for name, d in frame.items()]
    if not rows:
        raise InputError(f"{reference} has no visible joint")
    values = np.array([d for _, d in rows])
    finite = values[np.isfinite(values)]
    names = sorted({name for name, _ in rows}, key=JOINT_INDEX.__getitem__)
    return Score2D(
        frames=len(frames),
        answered=sum(s is not None and not s.is_lost for s in found),
        joints=len(values),
        within_10=float((values < 0.10).mean()),
        within_05=float((values < 0.05).mean()),
        median=float(np.median(finite)) if finite.size else float("nan"),
        per_joint={n: float(np.mean([d < 0.10 for name, d in rows if name == n])) for n in names},
        per_frame=tuple(
            float(np.mean([d < 0.10 for d in frame.values()])) if frame else float("nan")
            for frame in distances
        ),
    )


def load_reference(path: Path) -> list[dict[str, list[float]]]:
    """Read the known joints of each frame, [u, v, visibility] by name, from a JSON file."""
    known = parse_json(path, read_text(path, _MOST_BYTES), InputError)
    if not isinstance(known, list) or not all(isinstance(frame, dict) for frame in known):
        raise InputError(f"{path} must be a list with one mapping of joints per frame")
    for i, frame in enumerate(known):
        for name, values in frame.items():
            fits = isinstance(values, list) and all(type(v) in (int, float) for v in values)
            if name not in JOINT_INDEX or not fits or len(values) != 3:
                raise InputError(f"{path}: frame {i}: {name} must be a joint with [u, v, visibility]")
    return known


def _distances(
    frame: DepthFrame, skeleton: Skeleton | None, known: Mapping[str, list[float]]
) -> dict[str, float]:
    """Distance of each visible joint as a share of the person's height; infinite without an answer."""
    visible = {name: uv[:2] for name, uv in known.items() if uv[2] >= LEAST_VISIBILITY}
    if skeleton is None or skeleton.is_lost:
        return dict.fromkeys(visible, float("inf"))
    height = person_height_px(frame.depth)
    pixels = project(skeleton.positions, frame.camera)
    return {
        name: float(np.nan_to_num(np.linalg.norm(pixels[JOINT_INDEX[name]] - uv) / height, nan=np.inf))
        for name, uv in visible.items()
    }


def person_height_px(depth: NDArray[np.float32]) -> float:
    """Height of the largest surface in an image without background, pixels.

    Parameters
    ----------
    depth : (H, W) float32
        Metres; 0 or NaN outside the person.
    """
    from scipy.ndimage import label

    valid = np.isfinite(depth) & (depth > 0)
    if not valid.any():
        raise InputError("a frame has no depth at all, so the person's height is not known")
    parts, _ = label(valid)
    largest = parts == np.bincount(parts[valid]).argmax()
    rows = np.flatnonzero(largest.any(axis=1))
    return float(rows[-1] - rows[0] + 1)
