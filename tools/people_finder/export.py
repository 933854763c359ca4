"""Write a checkpoint as the ONNX file that the run time reads, with its provenance beside it."""

from __future__ import annotations

import hashlib
import json
import warnings
from pathlib import Path
from typing import Any

import torch
from joint_net import SIDE, FineNet, JointNet
from net import FinderNet
from onnx_weights import free_window, halve
from onnxruntime.quantization.shape_inference import quant_pre_process
from torch import Tensor, nn

from depth_pose.detect import _crop_kernels as crop_kernels
from depth_pose.detect._finder_kernels import CHANNELS, COLS, ROWS

_CODE = (
    "net.py",
    "losses.py",
    "scenes.py",
    "_sample_kernels.py",
    "train.py",
    "optimise.py",
    "replicas.py",
    "fit_verifier.py",
)
_FEATURES = "src/depth_pose/detect/_finder_kernels.py"

JOINT_CODE = (
    "net.py",
    "joint_net.py",
    "joint_losses.py",
    "scenes.py",
    "close_ups.py",
    "crops.py",
    "_crop_spoil_kernels.py",
    "crop_changes.py",
    "find_sightings.py",
    "sightings.py",
    "train_joints.py",
    "export_joints.py",
    "optimise.py",
    "replicas.py",
)
JOINT_FEATURES = "src/depth_pose/detect/_crop_kernels.py"


def export_net(checkpoint: Path, target: Path) -> bytes:
    """Write a checkpoint as ONNX: ``mask`` and ``torso``, packed; votes for joints only serve training."""
    net = _Seen(_load(FinderNet(), checkpoint))
    return _export(net, target, {"features": (CHANNELS, ROWS, COLS)}, ["mask", "torso"])


class _Seen(nn.Module):
    """The outputs of the finder's net that the run time uses."""

    def __init__(self, net: FinderNet) -> None:
        super().__init__()
        self.net = net

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Return mask logits and torso votes, packed by four pixels: the run time unpacks them faster."""
        mask, torso, _ = self.net.packed(x)
        return mask, torso


def export_joint_net(net: FineNet, checkpoint: Path, target: Path) -> bytes:
    """Write a checkpoint of the joint net as ONNX, with the names of `joint_net.Answer`.

    The fine net alone lacks the input of the coarse one. Its part sees any window of the crop.
    """
    sides = {"features": SIDE} | ({"middle": len(net.middle)} if isinstance(net, JointNet) else {})
    inputs = {name: (crop_kernels.CHANNELS, side, side) for name, side in sides.items()}
    outputs = ["landmarks", "log_error", "behind", "person", "mask"]
    _export(_load(net, checkpoint), target, inputs, outputs)
    quant_pre_process(str(target), str(target), skip_symbolic_shape=True)  # sizes become constants
    free_window(target)
    halve(target)
    return target.read_bytes()


def _load(net: nn.Module, checkpoint: Path) -> nn.Module:
    net.load_state_dict(torch.load(checkpoint, weights_only=True))
    return net


def _export(
    net: nn.Module, target: Path, inputs: dict[str, tuple[int, int, int]], outputs: list[str]
) -> bytes:
    net = net.eval().to(memory_format=torch.contiguous_format)
    target.parent.mkdir(parents=True, exist_ok=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            net,
            tuple(torch.zeros(1, *shape) for shape in inputs.values()),
            str(target),
            input_names=list(inputs),
            output_names=outputs,
            opset_version=17,
            dynamo=False,
        )
    halve(target)
    return target.read_bytes()


def hash_code(names: tuple[str, ...] = _CODE, features: str = _FEATURES) -> str:
    """Hash the code that makes the weights."""
    here = Path(__file__).resolve().parent
    digest = hashlib.sha256()
    for path in [here / name for name in names] + [here.parents[1] / features]:
        digest.update(path.read_bytes())
    return digest.hexdigest()


def write_settings(target: Path, model: bytes, code: str | None = None, **values: Any) -> None:
    """Write the settings beside the net; ``code`` is the hash of its sources, by default the finder's."""
    settings = {
        "weights_sha256": hashlib.sha256(model).hexdigest(),
        "code_sha256": code or hash_code(),
        **values,
    }
    target.write_text(json.dumps(settings, indent=1) + "\n")
