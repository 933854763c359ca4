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
from joint_net import FineNet, JointNet
from optimise import arithmetic, follow
from rich.console import Console
from torch import Tensor

_LIKE, _WARM_UP, _EMA, _CLIP, _DECAY = 3.0, 100, 0.995, 5.0, 0.01
"""Weight of the channels' likeness, steps in which the rate rises, decay of the averaged weights per step,
largest norm of a gradient, and weight decay. Set by hand."""
_CHANGED, _ANNY, _FRESH, _KEPT = 0.5, 0.35, 0.25, 16_000
"""Shares of batches that are changed and of people with a body of Anny; new close-ups for each crop, and
close-ups that are kept. Set by hand."""


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
    upper, both = torch.compile(net.upper), torch.compile(whole.both)
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
            coarse, fine = both(x)
            taught = whole.weigh(coarse, fine)
        with arithmetic(None):
            own = upper(fine.x4)
        truth = Truth(*targets)._replace(person=torch.sigmoid(taught.person))
        loss, _ = joint_loss(own.answer, net.cells[0, 0, :2].T, truth)
        like = unlike(own.y8, fine.y8) + unlike(own.y4, fine.y4)
        optimiser.zero_grad()
        (loss + keep_loss(own.answer, taught) + _LIKE * like).backward()
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
