"""Skeletons drawn over one depth image, as an array."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw

from depth_pose.core.camera import Camera, Lens
from depth_pose.core.errors import InputError
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import BONES, JOINTS
from depth_pose.core.sketch import MIDDLE, side_colour
from depth_pose.evaluate.shading import shade_depth
from depth_pose.io.depth_unit import INTEGER_UNIT_M
from depth_pose.people import People

_TINTS = ((66, 135, 245), (122, 201, 67), (214, 84, 178), (36, 193, 188), (235, 200, 50), (150, 110, 235))
"""Tints of people by number, repeated from the first; for readability."""

_TINT, _FINER = 0.35, 3
"""Share of a person's colour in their pixels, and drawn pixels per pixel, for smooth lines."""

_BONE, _JOINT = 0.012, 0.009
"""Width of bones and radius of joints, as shares of the image's height; for readability."""


def draw(
    depth: ArrayLike,
    people: Sequence[Skeleton],
    camera: Camera | Lens | None = None,
    *,
    depth_scale: float | None = None,
) -> NDArray[np.uint8]:
    """Draw skeletons over a depth image.

    Bones are orange on the person's left and blue on the right, and paler where the confidence is low; the
    pixels of each person are tinted.

    Parameters
    ----------
    depth : (H, W) array
        Integers are millimetres, floats metres.
    people : People or sequence of Skeleton
        In the camera's frame. Without the labels of `People` pixels are not tinted.
    camera : Camera or Lens, optional
        The camera of the image; by default that of `People`.
    depth_scale : float, optional
        Metres per unit of the depth, for other units.

    Returns
    -------
    (H, W, 3) uint8
        Red, green, blue.

    Raises
    ------
    InputError
        Where the camera is missing, or the image has another size.
    """
    values = np.asarray(depth)
    if camera is None and isinstance(people, People):
        camera = people.camera
    if camera is None:
        raise InputError("draw needs the camera of the image: give it after the people")
    pinhole = camera.camera if isinstance(camera, Lens) else camera
    if values.shape != (pinhole.height, pinhole.width):
        raise InputError(
            f"depth has shape {values.shape}, the camera's image {(pinhole.height, pinhole.width)}"
        )
    scale = depth_scale or (1.0 if values.dtype.kind == "f" else INTEGER_UNIT_M)
    known = [skeleton for skeleton in people if not skeleton.is_lost]
    joints = np.concatenate([s.positions for s in known]) if known else None
    picture = 255.0 * shade_depth(np.where(values > 0, values * scale, 0.0).astype(np.float32), joints)
    _tint(picture, people)
    over = _bones([(s.pixels(camera), s.joint_confidence, s.positions[:, 2]) for s in known], *values.shape)
    share = over[..., 3:] / 255.0
    return np.asarray(np.rint(picture * (1.0 - share) + over[..., :3] * share), np.uint8)


def _tint(picture: NDArray[np.float64], people: Sequence[Skeleton]) -> None:
    """Mix the colour of each person into their pixels (H, W, 3)."""
    if not isinstance(people, People) or not people.has_labels:
        return
    labels = people.labels
    if labels.shape != picture.shape[:2]:
        return
    for number in np.unique(labels[labels > 0]).tolist():
        colour = np.array(_TINTS[(number - 1) % len(_TINTS)])
        picture[labels == number] += _TINT * (colour - picture[labels == number])


def _bones(
    figures: Sequence[tuple[NDArray[np.float64], NDArray[np.float32], NDArray[np.float64]]],
    height: int,
    width: int,
) -> NDArray[np.float64]:
    """Return red, green, blue and opacity (H, W, 4) of bones and joints, the nearest person last.

    Parameters
    ----------
    figures : sequence of ((19, 2), (19,), (19,)) arrays
        Pixels, confidence and depth of the joints.
    """
    sheet = Image.new("RGBA", (_FINER * width, _FINER * height))
    pen = ImageDraw.Draw(sheet)
    line, dot = max(1, round(_BONE * _FINER * height)), _JOINT * _FINER * height
    for pixels, confidence, depth in sorted(figures, key=lambda figure: -float(figure[2][0])):
        places = _FINER * (pixels + 0.5)
        shown = np.isfinite(places).all(axis=1) & (depth > 0.0) & (np.abs(places) < 1e5).all(axis=1)
        for a, b in BONES:
            if shown[a] and shown[b]:
                colour = side_colour(JOINTS[b])
                sure = int(80 + 175 * float(min(confidence[a], confidence[b])))
                colour = "#f4f4f4" if colour == MIDDLE else colour
                pen.line([*places[a], *places[b]], fill=f"{colour}{sure:02x}", width=line)
        for (x, y), is_shown in zip(places.tolist(), shown, strict=True):
            if is_shown:
                pen.ellipse([x - dot, y - dot, x + dot, y + dot], fill="#15181de0")
    return np.asarray(sheet.resize((width, height), Image.Resampling.BOX), np.float64)
