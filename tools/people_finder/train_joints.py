"""Train the net of the second look on people simulated during training.

    git show fe355e5:src/depth_pose/people/weights/joint_finder.onnx > coarse.onnx
    python tools/people_finder/train_joints.py runs/joints --coarse coarse.onnx --crops 1000000 --decay 80000

Training has three parts: a short rise of the rate, a long part at the highest rate, and a short fall to none.
OUT/stable.pt is the end of the second part, from which a later call with more ``--crops`` continues; each
call ends with a fall that starts from it and writes OUT/last.pt. So a finished net is available at any time,
and no training is lost. If stopped (Ctrl-C, kill), it continues from OUT/stable.pt, which is written every
few minutes.
"""

from __future__ import annotations

import copy
import json
import time
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
import typer
from close_ups import CloseUp, CloseUpMaker
from crops import CropBatch, CropSampler
from joint_losses import Truth, joint_loss
from joint_net import JointNet
from numpy.typing import NDArray
from optimise import arithmetic, follow
from sightings import Sightings
from torch import Tensor

from depth_pose.core.skeleton import JOINTS, MIRROR_JOINTS

_GROUPS = ("head", "neck", "chest", "pelvis", "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "foot")

_EMA, _EMA_FALLING, _WEIGHT_DECAY, _WARM_UP, _CLIP = 0.999, 0.995, 0.02, 400, 5.0
"""Decay of the averaged weights per step, the same while the rate falls, weight decay, steps in which the
rate rises, and largest norm of a gradient. Set by hand."""

_CHECK_SEED, _CHECKS = 900_001, 400
"""Seed and number of the validation close-ups; training seeds are small numbers."""

app = typer.Typer(add_completion=False)


class Stream:
    """Pool of close-ups that is renewed continuously; each is used a few times, augmented, then dropped.

    Parameters
    ----------
    seed : tuple of int
    room : int
        Number of close-ups kept.
    fresh : float
        New close-ups for each one used.
    anny : float
        Share of people with a body of Anny.
    """

    def __init__(self, seed: tuple[int, ...], room: int, fresh: float, anny: float) -> None:
        self._rng = np.random.default_rng(seed)
        self._maker, self._room, self._fresh = CloseUpMaker(anny=anny), room, fresh
        self._kept: list[CloseUp] = []
        self._due, self._next = 0.0, 0
        while len(self._kept) < min(room, 500):
            self._kept += self._maker.make(self._rng)

    def next(self, size: int) -> list[CloseUp]:
        """Return some close-ups, drawn at random from the pool."""
        self._due += size * self._fresh
        while self._due >= 1.0:
            for one in self._maker.make(self._rng):
                self._due -= 1.0
                if len(self._kept) < self._room:
                    self._kept.append(one)
                else:
                    self._kept[self._next] = one
                    self._next = (self._next + 1) % self._room
        return [self._kept[k] for k in self._rng.integers(len(self._kept), size=size)]


@app.command()
def train(
    out: Annotated[Path, typer.Argument(help="Folder for checkpoints and log.jsonl")],
    crops: Annotated[int, typer.Option(help="Crops to train on at the highest rate")] = 1_000_000,
    decay: Annotated[int, typer.Option(help="Crops of the fall of the rate at the end; 0 for none")] = 80_000,
    batch: Annotated[int, typer.Option(help="Crops per step")] = 32,
    rate: Annotated[float, typer.Option(help="Highest learning rate")] = 1.5e-3,
    fresh: Annotated[float, typer.Option(help="New close-ups for each crop")] = 0.3,
    keep: Annotated[int, typer.Option(help="Close-ups that are kept (30 kB each)")] = 16_000,
    sightings: Annotated[Path | None, typer.Option(help="File from find_sightings.py")] = None,
    found: Annotated[int, typer.Option(help="Number of a step's crops that are sightings")] = 10,
    anny: Annotated[float, typer.Option(help="Share of close-ups with a body of Anny (extra 'anny')")] = 0.0,
    keep_belief: Annotated[
        Path | None, typer.Option(help="Weights whose belief sightings teach, not whether they are people")
    ] = None,
    seed: Annotated[int, typer.Option(help="Start of all random numbers")] = 1,
    start: Annotated[Path | None, typer.Option(help="Weights to start from where OUT has none")] = None,
    coarse: Annotated[Path | None, typer.Option(help="The coarse net (ONNX), where neither is given")] = None,
    save_every: Annotated[int, typer.Option(help="Crops between checkpoints")] = 20_000,
    threads: Annotated[int, typer.Option(help="Threads")] = 1,
    exact: Annotated[
        bool | None,
        typer.Option(help="Use 32 bits throughout; the default where the processor has no bfloat16"),
    ] = None,
) -> None:
    """Train, or continue training; writes OUT/stable.pt and OUT/last.pt."""
    torch.set_num_threads(threads)
    torch.manual_seed(seed)
    out.mkdir(parents=True, exist_ok=True)
    run = _Run(out, rate, exact, start, coarse)
    if keep_belief is not None:
        run.keep_belief(keep_belief)
    families = {"": 0.0, "anny_": 1.0} if anny > 0.0 else {"": 0.0}
    apart = {name: CropSampler().batch(_check_set(share), None) for name, share in families.items()}
    seen = Sightings.load(sightings) if sightings else None
    stream = Stream((seed, run.done), keep, fresh, anny)
    rng = np.random.default_rng([seed, run.done, 1])
    sampler = CropSampler()

    def next_batch() -> CropBatch:
        if seen is None:
            return sampler.batch(stream.next(batch), rng)
        return joined(
            [sampler.batch(stream.next(batch - found), rng), seen.batch(seen.draw(found, rng), rng)]
        )

    while run.done < crops:
        run.step(next_batch(), min(1.0, (run.steps + 1) / _WARM_UP), _EMA)
        if run.done % save_every < batch:
            run.save(out / "stable.pt", apart)
    run.save(out / "stable.pt", apart)
    first = run.done
    while run.done < first + decay:
        run.step(next_batch(), 1.0 - (run.done - first) / decay, _EMA_FALLING)
        if run.done % save_every < batch:
            run.save(out / "falling.pt", apart)
    run.save(out / "falling.pt", apart)
    torch.save(run.average.state_dict(), out / "last.pt")


class _Run:
    """State of training: a net, its optimiser and their progress."""

    def __init__(
        self, out: Path, rate: float, exact: bool | None, start: Path | None, coarse: Path | None
    ) -> None:
        self.net = JointNet()
        if start is not None:
            self.net.load_state_dict(torch.load(start, weights_only=True))
        elif coarse is not None:
            self.net.coarse.load_onnx(coarse)
        elif not (out / "stable.pt").exists():
            raise typer.BadParameter("a new net needs --coarse or --start")
        self.net = self.net.to(memory_format=torch.channels_last)
        self.average = copy.deepcopy(self.net).eval()
        learned = [p for p in self.net.parameters() if p.requires_grad]
        self.optimiser = torch.optim.AdamW(learned, rate, weight_decay=_WEIGHT_DECAY, fused=True)
        self.rate, self.exact, self.steps, self.done = rate, exact, 0, 0
        self._believing: JointNet | None = None
        self._mean: dict[str, float] = {}
        self._log, self._began = out / "log.jsonl", time.perf_counter()
        if (out / "stable.pt").exists():
            kept = torch.load(out / "stable.pt", weights_only=True)
            self.net.load_state_dict(kept["net"])
            self.average.load_state_dict(kept["average"])
            self.optimiser.load_state_dict(kept["optimiser"])
            self.steps, self.done = kept["steps"], kept["done"]

    def keep_belief(self, weights: Path) -> None:
        """Teach from now on what a net of these weights believes to be a person."""
        self._believing = copy.deepcopy(self.net).eval()
        self._believing.load_state_dict(torch.load(weights, weights_only=True))

    def step(self, crops: CropBatch, share: float, keep: float) -> None:
        """Train on a batch at a share of the highest rate; ``keep`` is the decay of the averaged weights."""
        for group in self.optimiser.param_groups:
            group["lr"] = share * self.rate
        with arithmetic(self.exact):
            answer = self.net.vote(to_input(crops))
        truth = Truth(*map(torch.from_numpy, (crops.joints, crops.side, crops.person, crops.mask)))
        if self._believing is not None:
            asked = truth.person.isfinite()
            with arithmetic(self.exact), torch.no_grad():
                truth.person[asked] = torch.sigmoid(self._believing(to_input(crops)[asked])[3])
        loss, parts = joint_loss(answer, self.net.cells[0, 0, :2].T, truth)
        self.optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.net.parameters(), _CLIP)
        self.optimiser.step()
        self.steps += 1
        self.done += len(crops.features)
        follow(self.average, self.net, min(keep, (1 + self.steps) / (10 + self.steps)))
        self._mean = {k: 0.99 * self._mean.get(k, v) + 0.01 * v for k, v in parts.items()}

    def save(self, path: Path, apart: dict[str, CropBatch]) -> None:
        """Write a checkpoint, and a line to the log."""
        part = path.with_suffix(".part")
        state: dict[str, Any] = {
            "net": self.net.state_dict(),
            "average": self.average.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "steps": self.steps,
            "done": self.done,
        }
        torch.save(state, part)
        part.replace(path)
        line = {
            "crops": self.done,
            "seconds": round(time.perf_counter() - self._began),
            **{k: round(v, 4) for k, v in self._mean.items()},
            **{f"{name}{k}": v for name, some in apart.items() for k, v in score(self.average, some).items()},
        }
        with self._log.open("a") as log:
            print(json.dumps(line), file=log)


def _check_set(anny: float) -> list[CloseUp]:
    rng, maker, out = np.random.default_rng(_CHECK_SEED), CloseUpMaker(2, anny), []
    while len(out) < _CHECKS:
        out += maker.make(rng)
    return out[:_CHECKS]


def joined(parts: list[CropBatch]) -> CropBatch:
    """Concatenate batches."""
    return CropBatch(
        *(np.concatenate([getattr(p, n) for p in parts]) for n in CropBatch.__dataclass_fields__)
    )


def to_input(crops: CropBatch) -> Tensor:
    """Return a batch's features as a tensor."""
    return torch.from_numpy(crops.features).contiguous(memory_format=torch.channels_last)


def score(net: JointNet, crops: CropBatch) -> dict[str, float]:
    """Compute mean errors (mm), shares within 10 cm and of correct facings, and the mask's overlap."""
    answers = []
    with torch.no_grad():
        for k in range(0, len(crops.features), 50):
            x = torch.from_numpy(crops.features[k : k + 50]).contiguous(memory_format=torch.channels_last)
            answers.append([o.numpy() for o in net(x)])
    joints, _, behind, _, mask = (np.concatenate(parts) for parts in zip(*answers, strict=True))
    named = np.linalg.norm(joints - crops.joints, axis=-1)
    swapped = np.linalg.norm(joints - crops.joints[:, MIRROR_JOINTS], axis=-1)
    other = (swapped.mean(1) < named.mean(1)) & (np.abs(crops.side) < 1)
    error = np.where(other[:, None], swapped, named)
    right = (behind > 0) == ((crops.side > 0) ^ other)
    said, own = (mask > 0) & (crops.mask < 2), crops.mask == 1
    kinds = {g: [n for n, name in enumerate(JOINTS) if name.endswith(g)] for g in _GROUPS}
    return {
        "all": round(1000 * float(error.mean()), 1),
        "within": round(float((error < 0.1).mean()), 4),
        "facing": round(float(right.mean()), 4),
        "overlap": round(float((said & own).sum() / (said | own).sum()), 4),
        **{g: round(1000 * float(error[:, k].mean()), 1) for g, k in kinds.items()},
    }


def in_order(values: NDArray[np.float32], is_person: NDArray[np.bool_]) -> float:
    """Area under the ROC curve."""
    from scipy.stats import rankdata

    rank = rankdata(values)
    n, m = int(is_person.sum()), int((~is_person).sum())
    return float((rank[is_person].sum() - n * (n + 1) / 2) / (n * m))


if __name__ == "__main__":
    app()
