"""Previous answers for people in crops, simulated: right and wrong ones, and none.

A crop shows one moment. Its previous answer is either its truth or what the net says of the crop by itself,
so that it learns how far its own errors repeat, each moved and turned as people move within the time between
both, with errors of an answer's usual size. Some are wrong altogether: limbs that point elsewhere, left for
right. The net must see when not to believe them.
"""

from __future__ import annotations

from functools import lru_cache

import torch
from joint_losses import Truth, rename
from joint_net import Last
from torch import Tensor

from depth_pose.core.skeleton import LANDMARKS

_NONE, _TRUE = 0.3, 0.4
"""Shares of crops without a previous answer, and with one made of the truth; the others are the net's."""
_YOUNGEST_S, _USUAL_S, _OLDEST_S, _OLD = 0.02, 0.07, 0.25, 0.35
"""Age of the youngest answers, of usual ones at most, of all at most, seconds, and share of older ones."""
_ACTIVITY = 0.8
"""Deviation of the logarithm of how much faster or slower than usual somebody moves."""
_SPEED, _TURNING, _SWINGING = 0.3, 0.5, 1.5
"""Usual speed of a person, metres a second, of their turning and their limbs, radians a second; each axis."""
_OFF_M, _JITTER_M, _LEANING = 0.015, 0.012, 0.12
"""Errors of a true answer: of the torso and of each joint, metres, and of the limbs' directions, radians."""
_FAILS, _LOST, _ASTRAY = 0.15, 0.4, 1.0
"""Share of answers that fail, of their limbs that do, and the error of these, radians."""
_EXCHANGED = 0.04
"""Share of answers with left and right exchanged, of the arms, of the legs and of everything."""


_SIDES = ("left", "right")
_ARM, _FOREARM, _LEG, _SHANK = (
    ("elbow", "wrist"),
    ("wrist",),
    ("knee", "ankle", "foot", "heel"),
    ("ankle", "foot", "heel"),
)
_LIMBS = (("shoulder", _ARM), ("hip", _LEG), ("elbow", _FOREARM), ("knee", _SHANK))
"""Where each limb begins, and the landmarks that turn about it."""
_PELVIS = LANDMARKS.index("pelvis")


@lru_cache
def _limbs(device: torch.device) -> tuple[list[tuple[int, Tensor]], list[Tensor]]:
    """Return the numbers of the limbs' landmarks, upper parts first; and those of both arms, both legs."""

    def numbers(sides: tuple[str, ...], names: tuple[str, ...]) -> Tensor:
        return torch.tensor([LANDMARKS.index(f"{s}_{n}") for s in sides for n in names], device=device)

    each = [(LANDMARKS.index(f"{s}_{n}"), numbers((s,), moved)) for n, moved in _LIMBS for s in _SIDES]
    return each, [numbers(_SIDES, names) for names in (_ARM, _LEG)]


def last_answer(truth: Truth, landmarks: Tensor, behind: Tensor) -> Last:
    """Simulate the previous answers for a batch; ``landmarks`` (N, L, 3) and ``behind`` are the net's own."""
    count, device = len(landmarks), landmarks.device

    def chance(share: float, *more: int) -> Tensor:
        return torch.rand(count, *more, device=device) < share

    def normal(*more: int) -> Tensor:
        return torch.randn(count, *more, device=device)

    known = truth.landmarks.isfinite().all(dim=2)
    is_true = (chance(_TRUE / (1 - _NONE)) & known.any(dim=1))[:, None]
    places = torch.where((is_true & known)[..., None], truth.landmarks, landmarks.float())
    side = torch.where(is_true[:, 0], truth.side.clamp(-1, 1), torch.tanh(0.5 * behind.float()))

    age = torch.rand(count, device=device)
    usual = _YOUNGEST_S + (_USUAL_S - _YOUNGEST_S) * age
    age = torch.where(chance(_OLD), _USUAL_S + (_OLDEST_S - _USUAL_S) * age, usual)[:, None]
    moved = age * torch.exp(_ACTIVITY * normal(1))
    fault = is_true.float()
    places = _turned(places, places[:, _PELVIS], _TURNING * moved * normal(3))
    places = places + (_SPEED * moved * normal(3) + fault * _OFF_M * normal(3))[:, None]
    fails = chance(_FAILS)
    limbs, pairs = _limbs(device)
    for first, others in limbs:
        swing = _SWINGING * moved * normal(3) + fault * _LEANING * normal(3)
        swing = swing + (fails & chance(_LOST))[:, None] * _ASTRAY * normal(3)
        turned = places.clone()
        turned[:, others] = _turned(places[:, others], places[:, first], swing)
        places = turned
    places = places + fault[..., None] * _JITTER_M * normal(len(LANDMARKS), 3)
    other = rename(places)
    for part in pairs:
        swapped = places.clone()
        swapped[:, part] = torch.where(chance(_EXCHANGED)[:, None, None], other[:, part], places[:, part])
        places = swapped
    # from the side either naming is right, if it agrees with what is said of the view
    either = chance(1.0) & (torch.rand(count, device=device) < 0.5 * (1.0 - side.abs()))
    wrong = chance(_EXCHANGED)
    places = torch.where((either | wrong)[:, None, None], rename(places), places)
    side = torch.where(either, -side, side)

    there = (~chance(_NONE)).float()[:, None]
    shown = there * torch.where(is_true, known.float(), torch.ones_like(known, dtype=torch.float32))
    marked = torch.cat([places, torch.ones_like(places[..., :1])], 2) * shown[..., None]
    return Last(marked, there * torch.stack([side, age[:, 0]], 1))


def _turned(points: Tensor, about: Tensor, by: Tensor) -> Tensor:
    """Turn points (N, K, 3) about others (N, 3) by rotation vectors (N, 3)."""
    angle = by.norm(dim=1, keepdim=True).clamp(min=1e-6)
    axis, angle = (by / angle)[:, None], angle[:, None]
    arm = points - about[:, None]
    along = axis * (axis * arm).sum(dim=2, keepdim=True)
    across = torch.linalg.cross(axis.expand_as(arm), arm)
    return about[:, None] + arm * angle.cos() + across * angle.sin() + along * (1.0 - angle.cos())
