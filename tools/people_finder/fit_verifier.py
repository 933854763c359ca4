"""Fit the verifier to the clusters that a net finds in scenes it was not trained on, and write the weights.

python tools/people_finder/fit_verifier.py runs/a/last.pt scenes/val src/depth_pose/detect/weights
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
import typer
from numpy.typing import NDArray
from rich.progress import track
from scenes import Scenes, list_shards, load_scenes
from torch import Tensor

from depth_pose.core.camera import Camera
from depth_pose.core.frame import DepthFrame
from depth_pose.detect.finder import PeopleFinder
from depth_pose.detect.turned import reduce_frame
from depth_pose.sim.scenes import MOST_PEOPLE
from export import export_net, write_settings

_LEAST_SHARE = 0.5
"""A cluster belongs to a person if at least this share of its pixels is theirs. Set by hand."""
_CUT_EVERY = 3
"""Every n-th scene is also shown with nothing but its people. Set by hand."""
_NETS, _HIDDEN = 8, 12
"""Networks whose answers are averaged, and the hidden units of each. Set by hand."""
_STEPS, _RATE, _DECAY, _NOISE = 500, 1e-2, 1e-2, 0.2
"""Each network's training; the noise is added to measures of unit deviation. Set by hand."""

app = typer.Typer(add_completion=False)


@dataclass(frozen=True)
class Examples:
    """Clusters: ``measures`` (N, MEASURES), and whether each is a ``person`` (N,)."""

    measures: NDArray[np.float64]
    person: NDArray[np.bool_]


def frame_of(scenes: Scenes, k: int) -> DepthFrame:
    """Convert one scene to a frame of its camera."""
    width, height = (int(n) for n in scenes.size[k])
    depth = scenes.depth[k, :height, :width].astype(np.float32) / np.float32(1000)
    return DepthFrame(0, "", depth, Camera(width, height, *(float(v) for v in scenes.camera[k])))


def truth_on_grid(person: NDArray[np.uint8], stride: float, shape: tuple[int, int]) -> NDArray[np.uint8]:
    """Sample the person labels of a frame on a grid."""
    rows = np.minimum(((np.arange(shape[0]) + 0.5) * stride).astype(int), person.shape[0] - 1)
    cols = np.minimum(((np.arange(shape[1]) + 0.5) * stride).astype(int), person.shape[1] - 1)
    return person[np.ix_(rows, cols)]


def collect(finder: PeopleFinder, scenes: Scenes) -> Examples:
    """Run the net over scenes and collect its clusters.

    A cluster is a person if half of its pixels are one person's, and no other cluster has more of them.
    """
    measures, person = [], []
    for k in track(range(len(scenes)), "clusters"):
        frame = frame_of(scenes, k)
        empty = scenes.background[k].astype(np.float32) / np.float32(1000) if k % 2 else None
        for look in looks(frame, scenes.person[k], empty, cut=k % _CUT_EVERY == 0):
            image = reduce_frame(look.frame)
            behind = None if look.empty is None else reduce_frame(look.empty).depth
            _, found = finder.cluster(image, behind)
            truth = truth_on_grid(look.person, image.stride, found.labels.shape)
            _, is_person = whose(found.labels, truth, len(found.torsos))
            measures += list(found.measures[is_person >= 0])
            person += list(is_person[is_person >= 0])
    return Examples(np.array(measures), np.array(person, bool))


@dataclass(frozen=True)
class Look:
    """A frame, its person labels, and the room without people where it is known."""

    frame: DepthFrame
    person: NDArray[np.uint8]
    empty: DepthFrame | None = None


def looks(
    frame: DepthFrame, person: NDArray[np.uint8], empty: NDArray[np.float32] | None, cut: bool
) -> Iterator[Look]:
    """Yield a frame, its mirror image with the room where it is known, and with ``cut`` only its people."""
    camera = frame.camera
    person = person[: camera.height, : camera.width]
    yield Look(frame, person)
    mirrored = camera._replace(cx=camera.width - 1 - camera.cx)
    room = None
    if empty is not None:
        room = DepthFrame(
            0, "", np.ascontiguousarray(empty[: camera.height, : camera.width][:, ::-1]), mirrored
        )
    flipped = DepthFrame(0, "", np.ascontiguousarray(frame.depth[:, ::-1]), mirrored)
    yield Look(flipped, person[:, ::-1], room)
    if cut and person.any():
        yield Look(DepthFrame(0, "", np.where(person > 0, frame.depth, np.float32(0)), camera), person)


def whose(
    labels: NDArray[np.uint8], truth: NDArray[np.uint8], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return for each cluster its person, from 0, and whether it is a person (1) or not (0).

    The second is -1 for a cluster without a pixel.
    """
    shown = np.zeros((count + 1, MOST_PEOPLE + 1), np.int64)
    np.add.at(shown, (labels, truth), 1)
    shown = shown[1:]
    owner = shown[:, 1:].argmax(axis=1)
    theirs = shown[np.arange(count), 1 + owner]
    most = np.array([shown[owner == k, 1 + k].max() for k in owner], np.int64).reshape(count)
    pixels = shown.sum(axis=1)
    answer = ((theirs >= _LEAST_SHARE * pixels) & (theirs == most)).astype(np.int64)
    return owner, np.where(pixels > 0, answer, -1)


def fit(examples: Examples, seed: int) -> dict[str, Any]:
    """Fit small networks by cross entropy and stack them side by side, which averages their outputs.

    Returns the lists that `Verifier.from_mapping` reads.
    """
    mean, scale = examples.measures.mean(0), examples.measures.std(0) + 1e-3
    x = torch.tensor(np.clip((examples.measures - mean) / scale, -5, 5), dtype=torch.float32)
    y = torch.tensor(examples.person, dtype=torch.float32)
    nets = [fit_one(x, y, seed + k) for k in range(_NETS)]
    return {
        "mean": mean.tolist(),
        "scale": scale.tolist(),
        "hidden": torch.cat([n[0].weight for n in nets]).detach().double().T.tolist(),
        "hidden_bias": torch.cat([n[0].bias for n in nets]).detach().double().tolist(),
        "out": (torch.cat([n[2].weight[0] for n in nets]) / _NETS).detach().double().tolist(),
        "out_bias": float(sum(float(n[2].bias.detach()[0]) for n in nets) / _NETS),
    }


def fit_one(x: Tensor, y: Tensor, seed: int) -> torch.nn.Sequential:
    """Fit one network to examples drawn with replacement."""
    torch.manual_seed(seed)
    drawn = torch.randint(len(x), (len(x),))
    x, y = x[drawn], y[drawn]
    net = torch.nn.Sequential(
        torch.nn.Linear(x.shape[1], _HIDDEN), torch.nn.ReLU(), torch.nn.Linear(_HIDDEN, 1)
    )
    optimiser = torch.optim.AdamW(net.parameters(), _RATE, weight_decay=_DECAY)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, _STEPS)
    for _ in range(_STEPS):
        chosen = torch.randint(len(x), (512,))
        noisy = x[chosen] + _NOISE * torch.randn(len(chosen), x.shape[1])
        loss = torch.nn.functional.binary_cross_entropy_with_logits(net(noisy)[:, 0], y[chosen])
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
    return net


@app.command()
def main(
    checkpoint: Annotated[Path, typer.Argument(help="Weights of the net (.pt)")],
    scenes: Annotated[Path, typer.Argument(help="Folder of shards that the net was not trained on")],
    out: Annotated[Path, typer.Argument(help="Folder for people_finder.onnx and .json")],
    most: Annotated[int, typer.Option(help="Scenes to use")] = 2500,
    seed: Annotated[int, typer.Option(help="Start of all random numbers")] = 0,
    note: Annotated[str, typer.Option(help="How the net was trained, for the record")] = "",
) -> None:
    """Fit the verifier and write the files that are released."""
    torch.set_num_threads(1)
    model = export_net(checkpoint, out / "people_finder.onnx")
    loaded = load_scenes(list_shards(scenes))
    which = np.random.default_rng(seed).permutation(len(loaded))[:most]
    chosen = Scenes(*(getattr(loaded, n)[which] for n in Scenes.__dataclass_fields__))
    examples = collect(PeopleFinder(model=model, settings={}), chosen)
    verifier = fit(examples, seed)
    persons = int(examples.person.sum())
    print(f"{len(chosen)} scenes, {persons} clusters are persons, {len(examples.person) - persons} are not")
    write_settings(
        out / "people_finder.json", model, training=note, seed=seed, scenes=len(chosen), verifier=verifier
    )


if __name__ == "__main__":
    app()
