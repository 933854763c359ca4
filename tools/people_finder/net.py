"""The net of the people finder: a small U-Net of plain convolutions.

Plain 3x3 convolutions run near a processor's peak in ONNX Runtime, where depthwise ones wait for
memory; most of the channels are spent at an eighth of the input's resolution and below.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from depth_pose.core.skeleton import JOINTS
from depth_pose.detect._finder_kernels import CHANNELS

_JOINT_WIDTH = 80
"""Channels before the votes for joints; no fewer than the outputs."""


class ConvUnit(nn.Sequential):
    """Convolution, batch norm, ReLU."""

    def __init__(self, channels_in: int, channels_out: int, size: int = 3, stride: int = 1) -> None:
        super().__init__(
            nn.Conv2d(channels_in, channels_out, size, stride, size // 2, bias=False),
            nn.BatchNorm2d(channels_out),
            nn.ReLU(inplace=True),
        )


class Residual(nn.Module):
    """Two convolutions beside a straight path."""

    def __init__(self, channels: int, dilation: int = 1) -> None:
        super().__init__()
        self.first = ConvUnit(channels, channels)
        self.second = nn.Sequential(
            nn.Conv2d(channels, channels, 3, 1, dilation, dilation, bias=False), nn.BatchNorm2d(channels)
        )

    def forward(self, x: Tensor) -> Tensor:
        """Add what the two convolutions find."""
        return functional.relu(x + self.second(self.first(x)))


class FinderNet(nn.Module):
    """Depth features to person mask, torso votes and joint votes.

    Parameters
    ----------
    channels_in : int
        Input features.
    widths : tuple of 4 int
        Channels at 1/2, 1/4, 1/8 and 1/16 of the input's resolution.
    """

    def __init__(
        self, channels_in: int = CHANNELS, widths: tuple[int, int, int, int] = (16, 32, 64, 128)
    ) -> None:
        super().__init__()
        a, b, c, d = widths
        self.stem = nn.Sequential(ConvUnit(channels_in, a, 3, 2), ConvUnit(a, a))
        self.down4 = nn.Sequential(ConvUnit(a, b, 3, 2), ConvUnit(b, b))
        self.down8 = nn.Sequential(ConvUnit(b, c, 3, 2), Residual(c))
        self.down16 = nn.Sequential(ConvUnit(c, d, 3, 2), Residual(d), Residual(d, 2))
        self.squeeze8 = ConvUnit(c + d, c, 1)
        self.up8 = Residual(c)
        self.squeeze4 = ConvUnit(b + c, b, 1)
        self.up4 = ConvUnit(b, b)
        self.squeeze2 = ConvUnit(a + b, a, 1)
        self.up2 = ConvUnit(a, a)
        self.mask = nn.Conv2d(a, 4, 1)  # four pixels of the full resolution
        self.torso = nn.Conv2d(a, 16, 1)  # vote (metres) and the logarithm of its error, likewise
        # joints: votes (metres), logarithms of their errors, logit of being seen from behind
        self.joints = nn.Sequential(
            ConvUnit(b, _JOINT_WIDTH), nn.Conv2d(_JOINT_WIDTH, 4 * len(JOINTS) + 1, 1)
        )

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return mask logits (N,1,H,W), torso votes (N,4,H,W) and joint votes (N,4J+1,H/4,W/4)."""
        mask, torso, y4 = self.packed(x)
        return functional.pixel_shuffle(mask, 2), functional.pixel_shuffle(torso, 2), self.joints(y4)

    def seen(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Return mask logits and torso votes alone."""
        mask, torso, _ = self.packed(x)
        return functional.pixel_shuffle(mask, 2), functional.pixel_shuffle(torso, 2)

    def packed(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return mask (N,4,H/2,W/2) and torso votes (N,16,H/2,W/2), packed by four, and joint features."""
        x2 = self.stem(x)
        x4 = self.down4(x2)
        x8 = self.down8(x4)
        x16 = self.down16(x8)
        y8 = self.up8(self.squeeze8(torch.cat([x8, _double(x16, x8)], 1)))
        y4 = self.up4(self.squeeze4(torch.cat([x4, _double(y8, x4)], 1)))
        y2 = self.up2(self.squeeze2(torch.cat([x2, _double(y4, x2)], 1)))
        return self.mask(y2), self.torso(y2), y4


def _double(x: Tensor, like: Tensor) -> Tensor:
    """Double the resolution; the last row or column is cropped where the other has none."""
    doubled = functional.interpolate(x, scale_factor=2, mode="nearest")
    if doubled.shape[2:] == like.shape[2:]:  # a cut that cuts nothing would cost time in the exported net
        return doubled
    return doubled[..., : like.shape[2], : like.shape[3]]
