"""Animated GIFs: skeletons over the depth of a recording, frame by frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageOps

from depth_pose.core.camera import Camera
from depth_pose.core.frame import DepthFrame
from depth_pose.core.outputs import new_file
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import BONES, JointState
from depth_pose.core.sketch import LEFT, MIDDLE, RIGHT
from depth_pose.evaluate.overlay import bone_colour
from depth_pose.evaluate.panels import answers_in_images, project
from depth_pose.evaluate.shading import shade_depth
from depth_pose.io.mcap_read import DepthReader
from depth_pose.io.schemas import PEOPLE_TOPIC
from depth_pose.rooms.placed_camera import PlacedCamera
from depth_pose.rooms.recorded import read_recorded

_FINE = 2
"""Pictures are drawn this many times larger and then reduced, for smooth lines."""
_COLOURS = 40
"""Number of colours for depth; those of bones and joints are added."""
_STEPS = 9
"""Colours of confidence."""
_NOISE_M, _NOISE_SHARE = 0.03, 0.02
"""Maximum change of depth between frames in a static scene: about three times the sensors' noise."""
_MOST_MISSING = 8
"""Number of pictures for which a pixel without a return keeps its colour."""
_BACKGROUND = "#0b0d10"
_LIGHT = "#f4f4f4"


def save_animation(
    recording_path: Path | str,
    skeleton_path: Path | str,
    gif_path: Path | str,
    seconds: float = 6.0,
    rate_hz: float = 8.0,
    width: int = 400,
    *,
    depth_topic: str | None = None,
    skeleton_topic: str = PEOPLE_TOPIC,
    camera: PlacedCamera | None = None,
) -> int:
    """Draw the skeletons over the depth as an animated GIF, in the recording's own time.

    Bones are orange on the person's left and blue on the right; joints go from red to green with
    confidence and are hollow where hidden.

    Parameters
    ----------
    recording_path, skeleton_path : Path or str
        The depth recording, and that of its skeletons.
    gif_path : Path or str
        The picture; folders are made.
    seconds : float
        Maximum length, from the recording's start.
    rate_hz : float
        Pictures a second, at most as many as the recording has frames.
    width : int
        Width of the pictures, pixels.
    depth_topic, skeleton_topic : str, optional
        The topics.
    camera : PlacedCamera, optional
        The camera of the depth recording; needed for skeletons in a room's frame.

    Returns
    -------
    int
        Number of pictures.
    """
    answer = answers_in_images(read_recorded(skeleton_path, skeleton_topic), camera)
    frames = list(_spaced(DepthReader(recording_path, depth_topic), seconds, 1.0 / rate_hz))
    answers = {frame.stamp_ns: answer(frame) or () for frame in frames}
    pictures = draw_frames(frames, answers, width)
    table = _shared_table(pictures)
    drawn = [picture.quantize(palette=table, dither=Image.Dither.NONE) for picture in pictures]
    step_ms = round(1000 / rate_hz)
    how = {"save_all": True, "append_images": drawn[1:], "duration": step_ms, "loop": 0, "optimize": True}
    with new_file(gif_path) as stream:
        drawn[0].save(stream, format="GIF", **how)
    return len(drawn)


def draw_frames(
    frames: Sequence[DepthFrame], answers: Mapping[int, Sequence[Skeleton]], width: int
) -> list[Image.Image]:
    """Draw the skeletons of each frame's stamp over its depth; all pictures have the size of the first."""
    span, calm = _range(frames), _Calm()
    pictures: list[Image.Image] = []
    for frame in frames:
        shown = calm.take(frame.depth)
        picture = _draw(shown, frame.camera, answers.get(frame.stamp_ns, ()), width, span)
        pictures.append(ImageOps.pad(picture, pictures[0].size, color=_BACKGROUND) if pictures else picture)
    return pictures


def _spaced(reader: DepthReader, seconds: float, step_s: float) -> Iterator[DepthFrame]:
    """Return the first frame after each even time step."""
    start_ns, given = None, 0
    for frame in reader:
        start_ns = frame.stamp_ns if start_ns is None else start_ns
        passed = (frame.stamp_ns - start_ns) * 1e-9
        if passed > seconds:
            return
        if passed >= given * step_s - 1e-3:
            given += 1
            yield frame


def _range(frames: Sequence[DepthFrame]) -> tuple[float, float]:
    """Range of distances that the colours span, the same in all pictures."""
    known = np.concatenate([f.depth[(f.depth > 0) & np.isfinite(f.depth)][::50] for f in frames])
    low, high = np.percentile(known, [2, 97]) if known.size else (0.5, 5.0)
    return float(low), float(high)


class _Calm:
    """Hold the depth of static pixels, whose noise would flicker and enlarge the file."""

    def __init__(self) -> None:
        self._shown: NDArray[np.float32] | None = None
        self._missing = np.zeros(0)

    def take(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        depth = np.nan_to_num(depth)
        if self._shown is None or self._shown.shape != depth.shape:
            self._shown, self._missing = depth, np.zeros(depth.shape)
            return depth
        before = self._shown
        self._missing = np.where(depth > 0, 0, self._missing + 1)
        calm = np.abs(depth - before) < _NOISE_M + _NOISE_SHARE * before
        calm |= (depth <= 0) & (self._missing <= _MOST_MISSING)
        self._shown = np.where(calm, before, depth)
        return self._shown


def _draw(
    depth: NDArray[np.float32],
    camera: Camera,
    skeletons: Sequence[Skeleton],
    width: int,
    span: tuple[float, float],
) -> Image.Image:
    ends = np.array([[0.0, 0.0, span[0] + 0.35], [0.0, 0.0, span[1] - 0.45]])
    shaded = (255 * shade_depth(depth, ends)).astype(np.uint8)
    height = round(width * shaded.shape[0] / shaded.shape[1])
    large = (width * _FINE, height * _FINE)
    picture = Image.fromarray(shaded).resize(large, Image.Resampling.BILINEAR)
    pen = ImageDraw.Draw(picture)
    for skeleton in sorted(skeletons, key=lambda s: -float(s.positions[0, 2])):
        _draw_skeleton(pen, skeleton, camera, large[0] / camera.width)
    return picture.resize((width, height), Image.Resampling.LANCZOS)


def _draw_skeleton(pen: ImageDraw.ImageDraw, skeleton: Skeleton, camera: Camera, zoom: float) -> None:
    from matplotlib import colormaps

    pixels = (project(skeleton.positions, camera) + 0.5) * zoom
    thick = max(2, round(2.2 * _FINE))
    order = sorted(BONES, key=lambda bone: -float(np.nansum(skeleton.positions[list(bone), 2])))
    for a, b in order:
        if not np.isfinite(pixels[[a, b]]).all():
            continue
        line = [tuple(pixels[a]), tuple(pixels[b])]
        colour = bone_colour(b) if bone_colour(b) != MIDDLE else _LIGHT
        pen.line(line, fill=_BACKGROUND, width=thick + 2 * _FINE)
        pen.line(line, fill=colour, width=thick)
    sure = colormaps["RdYlGn"](np.clip(skeleton.joint_confidence.astype(float), 0, 1), bytes=True)
    for pixel, colour, state in zip(pixels, sure, skeleton.joint_states, strict=True):
        if np.isfinite(pixel).all():
            _draw_joint(pen, pixel, tuple(int(c) for c in colour[:3]), state == JointState.SEEN)


def _draw_joint(
    pen: ImageDraw.ImageDraw, pixel: NDArray[np.float64], colour: tuple[int, ...], seen: bool
) -> None:
    size = 2.4 * _FINE
    box = (*(pixel - size), *(pixel + size))
    if seen:
        pen.ellipse(box, fill=colour, outline=_BACKGROUND, width=1)
    else:
        pen.ellipse(box, fill=_BACKGROUND, outline=colour, width=_FINE)


def _shared_table(pictures: Sequence[Image.Image]) -> Image.Image:
    """Find one palette for all pictures, to avoid flicker; it contains the colours of bones and joints."""
    from matplotlib import colormaps
    from PIL import ImageColor

    few = pictures[:: max(1, len(pictures) // 8)]
    sample = Image.new("RGB", (few[0].width, few[0].height * len(few)))
    for i, picture in enumerate(few):
        sample.paste(picture, (0, i * picture.height))
    found = sample.quantize(_COLOURS, method=Image.Quantize.MEDIANCUT).getpalette() or []
    colours = found[: 3 * _COLOURS]
    for name in (LEFT, RIGHT, _LIGHT, _BACKGROUND):
        colours += ImageColor.getrgb(name)
    colours += colormaps["RdYlGn"](np.linspace(0, 1, _STEPS), bytes=True)[:, :3].ravel().tolist()
    table = Image.new("P", (1, 1))
    table.putpalette(colours)
    return table
