"""Convert the joint net's weights (ONNX, floats or integers) to a checkpoint for training to continue from.

    python tools/people_finder/warm_start_joints.py src/depth_pose/detect/weights/joint_finder.onnx start.pt

As `warm_start`: norms get the statistics of their inputs, here in simulated close-ups. Weights that were
stored as integers keep their rounding; training removes it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import onnx
import torch
import typer
from close_ups import CloseUp, CloseUpMaker
from crops import CropSampler
from joint_net import JointNet, layer_of
from onnx_weights import float_weights
from warm_start import norm_after, unfold

_CLOSE_UPS, _SEED = 400, 21
"""Number and seed of the close-ups for computing means and variances."""


def load_folded(net: JointNet, path: Path) -> None:
    """Copy the layers of an exported net; norms only add their shifts."""
    model = onnx.load(path)
    values = float_weights(model)
    layers, norms = dict(net.named_modules()), norm_after(net)
    with torch.no_grad():
        for node in model.graph.node:
            name = layer_of(node.name)
            if node.op_type not in ("Conv", "Gemm"):
                continue
            layer = layers[name]
            shifted = norms.get(layer)
            layer.weight.copy_(torch.from_numpy(values[node.input[1]].copy()))
            (layer if shifted is None else shifted).bias.copy_(torch.from_numpy(values[node.input[2]].copy()))
            if shifted is not None:
                shifted.running_var.fill_(1.0 - shifted.eps)
        for name in ("trust", "doubt"):
            getattr(net, name).copy_(torch.from_numpy(values[name].copy()))


def main(
    weights: Annotated[Path, typer.Argument(help="The joint net (.onnx)")],
    out: Annotated[Path, typer.Argument(help="Checkpoint to write (.pt)")],
) -> None:
    """Write the checkpoint."""
    net = JointNet().eval()
    load_folded(net, weights)
    rng, maker, seen = np.random.default_rng(_SEED), CloseUpMaker(2), list[CloseUp]()
    while len(seen) < _CLOSE_UPS:
        seen += maker.make(rng)
    features = CropSampler().batch(seen, rng).features
    with torch.no_grad():
        before = net(torch.from_numpy(features[:8]))[0]
        unfold(net, features)
        after = net(torch.from_numpy(features[:8]))[0]
    print(f"largest difference of a joint: {1000 * float((before - after).abs().max()):.1e} mm")
    out.parent.mkdir(parents=True, exist_ok=True)
    torch.save(net.state_dict(), out)


if __name__ == "__main__":
    typer.run(main)
