"""The net of the second look: a crop around one person to their joints, and to whether it is a person.

Every cell of the crop votes for every joint and says how much its vote counts; the joint is where the
votes' mean lies (as the anchors of Xiong et al. 2019, *A2J: anchor-to-joint regression network*, and the
expected place of Sun et al. 2018, *Integral human pose regression*). Most channels are spent at an eighth of
the crop's resolution and below, where convolutions run near a processor's peak.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from net import ConvUnit, Residual
from torch import Tensor, nn
from torch.nn import functional

from depth_pose.core.skeleton import JOINTS
from depth_pose.detect._crop_kernels import CHANNELS

SIDE = 128
"""Rows and columns of a crop, pixels."""

CELL_M = 0.022
"""What a pixel of the crop measures at the torso's distance, metres: 2.8 m in all."""

STRIDE = 4
"""Pixels along the side of a cell that votes."""

_CELLS = SIDE // STRIDE
_PERSON_WIDTH = 64
"""Channels from which it is said whether this is a person."""


class Answer(NamedTuple):
    """What the net says.

    Attributes
    ----------
    joints : (N, J, 3)
        In the crop's coordinates, metres.
    log_error : (N, J, 2)
        Logarithms of the widths of their distributions, in the image plane and in depth, metres.
    behind, person : (N,)
        Logits of being seen from behind, and of being a person.
    mask : (N, SIDE, SIDE)
        Logits of a pixel showing the person.
    log_weights : (N, J, cells)
        Logarithms of the weights of the cells' votes.
    """

    joints: Tensor
    log_error: Tensor
    behind: Tensor
    person: Tensor
    mask: Tensor
    log_weights: Tensor


class JointNet(nn.Module):
    """A crop's features to joints.

    Parameters
    ----------
    widths : tuple of 4 int
        Channels at 1/2, 1/4, 1/8 and 1/16 of the input's resolution.
    """

    def __init__(self, widths: tuple[int, int, int, int] = (24, 64, 128, 192)) -> None:
        super().__init__()
        a, b, c, d = widths
        self.stem = ConvUnit(CHANNELS, a, 5, 2)
        self.down4 = nn.Sequential(ConvUnit(a, b, 3, 2), ConvUnit(b, b))
        self.down8 = nn.Sequential(ConvUnit(b, c, 3, 2), Residual(c), Residual(c))
        self.down16 = nn.Sequential(ConvUnit(c, d, 3, 2), Residual(d), Residual(d, 2))
        self.squeeze8 = ConvUnit(c + d, 96, 1)
        self.up8 = ConvUnit(96, 96)
        self.squeeze4 = ConvUnit(b + 96, b, 1)
        self.up4 = ConvUnit(b, b)
        n = len(JOINTS)
        # votes (metres), weights of the votes, logarithms of the joints' errors, logit of seen from behind
        self.votes = nn.Conv2d(b, 6 * n + 1, 1)
        self.mask = nn.Conv2d(b, STRIDE**2, 1)
        self.look = ConvUnit(d, _PERSON_WIDTH, 1)
        self.person = nn.Linear(2 * _PERSON_WIDTH, 1)
        place = (torch.arange(_CELLS) + 0.5 - _CELLS / 2) * STRIDE * CELL_M
        across, down = place.expand(_CELLS, _CELLS), place[:, None].expand(_CELLS, _CELLS)
        cells = torch.stack([across, down, torch.zeros(_CELLS, _CELLS)]).reshape(1, 1, 3, -1)
        self.register_buffer("cells", cells, persistent=False)

    def vote(self, x: Tensor) -> Answer:
        """Answer with all that training asks for."""
        x4 = self.down4(self.stem(x))
        x8 = self.down8(x4)
        x16 = self.down16(x8)
        y8 = self.up8(self.squeeze8(torch.cat([x8, functional.interpolate(x16, scale_factor=2)], 1)))
        y4 = self.up4(self.squeeze4(torch.cat([x4, functional.interpolate(y8, scale_factor=2)], 1)))
        votes = self.votes(y4).float().flatten(2)
        n = len(JOINTS)
        log_weights = torch.log_softmax(votes[:, 3 * n : 4 * n], dim=-1)
        weights = log_weights.exp()
        offsets = votes[:, : 3 * n].unflatten(1, (n, 3)) + self.cells
        joints = (offsets * weights[:, :, None]).sum(dim=-1)
        errors = votes[:, 4 * n : 6 * n].unflatten(1, (n, 2))
        log_error = (errors * weights[:, :, None]).sum(dim=-1)
        seen = self.look(x16).float().flatten(2)
        person = self.person(torch.cat([seen.mean(dim=-1), seen.amax(dim=-1)], 1).to(x16.dtype))[:, 0].float()
        mask = functional.pixel_shuffle(self.mask(y4).float(), STRIDE)[:, 0]
        return Answer(joints, log_error, votes[:, -1].mean(dim=-1), person, mask, log_weights)

    def forward(self, x: Tensor) -> tuple[Tensor, ...]:
        """Answer without the weights of votes."""
        return tuple(self.vote(x)[:5])
