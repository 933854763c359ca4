"""Change crops on the training device, so that they can be used again while workers draw new ones."""

from __future__ import annotations

import torch
from crops import NO_DEPTH
from joint_losses import rename
from joint_net import SIDE
from torch import Tensor
from torch.nn import functional

from depth_pose.detect._crop_kernels import CHANNELS, FARTHEST

_TURNED, _ANGLE, _SIZE = 0.6, 0.15, 0.08
"""Share of crops that are turned, standard deviation of the angle, radians, and largest change of the
logarithm of the size. Set by hand."""
_SEEN = 5
"""Channels that hold an image; the others are the same in every pixel of a crop (`fill_features`)."""


def change(crops: list[Tensor]) -> list[Tensor]:
    """Turn, scale and mirror the crops of a batch (`train_joints.to_tensors`) about their middle.

    What no image showed before, such as the corners of a turned crop, counts as outside the image.
    """
    features, landmarks, side, person, mask = crops
    count, device = len(features), features.device
    angle = torch.randn(count, device=device) * _ANGLE * (torch.rand(count, device=device) < _TURNED)
    size = torch.exp((2.0 * torch.rand(count, device=device) - 1.0) * _SIZE)[:, None, None]
    mirrored = (torch.rand(count, device=device) < 0.5)[:, None, None]
    turn = _turn(angle) * torch.where(mirrored, torch.tensor([[-1.0], [1.0]], device=device), 1.0)
    shown, mask = _resample(features[:, :_SEEN], mask, turn.transpose(1, 2) / size)
    for depth in (0, 2):  # of the person, of everything
        shown[:, depth] = (shown[:, depth] * size).clamp(-FARTHEST, FARTHEST)
    slopes = torch.einsum("nij,nj->ni", turn, features[:, 5:7, 0, 0].float())
    constant = torch.cat([slopes, features[:, 7:, 0, 0].float()], 1)[:, :, None, None]
    constant = constant.expand(count, CHANNELS - _SEEN, SIDE, SIDE)
    aside = torch.einsum("nij,nkj->nki", turn, landmarks[..., :2])
    landmarks = size * torch.cat([aside, landmarks[..., 2:]], 2)
    landmarks = torch.where(mirrored, rename(landmarks), landmarks)
    return [torch.cat([shown, constant], 1).to(features.dtype), landmarks, side, person, mask]


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
