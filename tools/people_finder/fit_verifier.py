"""Fit the verifier to the clusters that a net finds in scenes it was not trained on, and write the weights.

python tools/people_finder/fit_verifier.py runs/a/last.pt scenes/val src/depth_pose/people/weights
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
import typer
from export import export_net, write_settings
from numpy.typing import NDArray
from rich.progress import track
from scenes import Scenes, list_shards, load_scenes

from depth_pose.core.camera import Camera
from depth_pose.core.types import DepthFrame
from depth_pose.people.finder import PeopleFinder, reduce_frame

_LEAST_SHARE = 0.5
_MOST_PEOPLE = 6
_HIDDEN = 24
_STEPS, _RATE, _DECAY = 1500, 1e-2, 3e-3

app = typer.Typer(add_completion=False)


@dataclass(frozen=True)
class Examples:
    """Clusters: ``measures`` (N, MEASURES), and whether each is a ``person`` (N,)."""

    measures: NDArray[np.float64]
    person: NDArray[np.bool_]


def frame_of(scenes: Scenes, k: int) -> DepthFrame:
    """Give one scene as a frame of its camera."""
    width, height = (int(n) for n in scenes.size[k])
    depth = scenes.depth[k, :height, :width].astype(np.float32) / np.float32(1000)
    return DepthFrame(0, "", depth, Camera(width, height, *(float(v) for v in scenes.camera[k])))


def truth_on_grid(scenes: Scenes, k: int, stride: float, shape: tuple[int, int]) -> NDArray[np.uint8]:
    """Give the persons of one scene on the net's grid."""
    rows = np.minimum(((np.arange(shape[0]) + 0.5) * stride).astype(int), scenes.size[k, 1] - 1)
    cols = np.minimum(((np.arange(shape[1]) + 0.5) * stride).astype(int), scenes.size[k, 0] - 1)
    return scenes.person[k][np.ix_(rows, cols)]


def collect(finder: PeopleFinder, scenes: Scenes) -> Examples:
    """Run the net over scenes.

    A cluster is a person if half of its pixels are one's, and none has more of theirs.
    """
    measures, person = [], []
    for k in track(range(len(scenes)), "clusters"):
        image = reduce_frame(frame_of(scenes, k))
        _, found = finder.cluster(image)
        truth = truth_on_grid(scenes, k, image.stride, found.labels.shape)
        shown = np.zeros((len(found.torsos) + 1, _MOST_PEOPLE + 1), np.int64)
        np.add.at(shown, (found.labels, truth), 1)
        shown = shown[1:]
        owner = shown[:, 1:].argmax(axis=1)
        for p in np.flatnonzero(shown.sum(axis=1)):
            theirs = shown[p, 1 + owner[p]]
            rival = shown[owner == owner[p], 1 + owner[p]].max()
            measures.append(found.measures[p])
            person.append(theirs >= _LEAST_SHARE * shown[p].sum() and theirs == rival)
    return Examples(np.array(measures), np.array(person))


def fit(examples: Examples, seed: int) -> dict[str, Any]:
    """Fit one hidden layer by cross entropy; returns the lists that `Verifier.from_mapping` reads."""
    torch.manual_seed(seed)
    mean, scale = examples.measures.mean(0), examples.measures.std(0) + 1e-3
    x = torch.tensor(np.clip((examples.measures - mean) / scale, -5, 5), dtype=torch.float32)
    y = torch.tensor(examples.person, dtype=torch.float32)
    net = torch.nn.Sequential(
        torch.nn.Linear(x.shape[1], _HIDDEN), torch.nn.ReLU(), torch.nn.Linear(_HIDDEN, 1)
    )
    optimiser = torch.optim.AdamW(net.parameters(), _RATE, weight_decay=_DECAY)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, _STEPS)
    for _ in range(_STEPS):
        chosen = torch.randint(len(x), (1024,))
        noisy = x[chosen] + 0.1 * torch.randn(len(chosen), x.shape[1])
        loss = torch.nn.functional.binary_cross_entropy_with_logits(net(noisy)[:, 0], y[chosen])
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
    first, last = net[0], net[2]
    return {
        "mean": mean.tolist(),
        "scale": scale.tolist(),
        "hidden": first.weight.detach().double().T.tolist(),
        "hidden_bias": first.bias.detach().double().tolist(),
        "out": last.weight.detach().double()[0].tolist(),
        "out_bias": float(last.bias.detach()[0]),
    }


@app.command()
def main(
    checkpoint: Annotated[Path, typer.Argument(help="Weights of the net (.pt)")],
    scenes: Annotated[Path, typer.Argument(help="Folder of shards that the net was not trained on")],
    out: Annotated[Path, typer.Argument(help="Folder for people_finder.onnx and .json")],
    most: Annotated[int, typer.Option(help="Scenes to use")] = 2500,
    seed: Annotated[int, typer.Option(help="Start of all random numbers")] = 0,
    note: Annotated[str, typer.Option(help="How the net was trained, for the record")] = "",
) -> None:
    """Fit the verifier and write what ships."""
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
