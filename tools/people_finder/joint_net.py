"""The joint net: a crop around one person to their joints, and to whether it is a person.

Every cell of the crop votes for every joint and predicts a weight for its vote; the joint is the weighted
mean of the votes (as the anchors of Xiong et al. 2019, *A2J: anchor-to-joint regression network*, and the
expected place of Sun et al. 2018, *Integral human pose regression*). Most channels are spent at an eighth of
the crop's resolution and below, where convolutions run near a processor's peak.

There are two nets. The coarse one sees the crop at 3.2 cm a pixel, and was trained before (it was released by
itself). The fine one sees it at 2 cm and features of the coarse one, predicts joints by itself, and weighs
both predictions joint by joint.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import torch
from net import ConvUnit, Residual
from torch import Tensor, nn
from torch.nn import functional

from depth_pose.core.skeleton import JOINT_INDEX, JOINTS, LANDMARKS
from depth_pose.detect._crop_kernels import CHANNELS

SIDE = 128
"""Rows and columns of a crop, pixels."""

CELL_M = 0.02
"""Size of a pixel of the crop at the torso's distance, metres: 2.56 m in all."""

LEAST_WIDTH_M = 0.01
"""Smallest width of a joint's predicted distribution, metres."""

STRIDE = 4
"""Side of a voting cell, pixels."""

_CELLS = SIDE // STRIDE
COARSE_CELL_M = 0.032
"""Size of a pixel of the coarse net's crop, metres."""

_COARSE_SIDE, _COARSE_WIDTH = 80, 48
"""Pixels along the coarse net's crop, and channels that it passes on."""
_TRUST, _DOUBT = -1.5, -1.0
"""Initial weight of the coarse answer: logit at an error of 1 m, and its slope by the logarithm."""
_HEELS = len(LANDMARKS) - len(JOINTS)
_PERSON_WIDTH = 64
"""Channels from which "is a person" and "seen from behind" are predicted."""


class Answer(NamedTuple):
    """The net's output.

    Attributes
    ----------
    landmarks : (N, L, 3)
        Joints, then heels, in the crop's coordinates, metres.
    log_error : (N, L, 2)
        Logarithms of the widths of their distributions, in the image plane and in depth, metres.
    behind, person : (N,)
        Logits of being seen from behind, and of being a person.
    mask : (N, SIDE, SIDE)
        Logits of a pixel showing the person.
    log_weights : (N, L, cells)
        Logarithms of the weights of the fine net's votes.
    own : (N, L, 3)
        Landmarks from the fine net alone.
    """

    landmarks: Tensor
    log_error: Tensor
    behind: Tensor
    person: Tensor
    mask: Tensor
    log_weights: Tensor
    own: Tensor


class _Unit(nn.Sequential):
    """Convolution and ReLU."""

    def __init__(self, channels_in: int, channels_out: int, size: int = 3, stride: int = 1) -> None:
        super().__init__(nn.Conv2d(channels_in, channels_out, size, stride, size // 2), nn.ReLU(inplace=True))


class _Straight(nn.Module):
    """Two convolutions beside a straight path."""

    def __init__(self, channels: int, dilation: int = 1) -> None:
        super().__init__()
        self.first = _Unit(channels, channels)
        self.second = nn.Sequential(nn.Conv2d(channels, channels, 3, 1, dilation, dilation))

    def forward(self, x: Tensor) -> Tensor:
        """Add what the two convolutions find."""
        return functional.relu(x + self.second(self.first(x)))


class Coarse(NamedTuple):
    """The coarse net's output; as `Answer`, and the channels that it passes on, (N, 48, 20, 20)."""

    joints: Tensor
    log_error: Tensor
    behind: Tensor
    person: Tensor
    felt: Tensor


class CoarseNet(nn.Module):
    """The net that looks at 80x80 pixels of 3.2 cm; its norms are part of its convolutions."""

    def __init__(self, widths: tuple[int, int, int] = (24, _COARSE_WIDTH, 112)) -> None:
        super().__init__()
        a, b, c = widths
        n, head = len(JOINTS), 96
        self.stem = nn.Sequential(_Unit(CHANNELS, a, 3, 2), _Unit(a, a))
        self.down4 = nn.Sequential(_Unit(a, b, 3, 2), _Straight(b))
        self.down8 = nn.Sequential(_Unit(b, c, 3, 2), _Straight(c, 2), _Straight(c, 4))
        self.squeeze = _Unit(b + c, b, 1)
        self.up4 = _Straight(b)
        self.votes = nn.Sequential(_Unit(b, head), nn.Conv2d(head, 5 * n + 1, 1))
        self.look = _Unit(c, _PERSON_WIDTH)
        self.person = nn.Linear(2 * _PERSON_WIDTH, 1)
        self.register_buffer("cells", _places(_COARSE_SIDE // 4, 4 * COARSE_CELL_M), persistent=False)

    def forward(self, x: Tensor) -> Coarse:
        """Predict from a crop of the coarse net's size."""
        x4 = self.down4(self.stem(x))
        x8 = self.down8(x4)
        y4 = self.up4(self.squeeze(torch.cat([x4, functional.interpolate(x8, scale_factor=2)], 1)))
        votes, n = self.votes(y4).float().flatten(2), len(JOINTS)
        weights = torch.softmax(votes[:, 3 * n : 4 * n], dim=-1)
        offsets = votes[:, : 3 * n].unflatten(1, (n, 3)) + self.cells
        joints = (offsets * weights[:, :, None]).sum(dim=-1)
        errors = (votes[:, 4 * n : 5 * n] * weights).sum(dim=-1)
        seen = self.look(x8).float().flatten(2)
        person = self.person(_pooled(seen).to(x8.dtype))[:, 0].float()
        return Coarse(joints, errors, votes[:, -1].mean(dim=-1), person, y4)

    def load_onnx(self, path: Path) -> None:
        """Load the weights of an exported net, whose layers have the same names as here."""
        import onnx
        from onnx import numpy_helper
        from onnx_weights import widen

        model = onnx.load(path)
        widen(model)
        held = {t.name: torch.from_numpy(numpy_helper.to_array(t).copy()) for t in model.graph.initializer}
        state = {}
        for node in model.graph.node:
            if node.op_type in ("Conv", "Gemm"):
                layer = layer_of(node.name)
                state[f"{layer}.weight"], state[f"{layer}.bias"] = held[node.input[1]], held[node.input[2]]
        missing = set(self.state_dict()) - set(state)
        if missing:
            raise ValueError(f"{path} has no layer {', '.join(sorted(missing))}")
        self.load_state_dict({k: v.float() for k, v in state.items()})


def heels_of_ankles(state: dict[str, Tensor]) -> dict[str, Tensor]:
    """Return a first state of the heels' layer: heels are where a net's weights place the ankles."""
    n, ankles = len(JOINTS), torch.tensor([JOINT_INDEX[f"{side}_ankle"] for side in ("left", "right")])
    votes = (3 * ankles[:, None] + torch.arange(3)).flatten()
    errors = (4 * n + 3 * ankles[:, None] + torch.arange(2)).flatten()
    rows = torch.cat([votes, 3 * n + ankles, errors])
    return {f"heels.{name}": state[f"votes.{name}"][rows] for name in ("weight", "bias")}


def layer_of(node: str) -> str:
    """Return the layer name of a node of an exported net, as ``/down4/down4.1/first/first.0/Conv``."""
    names: list[str] = []
    for name in node.split("/")[1:-1]:
        if names and name.startswith(f"{names[-1]}."):
            names.pop()
        names.append(name)
    return ".".join(names)


def _places(cells: int, cell_m: float) -> Tensor:
    """Centres of the cells in the crop, metres, (1, 1, 3, cells * cells)."""
    place = (torch.arange(cells) + 0.5 - cells / 2) * cell_m
    across, down = place.expand(cells, cells), place[:, None].expand(cells, cells)
    return torch.stack([across, down, torch.zeros(cells, cells)]).reshape(1, 1, 3, -1)


def _pooled(channels: Tensor) -> Tensor:
    """Means, then maxima of channels (N, C, cells), (N, 2 C).

    The gradient of ``amax`` is not finite once `torch.compile` has fused it with a rounding.
    """
    return torch.cat([channels.mean(dim=-1), channels.max(dim=-1).values], 1)


def _nearest(cells: int, cell_m: float, others: int, other_m: float) -> Tensor:
    """Return for each cell of a centred row the nearest cell of another, whose cells differ in size."""
    place = (torch.arange(cells) + 0.5 - cells / 2) * cell_m
    return ((place / other_m + others / 2 - 0.5).round()).clamp(0, others - 1).long()


class Fine(NamedTuple):
    """The fine net's answer, and what else others need of it.

    Attributes
    ----------
    answer : Answer
    trust : (N, J)
        Logits of the coarse net's joints, beside its own.
    x4, y8, y4 : (N, C, cells, cells)
        Channels at a fourth of the resolution on the way down, at an eighth and a fourth on the way up.
    """

    answer: Answer
    trust: Tensor
    x4: Tensor
    y8: Tensor
    y4: Tensor


class FineNet(nn.Module):
    """A crop's features to joints, without the coarse net; `leave_out_coarse.py` trains it.

    Parameters
    ----------
    widths : tuple of 4 int
        Channels at 1/2, 1/4, 1/8 and 1/16 of the input's resolution.
    felt : int
        Number of channels from the coarse net.
    """

    def __init__(self, widths: tuple[int, int, int, int] = (24, 64, 128, 192), felt: int = 0) -> None:
        super().__init__()
        a, b, c, d = widths
        self.stem = ConvUnit(CHANNELS, a, 5, 2)
        self.down4 = nn.Sequential(ConvUnit(a, b, 3, 2), ConvUnit(b, b))
        self.down8 = nn.Sequential(ConvUnit(b, c, 3, 2), Residual(c), Residual(c))
        self.down16 = nn.Sequential(ConvUnit(c, d, 3, 2), Residual(d))
        self.squeeze8 = ConvUnit(c + d + felt, 96, 1)
        self.up8 = ConvUnit(96, 96)
        self.squeeze4 = ConvUnit(b + 96, b, 1)
        self.up4 = ConvUnit(b, b)
        n = len(JOINTS)
        # votes (metres), their weights, two logarithms of errors, trust in the coarse answer; behind
        self.votes = nn.Conv2d(b, 7 * n + 1, 1)
        self.heels = nn.Conv2d(b, 6 * _HEELS, 1)  # votes, weights and errors; the coarse net has no heels
        self.mask = nn.Conv2d(b, STRIDE**2, 1)
        self.look = ConvUnit(d, _PERSON_WIDTH, 1)
        self.person = nn.Linear(2 * _PERSON_WIDTH, 1)
        self.behind = nn.Linear(2 * _PERSON_WIDTH, 1)
        self.register_buffer("cells", _places(_CELLS, STRIDE * CELL_M), persistent=False)

    @classmethod
    def of(cls, whole: JointNet) -> FineNet:
        """Return the fine part of a net; the channels that it got from the coarse one are left out."""
        net, given = cls(), whole.state_dict()
        state = {name: given[name] for name in net.state_dict()}
        inputs = net.squeeze8[0].in_channels
        state["squeeze8.0.weight"] = state["squeeze8.0.weight"][:, :inputs]
        net.load_state_dict(state)
        return net

    def upper(self, x4: Tensor, felt: Tensor | None = None) -> Fine:
        """Return the answer from channels at a fourth of the resolution, and from those of the coarse net."""
        x8 = self.down8(x4)
        x16 = self.down16(x8)
        parts = [x8, functional.interpolate(x16, scale_factor=2)] + ([] if felt is None else [felt])
        y8 = self.up8(self.squeeze8(torch.cat(parts, 1)))
        y4 = self.up4(self.squeeze4(torch.cat([x4, functional.interpolate(y8, scale_factor=2)], 1)))
        votes, heels = self.votes(y4).float().flatten(2), self.heels(y4).float().flatten(2)
        own, said, log_weights = self._count(votes[:, :-1], len(JOINTS))
        heel, heel_error, heel_weights = self._count(heels, _HEELS)
        landmarks, errors = torch.cat([own, heel], 1), torch.cat([said[:, :, :2], heel_error], 1)
        seen = self.look(x16).float().flatten(2)
        pooled = _pooled(seen).to(x16.dtype)
        person = self.person(pooled)[:, 0].float()
        behind = self.behind(pooled)[:, 0].float() + votes[:, -1].mean(dim=-1)
        mask = functional.pixel_shuffle(self.mask(y4).float(), STRIDE)[:, 0]
        log_weights = torch.cat([log_weights, heel_weights], 1)
        answer = Answer(landmarks, errors, behind, person, mask, log_weights, landmarks)
        return Fine(answer, said[:, :, 2], x4, y8, y4)

    def vote(self, x: Tensor) -> Answer:
        """Return the full output, as training needs it."""
        return self.upper(self.down4(self.stem(x))).answer

    def forward(self, x: Tensor) -> tuple[Tensor, ...]:
        """Return the output without what only training needs."""
        return tuple(self.vote(x)[:5])

    def _count(self, votes: Tensor, n: int) -> tuple[Tensor, Tensor, Tensor]:
        """Return the weighted means of votes for ``n`` points, and of what else they say; their weights."""
        log_weights = torch.log_softmax(votes[:, 3 * n : 4 * n], dim=-1)
        weights = log_weights.exp()[:, :, None]
        offsets = votes[:, : 3 * n].unflatten(1, (n, 3)) + self.cells
        said = (votes[:, 4 * n :].unflatten(1, (n, -1)) * weights).sum(dim=-1)
        return (offsets * weights).sum(dim=-1), said, log_weights


class JointNet(FineNet):
    """A crop's features to joints, with the coarse net."""

    def __init__(self) -> None:
        super().__init__(felt=_COARSE_WIDTH)
        n = len(JOINTS)
        self.trust = nn.Parameter(torch.full((n,), _TRUST))
        self.doubt = nn.Parameter(torch.full((n,), _DOUBT))
        self.coarse = CoarseNet().requires_grad_(False)
        self.register_buffer("middle", _nearest(_COARSE_SIDE, COARSE_CELL_M, SIDE, CELL_M), persistent=False)
        handed = _nearest(SIDE // 8, 8 * CELL_M, _COARSE_SIDE // 4, 4 * COARSE_CELL_M)
        self.register_buffer("handed", handed, persistent=False)

    def both(self, x: Tensor, middle: Tensor | None = None) -> tuple[Coarse, Fine]:
        """Return both nets' answers; ``middle`` is the coarse net's input, if prepared."""
        if middle is None:
            middle = x.index_select(2, self.middle).index_select(3, self.middle)
        coarse = self.coarse(middle)
        felt = coarse.felt.index_select(2, self.handed).index_select(3, self.handed)
        return coarse, self.upper(self.down4(self.stem(x)), felt)

    def vote(self, x: Tensor, middle: Tensor | None = None) -> Answer:
        """Return the full output, as training needs it; ``middle`` is the coarse net's input, if prepared."""
        return self.weigh(*self.both(x, middle))

    def weigh(self, coarse: Coarse, fine: Fine) -> Answer:
        """Return the answer of both nets."""
        own, n = fine.answer, len(JOINTS)
        share = torch.sigmoid(fine.trust + self.trust + self.doubt * coarse.log_error)[:, :, None]
        joints = share * coarse.joints + (1 - share) * own.landmarks[:, :n]
        return own._replace(
            landmarks=torch.cat([joints, own.landmarks[:, n:]], 1),
            behind=coarse.behind + own.behind,
            person=coarse.person + own.person,
        )

    def forward(self, x: Tensor, middle: Tensor | None = None) -> tuple[Tensor, ...]:
        """Return the output without what only training needs."""
        return tuple(self.vote(x, middle)[:5])
