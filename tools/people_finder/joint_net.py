"""The net of the second look: a crop around one person to their joints.

Every cell of the crop votes for every joint and says how much its vote counts; the joint is where the
votes' mean lies (as the anchors of Xiong et al. 2019, *A2J: anchor-to-joint regression network*, and the
expected place of Sun et al. 2018, *Integral human pose regression*).
"""

from __future__ import annotations

import torch
from net import ConvUnit, Residual
from torch import Tensor, nn
from torch.nn import functional

from depth_pose.core.skeleton import JOINTS
from depth_pose.people._crop_kernels import CELL_M, CHANNELS, SIDE

_CELLS = SIDE // 4
_HEAD_WIDTH = 96
"""Channels before the votes; no fewer than what they have to say."""


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
        place = (torch.arange(_CELLS) + 0.5 - _CELLS / 2) * 4 * CELL_M
        across, down = place.expand(_CELLS, _CELLS), place[:, None].expand(_CELLS, _CELLS)
        cells = torch.stack([across, down, torch.zeros(_CELLS, _CELLS)]).reshape(1, 1, 3, -1)
        self.register_buffer("cells", cells, persistent=False)

    def vote(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """As `forward`, and last the logarithms of the weights of the cells' votes (N, J, cells)."""
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
        return joints, errors, votes[:, -1].mean(dim=-1), log_weights

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Give joints (N, J, 3) in the crop's coordinates, logarithms of their errors (N, J), logit (N,)."""
        return self.vote(x)[:3]
