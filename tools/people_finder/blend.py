"""Interpolate between a checkpoint and another that was trained further from it.

    python tools/people_finder/blend.py start.pt people/last.pt people/blend.pt --share 0.4
    python tools/people_finder/blend.py start.pt joints/last.pt joints/blend.pt --share 0.5 --no-fold

A short training on new kinds of rooms forgets some of what a long one had learned. A net between the two
keeps both (Wortsman et al. 2022, *Robust fine-tuning of zero-shot models*). Norms are folded into the
convolutions first, because their statistics and scales belong together. Without folding all values are
interpolated as they are, for either net; the released joint net was made so.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import torch
import typer
from net import FinderNet
from torch import Tensor
from warm_start import norm_after


def folded(checkpoint: Path) -> dict[str, Tensor]:
    """Read a checkpoint and fold the scales of norms into the convolutions; norms keep only shifts."""
    net = FinderNet()
    net.load_state_dict(torch.load(checkpoint, weights_only=True))
    with torch.no_grad():
        for convolution, norm in norm_after(net).items():
            scale = norm.weight / torch.sqrt(norm.running_var + norm.eps)
            convolution.weight.mul_(scale[:, None, None, None])
            norm.bias.sub_(norm.running_mean * scale)
            norm.weight.fill_(1.0)
            norm.running_mean.zero_()
            norm.running_var.fill_(1.0 - norm.eps)
    return net.state_dict()


def main(
    start: Annotated[Path, typer.Argument(help="Checkpoint that training started from")],
    end: Annotated[Path, typer.Argument(help="Checkpoint that it ended with")],
    out: Annotated[Path, typer.Argument(help="Checkpoint to write")],
    share: Annotated[
        float, typer.Option(help="Fraction of the way from the first to the second, 0 to 1", min=0.0, max=1.0)
    ] = 0.4,
    fold: Annotated[bool, typer.Option(help="Fold the norms of the finder first")] = True,
) -> None:
    """Write the checkpoint."""
    first, last = (folded(path) if fold else torch.load(path, weights_only=True) for path in (start, end))
    torch.save(
        {n: torch.lerp(v, last[n], share) if v.is_floating_point() else v for n, v in first.items()}, out
    )


if __name__ == "__main__":
    typer.run(main)
