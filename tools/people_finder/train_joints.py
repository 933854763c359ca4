"""Train the net of the second look on simulated scenes, and on what the finder finds in them.

python tools/people_finder/train_joints.py scenes/train sightings/train.npz runs/joints --check scenes/val
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import typer
from crops import CropBatch, CropSampler
from joint_losses import Truth, joint_loss
from joint_net import JointNet
from numpy.typing import NDArray
from optimise import Plan, arithmetic, optimise
from replicas import Replica, run_replicas
from scenes import list_shards, load_scenes
from scipy.stats import rankdata
from sightings import Sightings
from torch import Tensor

from depth_pose.core.skeleton import JOINTS, MIRROR_JOINTS

_GROUPS = ("head", "neck", "chest", "pelvis", "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "foot")

_FOUND = 16
"""How many of a step's crops are what the finder finds, half people and half things."""

app = typer.Typer(add_completion=False)


@app.command()
def train(
    scenes: Annotated[Path, typer.Argument(help="Folder of shards from make_scenes.py")],
    sightings: Annotated[Path, typer.Argument(help="File from find_sightings.py")],
    out: Annotated[Path, typer.Argument(help="Folder for checkpoints")],
    check: Annotated[Path | None, typer.Option(help="Folder of other shards, to tell how it goes")] = None,
    others: Annotated[Path | None, typer.Option(help="Other sightings, likewise")] = None,
    images: Annotated[int, typer.Option(help="Crops to train on, repeats counted")] = 300_000,
    batch: Annotated[int, typer.Option(help="Crops in a step")] = 40,
    rate: Annotated[float, typer.Option(help="Highest learning rate")] = 2e-3,
    seed: Annotated[int, typer.Option(help="Start of all random numbers")] = 0,
    start: Annotated[Path | None, typer.Option(help="Checkpoint to go on from")] = None,
    save_every: Annotated[int, typer.Option(help="Crops between checkpoints")] = 80_000,
    workers: Annotated[int, typer.Option(help="Processes, each with its share of a batch")] = 1,
    exact: Annotated[
        bool | None,
        typer.Option(help="32 bits throughout; by default where the processor has no bfloat16"),
    ] = None,
) -> None:
    """Train; writes OUT/NNNNNNN.pt every so often, and OUT/last.pt."""
    plan = Plan(images, batch, rate, save_every, seed)
    run_replicas(_train, workers, scenes, sightings, out, plan, check, others, start, exact)


def _train(
    replica: Replica,
    scenes: Path,
    sightings: Path,
    out: Path,
    plan: Plan,
    check: Path | None,
    others: Path | None,
    start: Path | None,
    exact: bool | None,
) -> None:
    feed, found = CropFeed(scenes, plan.seed, replica), Sightings.load(sightings, replica)
    tells = replica.rank == 0
    apart = CropSampler(load_scenes(list_shards(check))) if check and tells else None
    found_apart = Sightings.load(others) if others and tells else None
    rng = np.random.default_rng([plan.seed, replica.rank])
    of_found = len(replica.share(range(_FOUND)))
    of_all = len(replica.share(range(plan.batch - _FOUND)))

    def step(net: JointNet) -> tuple[Tensor, dict[str, float]]:
        crops = joined([feed.next(of_all), found.batch(found.draw(of_found, rng), rng)])
        with arithmetic(exact):
            answer = net.vote(to_input(crops))
        truth = Truth(*map(torch.from_numpy, (crops.joints, crops.side, crops.person)))
        return joint_loss(answer, net.cells[0, 0, :2].T, truth)

    def remark(net: JointNet) -> dict[str, float]:
        joints = {} if apart is None else score(net, apart)
        persons = {} if found_apart is None else score_persons(net, found_apart)
        return {"people": feed.count} | joints | persons

    optimise(JointNet, step, plan, replica, out, start, remark)


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
            joints, _, behind, _ = (o.numpy() for o in net(to_input(crops)))
        named = np.linalg.norm(joints - crops.joints, axis=-1)
        swapped = np.linalg.norm(joints - crops.joints[:, MIRROR_JOINTS], axis=-1)
        other = (swapped.mean(1) < named.mean(1)) & (np.abs(crops.side) < 1)
        errors.append(np.where(other[:, None], swapped, named))
        right.append((behind > 0) == ((crops.side > 0) ^ other))
    error = np.concatenate(errors)
    kinds = {g: [n for n, name in enumerate(JOINTS) if name.endswith(g)] for g in _GROUPS}
    medians = {g: round(float(np.median(error[:, k])), 4) for g, k in kinds.items()}
    return {"facing": round(float(np.concatenate(right).mean()), 4), **medians}


def score_persons(net: JointNet, found: Sightings, most: int = 4000) -> dict[str, float]:
    """Give the share of pairs of a person and a thing that are in the right order, the finder's beside it."""
    which = np.random.default_rng(0).permutation(len(found))[:most]
    logits = []
    for k in range(0, len(which), 100):
        with torch.no_grad():
            logits.append(net(to_input(found.batch(which[k : k + 100], None)))[3].numpy())
    is_person = found.is_person[which]
    return {
        "in order": round(in_order(np.concatenate(logits), is_person), 4),
        "finder's": round(in_order(found.probability[which], is_person), 4),
    }


def in_order(values: NDArray[np.float32], is_person: NDArray[np.bool_]) -> float:
    """Area under the ROC curve."""
    rank = rankdata(values)
    n, m = int(is_person.sum()), int((~is_person).sum())
    return float((rank[is_person].sum() - n * (n + 1) / 2) / (n * m))


class CropFeed:
    """Crops from a replica's share of a folder's shards, each person once a round."""

    def __init__(self, folder: Path, seed: int, replica: Replica) -> None:
        self._rng = np.random.default_rng([seed, replica.rank])
        self._samplers = [CropSampler(load_scenes([p])) for p in replica.share(list_shards(folder))]
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
        return joined([self._samplers[k].batch(np.array([n]), self._rng) for k, n in chosen])


def joined(parts: list[CropBatch]) -> CropBatch:
    """Put batches together."""
    return CropBatch(
        *(np.concatenate([getattr(p, n) for p in parts]) for n in CropBatch.__dataclass_fields__)
    )


if __name__ == "__main__":
    app()
