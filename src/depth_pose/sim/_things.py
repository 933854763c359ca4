"""Objects worn and held: hats, buns, backpacks, bags; boxes, laptops, balls.

Worn objects count as the person; held ones do not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.skeleton import NODE_INDEX
from depth_pose.sim._garments import Wearer, head_box
from depth_pose.sim._meshes import Piece, blob, box, frame, loft, moved

Array = NDArray[np.float64]

_UP = np.array([0.0, 1.0, 0.0])
"""Up in a figure's frame."""


def bun(rng: np.random.Generator, wearer: Wearer) -> Piece:
    """Make a bun or a pony tail."""
    middle, axes, half = head_box(wearer)
    around = np.radians(rng.uniform(95, 200))
    place = np.array(
        [0.0, half[1] * np.cos(around - np.pi / 2), -half[2] * np.sin(around - np.pi / 2) * 1.05]
    )
    size = rng.uniform(0.03, 0.055) * wearer.size
    shape = np.array([size, size * rng.uniform(1.0, 3.0), size])
    place[1] -= 0.6 * (shape[1] - size)
    return moved(blob(shape), axes, middle + axes @ place)


def hat(rng: np.random.Generator, wearer: Wearer) -> list[Piece]:
    """Make a cap with a peak, a hat with a brim, or a helmet."""
    middle, axes, half = head_box(wearer)
    kind = rng.choice(3, p=[0.45, 0.3, 0.25])
    thick = 1.0 + (0.22 if kind == 2 else 0.08)
    crown = half * [thick, rng.uniform(0.65, 0.95), thick]
    top = moved(
        blob(crown, 0.0 if kind == 2 else rng.uniform(0.0, 0.25)),
        axes,
        middle + axes @ [0, 0.38 * half[1], 0],
    )
    if kind == 2:
        return [top]
    angle = np.linspace(-0.85, 0.85, 9) if kind == 0 else 2 * np.pi * np.arange(21) / 20
    brim = rng.uniform(0.05, 0.08 if kind == 0 else 0.13) * wearer.size
    rings = []
    for out in (0.9, 1.0 + brim / half[2]):
        ring = np.stack([half[0] * out * np.sin(angle), 0 * angle, half[2] * out * np.cos(angle)], axis=-1)
        ring[:, 1] = 0.42 * half[1] - 0.2 * (out - 0.9) * half[1]
        rings.append(middle + ring @ axes.T)
    return [top, loft(np.array(rings), closed=False)]


def backpack(rng: np.random.Generator, wearer: Wearer) -> Piece:
    """Make a backpack, upright on the back."""
    size, axes = wearer.size, wearer.rotations[NODE_INDEX["chest"]]
    local = (wearer.part("chest", "spine") - wearer.node("chest")) @ axes
    half = size * np.array([rng.uniform(0.11, 0.17), rng.uniform(0.16, 0.30), rng.uniform(0.06, 0.13)])
    place = np.array([0.0, rng.uniform(-0.12, 0.0) * size, local[:, 2].min() - 0.75 * half[2]])
    return moved(blob(half, 0.6), axes, wearer.node("chest") + axes @ place)


def shoulder_bag(rng: np.random.Generator, wearer: Wearer) -> Piece:
    """Make a bag that hangs at the hip."""
    size, sign = wearer.size, rng.choice([-1.0, 1.0])
    axes = wearer.rotations[0]
    local = (wearer.part("pelvis") - wearer.nodes[0]) @ axes
    half = size * np.array([rng.uniform(0.04, 0.08), rng.uniform(0.10, 0.18), rng.uniform(0.11, 0.20)])
    place = [
        sign * (np.abs(local[:, 0]).max() + 0.8 * half[0]),
        rng.uniform(-0.10, 0.06) * size,
        -0.02 * size,
    ]
    return moved(blob(half, 0.55), axes, wearer.nodes[0] + axes @ place)


def belongings(rng: np.random.Generator, wearer: Wearer, doing: str) -> list[Piece]:
    """Sample the object that the person holds, by their activity and the position of their hands.

    Parameters
    ----------
    rng : numpy.random.Generator
    wearer : Wearer
    doing : str
        As in `depth_pose.motion.procedural.postures.parts.Kind`.

    Returns
    -------
    list of (vertices, faces)
        Empty, or one object.
    """
    hands = [_palm(wearer, side) for side in ("left", "right")]
    if doing in ("cloth", "board"):
        return [_screen(rng, wearer, hands, doing == "cloth")]
    if doing == "carry":
        return [_between(rng, wearer, hands)]
    if doing == "hold" and rng.uniform() < 0.6:
        return [_between(rng, wearer, hands)]
    if doing in ("read", "telephone"):
        return [_plate(rng, wearer, hands[_higher(hands)], doing)] if rng.uniform() < 0.8 else []
    if doing == "free" and rng.uniform() < 0.13:
        return _hung(rng, wearer, hands)
    return []


def _screen(rng: np.random.Generator, wearer: Wearer, hands: list[Array], soft: bool) -> Piece:
    """Make a cloth that hangs from both hands, or a board between them, before the person."""
    left, right = hands
    ahead = 0.5 * (left + right) - wearer.node("chest")
    axes = frame(np.array([ahead[0], 0.0, ahead[2]]), _UP)
    wide = float(np.linalg.norm(left - right)) * rng.uniform(1.0, 1.6) + 0.1
    if not soft:
        half = np.array([max(wide / 2, 0.2), rng.uniform(0.15, 0.5), 0.01])
        return moved(box(half), axes, 0.5 * (left + right) + axes @ [0.0, rng.normal(0, 0.12), 0.04])
    across, down = np.linspace(-0.5, 0.5, 15)[None], np.linspace(0, 1, 9)[:, None]
    long = rng.uniform(0.35, 1.0) * wearer.size
    sag = 0.06 * (1 - (2 * across) ** 2) * rng.uniform(0.2, 1.0)
    folds = rng.uniform(0.01, 0.05) * down * np.sin(across * rng.uniform(8, 30) + rng.uniform(0, 6))
    local = np.stack([across * wide + 0 * down, 0.03 - sag - long * down, 0.03 + folds], axis=-1)
    rows = 0.5 * (left + right) + local @ axes.T
    rows[..., 1] = np.maximum(rows[..., 1], wearer.floor + 0.01)
    return loft(rows, closed=False)


def _palm(wearer: Wearer, side: str) -> Array:
    """Place of the palm, metres: a hand's half beyond the wrist."""
    wrist = wearer.node(f"{side}_wrist")
    hand = wearer.part(f"{side}_wrist")
    return np.asarray(hand.mean(axis=0)) if len(hand) else wrist


def _higher(hands: list[Array]) -> int:
    return int(hands[1][1] > hands[0][1])


def _between(rng: np.random.Generator, wearer: Wearer, hands: list[Array]) -> Piece:
    """Make a box, a ball, an open laptop or a tray between two hands."""
    size = wearer.size
    across = hands[0] - hands[1]
    gap = float(np.linalg.norm(across))
    middle = 0.5 * (hands[0] + hands[1])
    ahead = middle - wearer.node("chest")
    ahead = np.array([ahead[0], 0.0, ahead[2]])
    axes = frame(ahead, _UP)
    half_gap = float(np.clip(0.5 * gap - 0.015, 0.07 * size, 0.32))
    kind = rng.choice(4, p=[0.55, 0.1, 0.2, 0.15])
    if kind == 1:
        radius = float(np.clip(half_gap, 0.09, 0.16))
        return moved(blob(np.full(3, radius)), axes, middle + axes @ [0, 0, 0.3 * radius])
    if kind == 2:
        return moved(_laptop(rng), axes, middle + axes @ [0, 0.02, 0.05])
    if kind == 3:
        return moved(
            box(np.array([half_gap + 0.03, 0.012, rng.uniform(0.1, 0.18)])), axes, middle + [0, 0.03, 0]
        )
    half = np.array([half_gap, rng.uniform(0.06, 0.22), rng.uniform(0.08, 0.20)])
    return moved(box(half), axes, middle + axes @ [0, rng.uniform(-0.3, 0.8) * half[1], 0.5 * half[2]])


def _laptop(rng: np.random.Generator) -> Piece:
    """Make an open laptop, its base about the origin and its screen away from the user."""
    half = np.array([rng.uniform(0.14, 0.19), 0.008, rng.uniform(0.10, 0.13)])
    base, base_faces = box(half)
    tilt = np.radians(rng.uniform(5, 35))
    screen, faces = box(half)
    hinge = np.array([0.0, 0.0, half[2]])
    upright = frame(np.array([0.0, np.cos(tilt), np.sin(tilt)]), _UP)
    lid = screen @ upright.T + hinge + upright @ [0.0, 0.0, half[2]]
    return np.concatenate([base, lid]), np.concatenate([base_faces, faces + len(base)])


def _plate(rng: np.random.Generator, wearer: Wearer, hand: Array, doing: str) -> Piece:
    """Make a telephone, tablet, book or sheet in one hand."""
    if doing == "telephone":
        half = np.array([0.036, 0.075, 0.006])
    else:
        half = min(1.0, 1.1 * wearer.size) * rng.choice([0.5, 1.0, 1.0, 1.6]) * np.array([0.08, 0.11, 0.006])
    toward = wearer.node("head") - hand
    axes = frame(toward, _UP)
    if doing == "telephone":
        return moved(box(half), axes, hand + 0.25 * toward)
    return moved(box(half), axes, hand + axes @ [0.0, 0.5 * half[1], 0.02])


def _hung(rng: np.random.Generator, wearer: Wearer, hands: list[Array]) -> list[Piece]:
    """Make a bag, case, bottle or ball at a hand that hangs."""
    hand = hands[int(rng.integers(2))]
    room = float(hand[1]) - wearer.floor
    raised = hand[1] > wearer.node("chest")[1]
    if rng.uniform() < 0.35 or room < 0.35 or raised:
        radius = (
            np.array([0.035, 0.10, 0.035]) if rng.uniform() < 0.5 else np.full(3, rng.uniform(0.06, 0.11))
        )
        return [moved(blob(radius), np.eye(3), hand + [0.0, -0.5 * radius[1], 0.6 * radius[2]])]
    half = np.array([rng.uniform(0.03, 0.09), rng.uniform(0.12, 0.22), rng.uniform(0.12, 0.24)])
    half[1] = min(half[1], 0.5 * (room - 0.10))
    toward = wearer.rotations[0][:, 2] * [1, 0, 1]
    return [moved(blob(half, 0.55), frame(toward, _UP), hand - [0.0, half[1] + 0.06, 0.0])]
