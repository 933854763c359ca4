"""The net of the second look: a crop around one person to their joints, and to whether it is a person.

Every cell of the crop votes for every joint and says how much its vote counts; the joint is where the
votes' mean lies (as the anchors of Xiong et al. 2019, *A2J: anchor-to-joint regression network*, and the
expected place of Sun et al. 2018, *Integral human pose regression*).
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from net import ConvUnit, Residual
from torch import Tensor, nn
from torch.nn import functional

from depth_pose.core.skeleton import JOINTS
from depth_pose.detect._crop_kernels import CELL_M, CHANNELS, SIDE

_CELLS = SIDE // 4
"""Cells along a side that vote, each of four by four pixels."""
_HEAD_WIDTH = 96
"""Channels before the votes; no fewer than what they have to say."""


_PERSON_WIDTH = 64
"""Channels from which it is said whether this is a person."""


class Answer(NamedTuple):
    """What the net says.

    Attributes
    ----------
    joints : (N, J, 3)
        In the crop's coordinates, metres.
    log_error : (N, J)
        Logarithms of their errors.
    behind, person : (N,)
        Logits of being seen from behind, and of being a person.
    log_weights : (N, J, cells)
        Logarithms of the weights of the cells' votes.
    """

    joints: Tensor
    log_error: Tensor
    behind: Tensor
    person: Tensor
    log_weights: Tensor


class JointNet(nn.Module):
    """A crop's features to joints.

    Parameters
    ----------
    widths : tuple of 3 int
        Channels at 1/2, 1/4 and 1/8 of the input's resolution.
    """

    def __init__(self, widths: tuple[int, int, int] = (24, 48, 112)) -> None:
        super().__init__()
        a, b, c = widths
        self.stem = nn.Sequential(ConvUnit(CHANNELS, a, 3, 2), ConvUnit(a, a))
        self.down4 = nn.Sequential(ConvUnit(a, b, 3, 2), Residual(b))
        self.down8 = nn.Sequential(ConvUnit(b, c, 3, 2), Residual(c, 2), Residual(c, 4))
        self.squeeze = ConvUnit(b + c, b, 1)
        self.up4 = Residual(b)
        n = len(JOINTS)
        # votes (metres), weights of the votes, logarithms of the joints' errors, logit of seen from behind
        self.votes = nn.Sequential(ConvUnit(b, _HEAD_WIDTH), nn.Conv2d(_HEAD_WIDTH, 5 * n + 1, 1))
        self.look = ConvUnit(c, _PERSON_WIDTH)
        self.person = nn.Linear(2 * _PERSON_WIDTH, 1)
        place = (torch.arange(_CELLS) + 0.5 - _CELLS / 2) * 4 * CELL_M
        across, down = place.expand(_CELLS, _CELLS), place[:, None].expand(_CELLS, _CELLS)
        cells = torch.stack([across, down, torch.zeros(_CELLS, _CELLS)]).reshape(1, 1, 3, -1)
        self.register_buffer("cells", cells, persistent=False)

    def vote(self, x: Tensor) -> Answer:
        """Answer with all that training asks for."""
        x4 = self.down4(self.stem(x))
        x8 = self.down8(x4)
        y4 = self.up4(self.squeeze(torch.cat([x4, functional.interpolate(x8, scale_factor=2)], 1)))
        votes = self.votes(y4).float().flatten(2)
        n = len(JOINTS)
        log_weights = torch.log_softmax(votes[:, 3 * n : 4 * n], dim=-1)
        weights = log_weights.exp()
        offsets = votes[:, : 3 * n].unflatten(1, (n, 3)) + self.cells
        joints = (offsets * weights[:, :, None]).sum(dim=-1)
        errors = (votes[:, 4 * n : 5 * n] * weights).sum(dim=-1)
        seen = self.look(x8).float().flatten(2)
        person = self.person(torch.cat([seen.mean(dim=-1), seen.amax(dim=-1)], 1).to(x8.dtype))[:, 0].float()
        return Answer(joints, errors, votes[:, -1].mean(dim=-1), person, log_weights)

    def forward(self, x: Tensor) -> tuple[Tensor, ...]:
        """Answer without the weights of votes."""
        return tuple(self.vote(x)[:4])
