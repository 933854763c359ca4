"""Train the net of the second look on simulated scenes.

python tools/people_finder/train_joints.py scenes/train runs/joints --check scenes/val
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import typer
from crops import CropBatch, CropSampler
from joint_losses import joint_loss
from joint_net import JointNet
from optimise import Plan, optimise
from scenes import list_shards, load_scenes
from torch import Tensor

from depth_pose.core.skeleton import JOINTS, MIRROR_JOINTS

_GROUPS = ("head", "neck", "chest", "pelvis", "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "foot")

app = typer.Typer(add_completion=False)


@app.command()
def train(
    scenes: Annotated[Path, typer.Argument(help="Folder of shards from make_scenes.py")],
    out: Annotated[Path, typer.Argument(help="Folder for checkpoints")],
    check: Annotated[Path | None, typer.Option(help="Folder of other shards, to tell how it goes")] = None,
    images: Annotated[int, typer.Option(help="Crops to train on, repeats counted")] = 300_000,
    batch: Annotated[int, typer.Option(help="Crops in a step")] = 32,
    rate: Annotated[float, typer.Option(help="Highest learning rate")] = 2e-3,
    seed: Annotated[int, typer.Option(help="Start of all random numbers")] = 0,
    start: Annotated[Path | None, typer.Option(help="Checkpoint to go on from")] = None,
    save_every: Annotated[int, typer.Option(help="Crops between checkpoints")] = 40_000,
    exact: Annotated[bool, typer.Option(help="32 bits throughout, for processors without bfloat16")] = False,
) -> None:
    """Train; writes OUT/NNNNNNN.pt every so often, and OUT/last.pt."""
    feed = CropFeed(scenes, seed)
    others = None if check is None else CropSampler(load_scenes(list_shards(check)))

    def step(net: JointNet) -> tuple[Tensor, dict[str, float]]:
        crops = feed.next(batch)
        with torch.autocast("cpu", torch.bfloat16, enabled=not exact):
            outputs = net.vote(to_input(crops))
        truth, side = torch.from_numpy(crops.joints), torch.from_numpy(crops.side)
        return joint_loss(outputs, net.cells[0, 0, :2].T, truth, side)

    def remark(net: JointNet) -> dict[str, float]:
        return {"people": feed.count} | ({} if others is None else score(net, others))

    optimise(JointNet, step, Plan(images, batch, rate, save_every, seed), out, start, remark)


def to_input(crops: CropBatch) -> Tensor:
    """Give a batch as the net takes it."""
    return torch.from_numpy(crops.features).contiguous(memory_format=torch.channels_last)


def score(net: JointNet, sampler: CropSampler, most: int = 800) -> dict[str, float]:
    """Give median errors, metres, of people who are well seen, and the share of facings that are right."""
    number = sampler.people[:, 0], sampler.people[:, 1]
    seen = np.flatnonzero(sampler.scenes.visible[number] >= 0.6)[:most]
    errors, right = [], []
    for k in range(0, len(seen), 50):
        crops = sampler.batch(seen[k : k + 50], None)
        with torch.no_grad():
            joints, _, behind = (o.numpy() for o in net(to_input(crops)))
        named = np.linalg.norm(joints - crops.joints, axis=-1)
        swapped = np.linalg.norm(joints - crops.joints[:, MIRROR_JOINTS], axis=-1)
        other = (swapped.mean(1) < named.mean(1)) & (np.abs(crops.side) < 1)
        errors.append(np.where(other[:, None], swapped, named))
        right.append((behind > 0) == ((crops.side > 0) ^ other))
    error = np.concatenate(errors)
    kinds = {g: [n for n, name in enumerate(JOINTS) if name.endswith(g)] for g in _GROUPS}
    medians = {g: round(float(np.median(error[:, k])), 4) for g, k in kinds.items()}
    return {"facing": round(float(np.concatenate(right).mean()), 4), **medians}


class CropFeed:
    """Crops from a folder of shards, each person once a round."""

    def __init__(self, folder: Path, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._samplers = [CropSampler(load_scenes([p])) for p in list_shards(folder)]
        if not self._samplers:
            raise typer.BadParameter(f"{folder} has no shards; make_scenes.py writes them")
        self._order: list[tuple[int, int]] = []

    @property
    def count(self) -> int:
        """How many people are known."""
        return sum(len(s.people) for s in self._samplers)

    def next(self, size: int) -> CropBatch:
        """Give the next few, in random order."""
        if len(self._order) < size:
            pairs = [(k, n) for k, s in enumerate(self._samplers) for n in range(len(s.people))]
            self._order = [pairs[i] for i in self._rng.permutation(len(pairs))]
        chosen, self._order = self._order[:size], self._order[size:]
        parts = [self._samplers[k].batch(np.array([n]), self._rng) for k, n in chosen]
        names = CropBatch.__dataclass_fields__
        return CropBatch(*(np.concatenate([getattr(p, n) for p in parts]) for n in names))


if __name__ == "__main__":
    app()
