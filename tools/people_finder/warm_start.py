"""Convert the finder's weights (ONNX, floats or integers) to a checkpoint that training can continue from.

    python tools/people_finder/warm_start.py weights/people_finder.onnx scenes/train start.pt

An exported net has its batch norms folded into the convolutions. Here every norm gets the mean and the
variance of its inputs in scenes, and the scale and shift that undo them: the net computes the same as the
exported one, and trains as one that was never folded. Votes for joints are not exported and start at random.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import onnx
import torch
import typer
from joint_net import layer_of
from net import FinderNet
from numpy.typing import NDArray
from onnx_weights import float_weights
from scenes import Sampler, list_shards, load_scenes
from torch import Tensor, nn

_SCENES = 48
"""Number of scenes for computing means and variances."""


def load_folded(net: FinderNet, path: Path) -> None:
    """Copy the convolutions of an exported net; norms only add their shifts."""
    model = onnx.load(path)
    values = float_weights(model)
    layers, norms = dict(net.named_modules()), norm_after(net)
    for node in model.graph.node:
        if node.op_type != "Conv":
            continue
        layer, (weight, bias) = layers[layer_of(node.name)], (values[name] for name in node.input[1:])
        shifted = norms.get(layer)
        with torch.no_grad():
            layer.weight.zero_()  # features that the net did not know have no effect
            layer.weight[:, : weight.shape[1]] = torch.from_numpy(weight.copy())
            (layer if shifted is None else shifted).bias.copy_(torch.from_numpy(bias.copy()))
            if shifted is not None:
                shifted.running_var.fill_(1.0 - shifted.eps)


def norm_after(net: nn.Module) -> dict[nn.Module, nn.BatchNorm2d]:
    """Return the norm that follows each convolution."""
    pairs = [(m[0], m[1]) for m in net.modules() if isinstance(m, nn.Sequential) and len(m) >= 2]
    return {a: b for a, b in pairs if isinstance(a, nn.Conv2d) and isinstance(b, nn.BatchNorm2d)}


def unfold(net: nn.Module, features: NDArray[np.float32]) -> None:
    """Set the statistics of norms to those of their inputs, and scales and shifts that undo them."""

    def measure(norm: nn.BatchNorm2d, inputs: tuple[Tensor], _: Tensor) -> None:
        x = inputs[0]
        variance, mean = torch.var_mean(x, (0, 2, 3), correction=0)
        norm.running_mean.copy_(mean)
        norm.running_var.copy_(variance)
        norm.weight.copy_(torch.sqrt(variance + norm.eps))
        norm.bias.add_(mean)

    hooks = [norm.register_forward_hook(measure) for norm in norm_after(net).values()]
    with torch.no_grad():
        net.eval()(torch.from_numpy(features))
    for hook in hooks:
        hook.remove()


def main(
    weights: Annotated[Path, typer.Argument(help="The finder's net (.onnx)")],
    scenes: Annotated[Path, typer.Argument(help="Folder of shards from make_scenes.py")],
    out: Annotated[Path, typer.Argument(help="Checkpoint to write (.pt)")],
) -> None:
    """Write the checkpoint."""
    torch.manual_seed(0)
    net = FinderNet()
    load_folded(net, weights)
    sampler = Sampler(load_scenes(list_shards(scenes)[:1]))
    features = sampler.batch(np.arange(_SCENES), np.random.default_rng(0)).features
    with torch.no_grad():
        before = net.eval().packed(torch.from_numpy(features[:4]))[:2]
        unfold(net, features)
        after = net.packed(torch.from_numpy(features[:4]))[:2]
    off = max(float((a - b).abs().max()) for a, b in zip(before, after, strict=True))
    print(f"largest difference of an answer: {off:.1e}")
    out.parent.mkdir(parents=True, exist_ok=True)
    torch.save(net.state_dict(), out)


if __name__ == "__main__":
    typer.run(main)
