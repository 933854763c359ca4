"""Train the fine net alone: what the coarse net gave it is learned from the answers of both.

    python tools/people_finder/keep_state.py load tools/people_finder/state/joints.npz teacher.pt
    python tools/people_finder/leave_out_coarse.py teacher.pt fine.pt --sightings sightings.npz --crops 4000
    python tools/people_finder/leave_out_coarse.py teacher.pt fine.pt --sightings sightings.npz \
        --start fine.pt --crops 200000 --rate 2.5e-4

The fine net starts with its weights beside the coarse one; the channels that it got from that are left out.
It is taught the truth, the answers of both nets, and the fine net's channels at an eighth and a fourth of the
crop's resolution, which hold all that the last layers need. So a few thousand crops teach what else takes
hundreds of thousands. The first layers, to a fourth of the resolution, stay as they are, and so do the
statistics of norms.
"""

from __future__ import annotations

import copy
import json
import time
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import train_joints
import typer
from close_ups import CloseUpMaker
from crops import CropSampler
from joint_losses import Truth, joint_loss, keep_loss
from joint_net import _HEELS, STRIDE, Answer, JointNet, _pooled
from net import ConvUnit
from optimise import arithmetic, follow
from rich.console import Console
from torch import Tensor
from torch.nn import functional

from depth_pose.core.skeleton import JOINTS

_LIKE, _WARM_UP, _EMA, _CLIP, _DECAY = 3.0, 100, 0.995, 5.0, 0.01
"""Weight of the channels' likeness, steps in which the rate rises, decay of the averaged weights per step,
largest norm of a gradient, and weight decay. Set by hand."""
_CHANGED, _ANNY, _FRESH, _KEPT = 0.5, 0.35, 0.25, 16_000
"""Shares of batches that are changed and of people with a body of Anny; new close-ups for each crop, and
close-ups that are kept. Set by hand."""


class FineNet(JointNet):
    """The net without the coarse one."""

    def __init__(self) -> None:
        super().__init__()
        del self.coarse, self.trust, self.doubt
        self.squeeze8 = ConvUnit(128 + 192, 96, 1)

    @classmethod
    def of(cls, whole: JointNet) -> FineNet:
        """Return the fine part of a net."""
        net, given = cls(), whole.state_dict()
        state = {name: given[name] for name in net.state_dict()}
        state["squeeze8.0.weight"] = state["squeeze8.0.weight"][:, : 128 + 192]
        net.load_state_dict(state)
        return net

    def upper(self, x4: Tensor) -> tuple[Answer, Tensor, Tensor]:
        """Return the answer from channels at a fourth of the resolution, and the channels that follow."""
        x8 = self.down8(x4)
        return answer_of(self, x4, x8, self.down16(x8), None)

    def forward(self, x: Tensor, middle: Tensor | None = None) -> tuple[Tensor, ...]:
        """Return the output without what only training needs."""
        return tuple(self.upper(self.down4(self.stem(x)))[0][:5])


def answer_of(
    net: JointNet, x4: Tensor, x8: Tensor, x16: Tensor, felt: Tensor | None
) -> tuple[Answer, Tensor, Tensor]:
    """Return the fine net's own answer, and its channels at an eighth and a fourth of the resolution."""
    parts = [x8, functional.interpolate(x16, scale_factor=2)] + ([] if felt is None else [felt])
    y8 = net.up8(net.squeeze8(torch.cat(parts, 1)))
    y4 = net.up4(net.squeeze4(torch.cat([x4, functional.interpolate(y8, scale_factor=2)], 1)))
    votes, heels = net.votes(y4).float().flatten(2), net.heels(y4).float().flatten(2)
    own, said, log_weights = net._count(votes[:, :-1], len(JOINTS))
    heel, heel_error, heel_weights = net._count(heels, _HEELS)
    landmarks, errors = torch.cat([own, heel], 1), torch.cat([said[:, :, :2], heel_error], 1)
    pooled = _pooled(net.look(x16).float().flatten(2)).to(x16.dtype)
    person = net.person(pooled)[:, 0].float()
    behind = net.behind(pooled)[:, 0].float() + votes[:, -1].mean(dim=-1)
    mask = functional.pixel_shuffle(net.mask(y4).float(), STRIDE)[:, 0]
    log_weights = torch.cat([log_weights, heel_weights], 1)
    return Answer(landmarks, errors, behind, person, mask, log_weights, landmarks), y8, y4


def teach(whole: JointNet, x: Tensor) -> tuple[Answer, Tensor, Tensor, Tensor]:
    """Return the answer of both nets, and the fine one's channels: lower ones, then as `answer_of`."""
    x4 = whole.down4(whole.stem(x))
    x8 = whole.down8(x4)
    middle = x.index_select(2, whole.middle).index_select(3, whole.middle)
    felt = whole.coarse(middle).felt.index_select(2, whole.handed).index_select(3, whole.handed)
    _, y8, y4 = answer_of(whole, x4, x8, whole.down16(x8), felt)
    return whole.vote(x, middle), x4, y8, y4


def unlike(channels: Tensor, taught: Tensor) -> Tensor:
    """Return the mean square difference of channels, relative to those taught."""
    return (channels.float() - taught.float()).square().mean() / taught.float().square().mean()


def main(
    teacher: Annotated[Path, typer.Argument(help="Weights of both nets (.pt)")],
    out: Annotated[Path, typer.Argument(help="Weights of the fine net (.pt); those of the moment, too")],
    sightings: Annotated[Path, typer.Option(help="File from find_sightings.py")],
    crops: Annotated[int, typer.Option(help="Crops in all")] = 200_000,
    rate: Annotated[float, typer.Option(help="Highest learning rate")] = 1e-3,
    hold: Annotated[float, typer.Option(help="Share of the crops after which the rate falls")] = 0.3,
    batch: Annotated[int, typer.Option(help="Crops per step")] = 64,
    found: Annotated[int, typer.Option(help="Number of a step's crops that are sightings")] = 8,
    start: Annotated[Path | None, typer.Option(help="Weights of a fine net to start from")] = None,
    seed: Annotated[int, typer.Option(help="Start of all random numbers")] = 11,
) -> None:
    """Train; a line for every 300 seconds."""
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    whole = JointNet()
    whole.load_state_dict(torch.load(teacher, weights_only=True))
    net = FineNet.of(whole)
    if start is not None:
        net.load_state_dict(torch.load(start, weights_only=True))
    whole, net = (n.eval().to(memory_format=torch.channels_last) for n in (whole, net))
    whole.requires_grad_(False)
    for kept in (net.stem, net.down4):
        kept.requires_grad_(False)
    average, learned = copy.deepcopy(net), [p for p in net.parameters() if p.requires_grad]
    optimiser = torch.optim.AdamW(learned, torch.zeros(()), weight_decay=_DECAY, fused=True)
    upper, taught_by = torch.compile(net.upper), torch.compile(lambda x: teach(whole, x))
    homes = (batch - found) // 2
    counts = train_joints.Counts(batch - found - homes, homes, found)
    drawn = train_joints.Batches((seed, 0), counts, sightings, _KEPT, _FRESH, _ANNY, 1, 0.5)
    rng, steps, told = np.random.default_rng(seed), crops // batch, time.monotonic()
    batches = train_joints.on_device(drawn, 1, "cpu", _CHANGED, rng)
    makers = {"": CloseUpMaker(2, homes=0.0), "home_": CloseUpMaker(2, homes=1.0, stereo=0.5)}
    apart = {
        name: CropSampler().batch(train_joints._check_set(maker), None) for name, maker in makers.items()
    }
    for step in range(steps):
        features, *targets = next(batches)
        x = features.float().contiguous(memory_format=torch.channels_last)
        with arithmetic(None), torch.no_grad():
            taught, x4, *channels = taught_by(x)
        with arithmetic(None):
            answer, *own = upper(x4)
        truth = Truth(*targets)._replace(person=torch.sigmoid(taught.person))
        loss, _ = joint_loss(answer, net.cells[0, 0, :2].T, truth)
        like = sum(unlike(a, b) for a, b in zip(own, channels, strict=True))
        optimiser.zero_grad()
        (loss + keep_loss(answer, taught) + _LIKE * like).backward()
        torch.nn.utils.clip_grad_norm_(learned, _CLIP)
        share = min((step + 1) / _WARM_UP, 1.0, (1.0 - step / steps) / (1.0 - hold))
        optimiser.param_groups[0]["lr"].fill_(share * rate)
        optimiser.step()
        follow(average, net, min(_EMA, (1 + step) / (10 + step)))
        if time.monotonic() > told + 300 or step + 1 == steps:
            told = time.monotonic()
            torch.save(average.state_dict(), out)
            scores = {
                name + k: v for name, c in apart.items() for k, v in train_joints.score(average, c).items()
            }
            Console().print_json(
                json.dumps({"crops": (step + 1) * batch, "unlike": like.item()} | scores), indent=None
            )


if __name__ == "__main__":
    typer.run(main)
