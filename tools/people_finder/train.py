"""Train the people finder's net on simulated scenes.

python tools/people_finder/train.py scenes/train runs/a --images 400000
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import typer
from losses import finder_loss
from net import FinderNet
from optimise import Plan, arithmetic, optimise
from replicas import Replica, run_replicas
from scenes import Sampler, list_shards, load_scenes
from torch import Tensor

app = typer.Typer(add_completion=False)


@app.command()
def train(
    scenes: Annotated[Path, typer.Argument(help="Folder of shards from make_scenes.py")],
    out: Annotated[Path, typer.Argument(help="Folder for checkpoints")],
    images: Annotated[int, typer.Option(help="Images to train on, repeats counted")] = 400_000,
    batch: Annotated[int, typer.Option(help="Images per step")] = 32,
    rate: Annotated[float, typer.Option(help="Highest learning rate")] = 2e-3,
    seed: Annotated[int, typer.Option(help="Start of all random numbers")] = 0,
    start: Annotated[Path | None, typer.Option(help="Checkpoint to continue from")] = None,
    save_every: Annotated[int, typer.Option(help="Images between checkpoints")] = 40_000,
    workers: Annotated[int, typer.Option(help="Processes, each with its share of a batch")] = 1,
    joints: Annotated[
        bool, typer.Option(help="Train votes for joints as well, which helps a net that starts from scratch")
    ] = True,
    exact: Annotated[
        bool | None,
        typer.Option(help="Use 32 bits throughout; the default where the processor has no bfloat16"),
    ] = None,
) -> None:
    """Train; writes OUT/NNNNNNN.pt every so often, and OUT/last.pt."""
    plan = Plan(images, batch, rate, save_every, seed)
    run_replicas(_train, workers, scenes, out, plan, start, joints, exact)


def _train(
    replica: Replica,
    scenes: Path,
    out: Path,
    plan: Plan,
    start: Path | None,
    joints: bool,
    exact: bool | None,
) -> None:
    feed = Feed(scenes, plan.seed, replica)
    size = len(replica.share(range(plan.batch)))

    def step(net: FinderNet) -> tuple[Tensor, dict[str, float]]:
        inputs, truths = feed.next(size)
        with arithmetic(exact):
            outputs = net(inputs) if joints else net.seen(inputs)
        return finder_loss(outputs, *truths)

    optimise(FinderNet, step, plan, replica, out, start, lambda _: {"scenes": feed.count})


class Feed:
    """Batches from a replica's share of a folder's shards, each scene once per epoch.

    Shards that are written meanwhile are used from the next epoch on.
    """

    def __init__(self, folder: Path, seed: int, replica: Replica) -> None:
        self._rng = np.random.default_rng([seed, replica.rank])
        self._folder, self._replica = folder, replica
        self._samplers: dict[Path, Sampler] = {}
        self._load()
        if not self._samplers:
            raise typer.BadParameter(f"{folder} has no shards; make_scenes.py writes them")
        self._order: list[tuple[Path, int]] = []

    def _load(self) -> None:
        """Read the shards that are new."""
        for path in self._replica.share(list_shards(self._folder)):
            if path not in self._samplers:
                self._samplers[path] = Sampler(load_scenes([path]))

    @property
    def count(self) -> int:
        """Number of scenes."""
        return sum(len(s.scenes) for s in self._samplers.values())

    def next(self, size: int) -> tuple[Tensor, tuple[Tensor, ...]]:
        """Return the net's input, and the targets of `finder_loss`."""
        if len(self._order) < size:
            self._load()
            pairs = [(path, n) for path, s in self._samplers.items() for n in range(len(s.scenes))]
            self._order = [pairs[i] for i in self._rng.permutation(len(pairs))]
        chosen, self._order = self._order[:size], self._order[size:]
        parts = [self._samplers[k].batch(np.array([n]), self._rng) for k, n in chosen]
        names = ("features", "grid", "labels", "torso", "cell_labels", "joints")
        stacked = [torch.from_numpy(np.concatenate([getattr(p, n) for p in parts])) for n in names]
        return stacked[0].contiguous(memory_format=torch.channels_last), tuple(stacked[1:])


if __name__ == "__main__":
    app()
