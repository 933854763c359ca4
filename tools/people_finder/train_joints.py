r"""Train the joint net on people simulated during training.

    git show fe355e5:src/depth_pose/people/weights/joint_finder.onnx > coarse.onnx
    python tools/people_finder/train_joints.py runs/joints --coarse coarse.onnx --crops 1000000 --decay 80000

Training has three parts: a short rise of the rate, a long part at the highest rate, and a short fall to none.
OUT/stable.pt is the end of the second part, from which a later call with more ``--crops`` continues; each
call ends with a fall that starts from it and writes OUT/last.pt. So a finished net is available at any time,
and no training is lost. If stopped (Ctrl-C, kill), it continues from OUT/stable.pt, which is written every
few minutes.

A graphics card trains faster than processors draw crops, of which a core draws 200 to 300 in a second. So
``--workers`` draws in processes of their own, and where no batch is ready, an earlier one is changed
(`change`) and used again:

    python tools/people_finder/train_joints.py runs/joints --start start.pt --teacher start.pt \
        --sightings sightings.npz --anny 0.4 --crops 820000 --decay 1910000 --batch 256 --found 32 \
        --fresh 0.2 --device cuda --workers 15

with ``OMP_NUM_THREADS=1``, or each of these processes starts a thread for each core.
"""

from __future__ import annotations

import copy
import json
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import fields
from datetime import datetime
from pathlib import Path
from queue import Empty, Queue
from typing import Annotated, Any, NamedTuple

import numpy as np
import torch
import typer
from close_ups import CloseUp, CloseUpMaker
from crop_changes import change
from crops import CropBatch, CropSampler
from joint_losses import Truth, joint_loss, keep_loss
from joint_net import Answer, JointNet, heels_of_ankles
from numpy.typing import NDArray
from optimise import arithmetic, follow
from sightings import Sightings
from torch import Tensor
from torch.utils.data import DataLoader, IterableDataset, get_worker_info

from depth_pose.core.skeleton import LANDMARKS, MIRROR_LANDMARKS

_GROUPS = (
    "head",
    "neck",
    "chest",
    "pelvis",
    "shoulder",
    "elbow",
    "wrist",
    "hip",
    "knee",
    "ankle",
    "foot",
    "heel",
)

_EMA, _EMA_FALLING, _WEIGHT_DECAY, _WARM_UP, _CLIP = 0.999, 0.995, 0.02, 400, 5.0
"""Decay of the averaged weights per step, the same while the rate falls, weight decay, steps in which the
rate rises, and largest norm of a gradient. Set by hand."""

_AHEAD, _KEPT, _LEAST_KEPT = 6, 250, 8
"""Batches on the device that are waiting, those kept for using them again, and how many that needs."""

_KEPT_WEIGHT = 1.0
"""Weight of a teacher's answers beside the truth. Set by hand."""

_BEFORE_GRAPH = 4
"""Steps before one is recorded as a graph."""

_CHECK_SEED, _CHECKS = 900_001, 200
"""Seed and number of the validation close-ups; training seeds are small numbers."""

_FIRST = 250
"""Close-ups of a pool before the first step."""

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
    maker : CloseUpMaker
    """

    def __init__(self, seed: tuple[int, ...], room: int, fresh: float, maker: CloseUpMaker) -> None:
        self._rng = np.random.default_rng(seed)
        self._maker, self._room, self._fresh = maker, room, fresh
        self._kept: list[CloseUp] = []
        self._due = 0.0
        while len(self._kept) < min(room, _FIRST):
            self._kept += self._maker.make(self._rng)

    def next(self, size: int) -> list[CloseUp]:
        """Return some close-ups, drawn at random from the pool, none of them twice if it has enough.

        New ones take the place of some of these, so that each is used before it is dropped.
        """
        drawn = self._rng.choice(len(self._kept), size, replace=len(self._kept) < size)
        out = [self._kept[k] for k in drawn]
        self._due += size * self._fresh
        new: list[CloseUp] = []
        while self._due >= 1.0:
            made = self._maker.make(self._rng)
            self._due -= len(made)
            new += made
        free = max(self._room - len(self._kept), 0)
        self._kept += new[:free]
        for k, one in zip(drawn, new[free:], strict=False):
            self._kept[k] = one
        return out


class Counts(NamedTuple):
    """Crops of a batch: close-ups in rooms, then those at home, then sightings."""

    rooms: int
    homes: int
    found: int


class Batches(IterableDataset[list[Tensor]]):
    """Batches of crops without end, drawn in each worker by itself; their order differs with the seed.

    Parameters
    ----------
    seed : tuple of int
    counts : Counts
    sightings : Path or None
    room, fresh
        As `Stream`; ``room`` is shared by all workers.
    anny, views, stereo
        As `CloseUpMaker`.
    """

    def __init__(
        self,
        seed: tuple[int, ...],
        counts: Counts,
        sightings: Path | None,
        room: int,
        fresh: float,
        anny: float,
        views: int,
        stereo: float,
    ) -> None:
        self._seed, self._counts, self._sightings = seed, counts, sightings
        self._room, self._fresh = room, fresh
        self._makers = [(n, CloseUpMaker(views, anny, homes, stereo)) for homes, n in enumerate(counts[:2])]

    def __iter__(self) -> Iterator[list[Tensor]]:
        worker = get_worker_info()
        number, count = (worker.id, worker.num_workers) if worker else (0, 1)
        seed = (*self._seed, number)
        seen = Sightings.load(self._sightings) if self._sightings else None
        room = self._room // (2 * count)
        streams = [
            (n, Stream((*seed, 2 + k), room, self._fresh, maker))
            for k, (n, maker) in enumerate(self._makers)
            if n
        ]
        rng, sampler = np.random.default_rng([*seed, 1]), CropSampler()
        while True:
            crops = [sampler.batch(stream.next(n), rng) for n, stream in streams]
            if seen is not None:
                crops.append(seen.batch(seen.draw(self._counts.found, rng), rng))
            yield to_tensors(joined(crops))


def on_device(
    drawn: Batches, workers: int, device: str, changed: float, rng: np.random.Generator
) -> Iterator[list[Tensor]]:
    """Yield batches on a device as they are drawn, some of them changed (`change`).

    Where workers draw too slowly for a graphics card, earlier batches are changed and used again.
    """
    loader = iter(DataLoader(drawn, None, num_workers=workers, pin_memory=device != "cpu"))
    if device == "cpu":
        for batch in loader:
            yield change(batch) if rng.random() < changed else batch
    ready, kept = Queue[list[Tensor]](_AHEAD), list[list[Tensor]]()

    def fetch() -> None:
        for batch in loader:
            ready.put([part.to(device, non_blocking=True) for part in batch])

    threading.Thread(target=fetch, daemon=True).start()
    while True:
        try:
            batch = ready.get(block=len(kept) < _LEAST_KEPT)
        except Empty:
            yield change(kept[int(rng.integers(len(kept)))])
            continue
        if len(kept) == _KEPT:
            kept[int(rng.integers(_KEPT))] = batch
        else:
            kept.append(batch)
        yield batch


@app.command()
def train(
    out: Annotated[Path, typer.Argument(help="Folder for checkpoints and log.jsonl")],
    crops: Annotated[int, typer.Option(help="Crops to train on at the highest rate")] = 1_000_000,
    decay: Annotated[int, typer.Option(help="Crops of the fall of the rate at the end; 0 for none")] = 80_000,
    batch: Annotated[int, typer.Option(help="Crops per step")] = 32,
    rate: Annotated[float, typer.Option(help="Highest learning rate")] = 1.5e-3,
    fresh: Annotated[float, typer.Option(help="New close-ups for each crop")] = 0.3,
    keep: Annotated[int, typer.Option(help="Close-ups that are kept (100 kB each)")] = 16_000,
    sightings: Annotated[Path | None, typer.Option(help="File from find_sightings.py")] = None,
    found: Annotated[int, typer.Option(help="Number of a step's crops that are sightings")] = 10,
    anny: Annotated[float, typer.Option(help="Share of close-ups with a body of Anny (extra 'anny')")] = 0.0,
    views: Annotated[int, typer.Option(help="Cameras that look at each person")] = 4,
    changed: Annotated[
        float, typer.Option(help="Share of batches that are stretched and covered, on processors")
    ] = 0.0,
    homes: Annotated[float, typer.Option(help="Share of close-ups that are at home")] = 0.5,
    stereo: Annotated[float, typer.Option(help="Share of sensors at home that are stereo cameras")] = 0.5,
    teacher: Annotated[
        Path | None,
        typer.Option(
            help="Weights whose answers close-ups in rooms teach beside the truth; their belief is what "
            "sightings teach"
        ),
    ] = None,
    until: Annotated[
        datetime | None,
        typer.Option(
            help="When the fall of the rate has to end, if CROPS and DECAY take longer",
            formats=["%Y-%m-%dT%H:%M"],
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Start of all random numbers")] = 1,
    start: Annotated[Path | None, typer.Option(help="Weights to start from where OUT has none")] = None,
    coarse: Annotated[Path | None, typer.Option(help="The coarse net (ONNX), where neither is given")] = None,
    coarse_rate: Annotated[
        float, typer.Option(help="Learning rate of the coarse net as a share; 0: it stays as it is")
    ] = 0.3,
    only_heels: Annotated[
        bool, typer.Option(help="Train the layer of the heels, which START may lack; all else stays as it is")
    ] = False,
    save_every: Annotated[int, typer.Option(help="Crops between checkpoints")] = 20_000,
    threads: Annotated[int, typer.Option(help="Threads")] = 1,
    workers: Annotated[int, typer.Option(help="Processes that draw crops; 0: this one does")] = 0,
    device: Annotated[str, typer.Option(help="Where the net is trained: cpu or cuda")] = "cpu",
    fused: Annotated[
        bool,
        typer.Option(help="Compile the net (needs a C++ compiler): a third less time on processors"),
    ] = False,
    exact: Annotated[
        bool | None,
        typer.Option(help="Use 32 bits throughout; the default where the processor has no bfloat16"),
    ] = None,
) -> None:
    """Train, or continue training; writes OUT/stable.pt and OUT/last.pt."""
    torch.set_num_threads(threads)
    torch.manual_seed(seed)
    out.mkdir(parents=True, exist_ok=True)
    run = Run(out, rate, device, exact, start, coarse, coarse_rate, only_heels, fused)
    found = found if sightings else 0
    at_home = round(homes * (batch - found))
    counts = Counts(batch - found - at_home, at_home, found)
    if teacher is not None:
        run.follow_teacher(teacher, counts, fused)
    makers = {"": CloseUpMaker(2, homes=0.0), "home_": CloseUpMaker(2, homes=1.0, stereo=1.0)}
    if anny > 0.0:
        makers["anny_"] = CloseUpMaker(2, 1.0, homes=0.0)
    apart = {name: CropSampler().batch(_check_set(maker), None) for name, maker in makers.items()}
    drawn = Batches((seed, run.done), counts, sightings, keep, fresh, anny, views, stereo)
    batches = on_device(drawn, workers, device, changed, np.random.default_rng([seed, run.done, 2]))
    while run.done < crops:
        run.step(next(batches), min(1.0, (run.steps + 1) / _WARM_UP), _EMA)
        if run.done % save_every < batch or run.done >= crops:
            run.save(out / "stable.pt", apart)
    first, began = run.done, time.time()
    seconds = np.inf if until is None else until.timestamp() - began
    while (left := 1.0 - max((run.done - first) / max(decay, 1), (time.time() - began) / seconds)) > 0.0:
        run.step(next(batches), left, _EMA_FALLING)
        if run.done % save_every < batch:
            run.save(out / "falling.pt", apart)
    run.save(out / "falling.pt", apart)
    torch.save(run.average.cpu().state_dict(), out / "last.pt")


class Run:
    """State of training: a net, its optimiser and their progress; parameters as the options of `train`."""

    def __init__(
        self,
        out: Path,
        rate: float,
        device: str,
        exact: bool | None,
        start: Path | None,
        coarse: Path | None,
        coarse_rate: float,
        only_heels: bool,
        fused: bool,
    ) -> None:
        self.net = JointNet()
        if start is not None:
            given = torch.load(start, weights_only=True)
            self.net.load_state_dict((heels_of_ankles(given) if only_heels else {}) | given)
        elif coarse is not None:
            self.net.coarse.load_onnx(coarse)
        elif not (out / "stable.pt").exists():
            raise typer.BadParameter("a new net needs --coarse or --start")
        self.net = self.net.to(device, memory_format=torch.channels_last)
        self.net.coarse.requires_grad_(coarse_rate > 0.0)
        if only_heels:
            self.net.eval().requires_grad_(False).heels.requires_grad_(True)
        self.average = copy.deepcopy(self.net).eval()
        learned = [(name, p) for name, p in self.net.named_parameters() if p.requires_grad]
        groups = [
            {"params": [p for name, p in learned if name.startswith("coarse.") == is_coarse], "share": share}
            for is_coarse, share in ((False, 1.0), (True, coarse_rate))
        ]
        groups = [group | {"lr": torch.zeros((), device=device)} for group in groups if group["params"]]
        self.optimiser = torch.optim.AdamW(
            groups,
            torch.zeros((), device=device),
            weight_decay=_WEIGHT_DECAY,
            fused=True,
            capturable=device != "cpu",
        )
        self.rate, self.device, self.exact, self.steps, self.done = rate, device, exact, 0, 0
        self._vote = torch.compile(self.net.vote) if fused else self.net.vote
        self._taught: Callable[[Tensor], Answer] | None = None
        self._counts = Counts(0, 0, 0)
        self._inputs: list[Tensor] = []
        self._parts: dict[str, Tensor] = {}
        self._mean: dict[str, Tensor] = {}
        self._graph: torch.cuda.CUDAGraph | None = None
        self._log, self._began = out / "log.jsonl", time.perf_counter()
        if (out / "stable.pt").exists():
            kept = torch.load(out / "stable.pt", weights_only=True, map_location=device)
            self.net.load_state_dict(kept["net"])
            self.average.load_state_dict(kept["average"])
            self.optimiser.load_state_dict(kept["optimiser"])
            self.steps, self.done = kept["steps"], kept["done"]

    def follow_teacher(self, weights: Path, counts: Counts, fused: bool) -> None:
        """Teach from now on, by close-ups in rooms and sightings, what a net of these weights answers."""
        net = copy.deepcopy(self.net).eval().requires_grad_(False)
        net.load_state_dict(torch.load(weights, weights_only=True))
        self._taught, self._counts = torch.compile(net.vote) if fused else net.vote, counts

    def step(self, crops: list[Tensor], share: float, keep: float) -> None:
        """Train on a batch at a share of the highest rate; ``keep`` is the decay of the averaged weights."""
        for group in self.optimiser.param_groups:
            group["lr"].fill_(share * self.rate * group["share"])
        if not self._inputs:
            form = {"dtype": torch.float32, "memory_format": torch.channels_last}
            self._inputs = [torch.empty_like(crops[0], **form), *map(torch.empty_like, crops[1:])]
        for own, part in zip(self._inputs, crops, strict=True):
            own.copy_(part)
        if self.device == "cpu":
            self._update()
        else:
            self._graph = self._graph or self._record()
            self._graph.replay()
        self.steps += 1
        self.done += len(crops[0])
        follow(self.average, self.net, min(keep, (1 + self.steps) / (10 + self.steps)))
        self._mean = {k: 0.99 * self._mean.get(k, v) + 0.01 * v for k, v in self._parts.items()}

    def _update(self) -> None:
        """Take a step on the batch in ``_inputs``."""
        x, *targets = self._inputs
        truth, exact = Truth(*targets), self.exact
        with arithmetic(exact, self.device):
            answer = self._vote(x)
        kept: Tensor | None = None
        if self._taught is not None:
            rooms, at_home, _ = self._counts
            with arithmetic(exact, self.device), torch.no_grad():
                taught = self._taught(torch.cat([x[:rooms], x[rooms + at_home :]]))
            believed = torch.sigmoid(taught.person[rooms:])
            truth = truth._replace(person=torch.cat([truth.person[: rooms + at_home], believed]))
            kept = keep_loss(Answer(*(part[:rooms] for part in answer)), Answer(*(t[:rooms] for t in taught)))
        loss, self._parts = joint_loss(answer, self.net.cells[0, 0, :2].T, truth)
        if kept is not None:
            loss = loss + _KEPT_WEIGHT * self._counts.rooms / len(x) * kept
            self._parts["kept"] = kept.detach()
        self.optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.net.parameters(), _CLIP)
        self.optimiser.step()

    def _record(self) -> torch.cuda.CUDAGraph:
        """Record a step as a graph: started one by one, its thousand kernels take four times as long."""
        beside = torch.cuda.Stream()
        beside.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(beside):
            for _ in range(_BEFORE_GRAPH):
                self._update()
        torch.cuda.current_stream().wait_stream(beside)
        self.optimiser.zero_grad()
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph):
            self._update()
        return graph

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
            **{k: round(v.item(), 4) for k, v in self._mean.items()},
            **{f"{name}{k}": v for name, some in apart.items() for k, v in score(self.average, some).items()},
        }
        with self._log.open("a") as log:
            print(json.dumps(line), file=log)


def _check_set(maker: CloseUpMaker) -> list[CloseUp]:
    rng, out = np.random.default_rng(_CHECK_SEED), list[CloseUp]()
    while len(out) < _CHECKS:
        out += maker.make(rng)
    return out[:_CHECKS]


def joined(parts: list[CropBatch]) -> CropBatch:
    """Concatenate batches."""
    return CropBatch(
        *(np.concatenate([getattr(p, n) for p in parts]) for n in CropBatch.__dataclass_fields__)
    )


def to_tensors(crops: CropBatch) -> list[Tensor]:
    """Return a batch as tensors: features, in 16 bits, and the parts of its truth."""
    features, *targets = (torch.from_numpy(getattr(crops, f.name)) for f in fields(crops))
    return [features.half(), *targets]


def score(net: JointNet, crops: CropBatch) -> dict[str, float]:
    """Compute mean errors (mm), shares within 10 cm and of correct facings, and the mask's overlap."""
    features = torch.from_numpy(crops.features).contiguous(memory_format=torch.channels_last)
    with torch.no_grad():
        some = features.to(net.cells.device).split(50)
        answers = [[part.cpu().numpy() for part in net(x)] for x in some]
    landmarks, _, behind, _, mask = (np.concatenate(parts) for parts in zip(*answers, strict=True))
    named = np.linalg.norm(landmarks - crops.landmarks, axis=-1)
    swapped = np.linalg.norm(landmarks - crops.landmarks[:, MIRROR_LANDMARKS], axis=-1)
    other = (swapped.mean(1) < named.mean(1)) & (np.abs(crops.side) < 1)
    error = np.where(other[:, None], swapped, named)
    right = (behind > 0) == ((crops.side > 0) ^ other)
    said, own = (mask > 0) & (crops.mask < 2), crops.mask == 1
    kinds = {g: [n for n, name in enumerate(LANDMARKS) if name.endswith(g)] for g in _GROUPS}
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
