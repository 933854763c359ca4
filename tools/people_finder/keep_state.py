"""Store a checkpoint of a net in one small file that can be committed, and read it back.

    python tools/people_finder/keep_state.py store joints/last.pt tools/people_finder/state/joints.npz
    python tools/people_finder/keep_state.py load tools/people_finder/state/joints.npz start.pt

Large tensors get 16 bits; statistics of norms and small tensors keep 32. The optimiser's moments are left
out: training begins with a rise of the rate, in which they are found again. Unlike the released weights
(`warm_start_joints`), which are 8-bit integers and lie between two checkpoints, this is where training was.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import typer

_FEW = 1024
"""Tensors of fewer values stay in 32 bits."""

app = typer.Typer(add_completion=False)


@app.command()
def store(
    checkpoint: Annotated[Path, typer.Argument(help="Weights of a net (.pt)")],
    out: Annotated[Path, typer.Argument(help="File to write (.npz)")],
) -> None:
    """Write a checkpoint in 16 bits."""
    values = {name: value.numpy() for name, value in torch.load(checkpoint, weights_only=True).items()}
    halves = {
        name: value.astype(np.float16) if value.dtype == np.float32 and value.size >= _FEW else value
        for name, value in values.items()
    }
    if wrong := [name for name, value in halves.items() if not np.isfinite(value).all()]:
        raise typer.BadParameter(f"{checkpoint}: {', '.join(wrong)} is not finite in 16 bits")
    out.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(out, **halves)
    print(f"{out}: {out.stat().st_size / 1e6:.1f} MB")


@app.command()
def load(
    state: Annotated[Path, typer.Argument(help="File from 'store' (.npz)")],
    out: Annotated[Path, typer.Argument(help="Checkpoint to write (.pt)")],
) -> None:
    """Write a checkpoint that training starts from."""
    with np.load(state) as z:
        values = {name: torch.from_numpy(z[name]) for name in z.files}
    out.parent.mkdir(parents=True, exist_ok=True)
    torch.save({name: v.float() if v.is_floating_point() else v for name, v in values.items()}, out)


if __name__ == "__main__":
    app()
