"""Change crops on the training device, so that they can be used again while workers draw new ones."""

from __future__ import annotations

import torch
from crops import NO_DEPTH
from joint_losses import rename
from joint_net import SIDE
from torch import Tensor
from torch.nn import functional

from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.detect._crop_kernels import CHANNELS, FARTHEST

_TURNED, _ANGLE, _SIZE, _LENGTH = 0.6, 0.15, 0.08, 0.06
"""Share of crops that are turned, standard deviation of the angle, radians, and largest changes of the
logarithms of the size, and of lengths along the trunk. Set by hand."""
_COVERED, _HOLED = 0.4, 0.15
"""Shares of crops before which something stands, and in which a part returned nothing. Set by hand."""
_SIDES, _NEARER = (5.0, 36.0), (0.3, 1.6)
"""Range of the sides of what covers a part, pixels, and how much nearer it is than the torso (units of the
depth channels). Set by hand."""
_NECK, _PELVIS = JOINT_INDEX["neck"], JOINT_INDEX["pelvis"]
_SEEN = 5
"""Channels that hold an image; the others are the same in every pixel of a crop (`fill_features`)."""


def change(crops: list[Tensor]) -> list[Tensor]:
    """Turn, scale, stretch and mirror the crops of a batch (`train_joints.to_tensors`); cover parts of some.

    This is done about their middle. People are stretched along the trunk, in the image, so that they become
    longer or shorter for their width. What no image showed before, such as the corners of a turned crop,
    counts as outside the image.
    """
    features, landmarks, side, person, mask = crops
    count, device = len(features), features.device
    angle = torch.randn(count, device=device) * _ANGLE * (torch.rand(count, device=device) < _TURNED)
    size = torch.exp((2.0 * torch.rand(count, device=device) - 1.0) * _SIZE)[:, None, None]
    mirrored = (torch.rand(count, device=device) < 0.5)[:, None, None]
    turn = _turn(angle) * torch.where(mirrored, torch.tensor([[-1.0], [1.0]], device=device), 1.0)
    back = turn.transpose(1, 2) / size
    longer, shorter = _stretch(landmarks)
    shown, mask = _resample(features[:, :_SEEN], mask, shorter @ back)
    for depth in (0, 2):  # of the person, of everything
        shown[:, depth] = (shown[:, depth] * size).clamp(-FARTHEST, FARTHEST)
    slopes = torch.einsum("nij,nj->ni", turn, features[:, 5:7, 0, 0].float())
    constant = torch.cat([slopes, features[:, 7:, 0, 0].float()], 1)[:, :, None, None]
    constant = constant.expand(count, CHANNELS - _SEEN, SIDE, SIDE)
    aside = torch.einsum("nij,nkj->nki", turn @ longer, landmarks[..., :2])
    landmarks = size * torch.cat([aside, landmarks[..., 2:]], 2)
    landmarks = torch.where(mirrored, rename(landmarks), landmarks)
    mask = _cover(shown, mask)
    return [torch.cat([shown, constant], 1).to(features.dtype), landmarks, side, person, mask]


def _stretch(landmarks: Tensor) -> tuple[Tensor, Tensor]:
    """Random changes of length along the trunks in the image (N, 2, 2), and their inverses; none without."""
    trunk = landmarks[:, _NECK, :2] - landmarks[:, _PELVIS, :2]
    along = functional.normalize(torch.nan_to_num(trunk), dim=1)
    by = (2.0 * torch.rand(len(trunk), 1, 1, device=trunk.device) - 1.0) * _LENGTH
    same, square = torch.eye(2, device=trunk.device), along[:, :, None] * along[:, None]
    return same + torch.expm1(by) * square, same + torch.expm1(-by) * square


def _cover(shown: Tensor, mask: Tensor) -> Tensor:
    """Place rectangles before some images (N, 5, H, W), empty ones in others; return the masks after it."""
    count, device = len(shown), shown.device
    kind = torch.rand(count, device=device)
    middle = SIDE * (0.2 + 0.6 * torch.rand(count, 2, device=device))
    half = 0.5 * (_SIDES[0] + (_SIDES[1] - _SIDES[0]) * torch.rand(count, 2, device=device) ** 2)
    off = torch.arange(SIDE, device=device) + 0.5 - middle[..., None]
    inside = off.abs() < half[..., None]
    chosen = inside[:, 0, :, None] & inside[:, 1, None] & (kind < _COVERED + _HOLED)[:, None, None]
    chosen &= shown[:, 4] > 0
    nearer = _NEARER[0] + (_NEARER[1] - _NEARER[0]) * torch.rand(count, 1, 1, device=device)
    is_hole = (kind >= _COVERED)[:, None, None]
    shown[:, :2] = torch.where(chosen[:, None], 0.0, shown[:, :2])
    shown[:, 2] = torch.where(chosen, torch.where(is_hole, 0.0, -nearer), shown[:, 2])
    shown[:, 3] = torch.where(chosen, torch.where(is_hole, 0.0, 1.0), shown[:, 3])
    covered = torch.where(is_hole, NO_DEPTH, 0).to(mask.dtype)
    return torch.where(chosen, covered, mask)


def _turn(angle: Tensor) -> Tensor:
    """Rotations (N, 2, 2)."""
    c, s = torch.cos(angle), torch.sin(angle)
    return torch.stack([torch.stack([c, -s], 1), torch.stack([s, c], 1)], 1)


def _resample(images: Tensor, mask: Tensor, back: Tensor) -> tuple[Tensor, Tensor]:
    """Sample images (N, C, H, W) and masks (N, H, W); ``back`` (N, 2, 2) takes new places to old ones."""
    theta = functional.pad(back, (0, 1))
    grid = functional.affine_grid(theta, [len(images), 1, SIDE, SIDE], align_corners=False)
    both = torch.cat([images.float(), mask[:, None].float() + 1.0], 1)  # 0 is left for what is outside
    both = functional.grid_sample(both, grid, mode="nearest", padding_mode="zeros", align_corners=False)
    said = both[:, -1].round().to(torch.uint8)
    return both[:, :-1], torch.where(said > 0, said - 1, NO_DEPTH)
