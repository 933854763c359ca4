"""Write a checkpoint as the ONNX file that the run time reads, with what made it beside it."""

from __future__ import annotations

import hashlib
import json
import warnings
from pathlib import Path
from typing import Any

import torch
from net import FinderNet

from depth_pose.people._finder_kernels import CHANNELS, COLS, ROWS

_CODE = ("net.py", "losses.py", "scenes.py", "_sample_kernels.py", "train.py", "fit_verifier.py")
_FEATURES = "src/depth_pose/people/_finder_kernels.py"


def export_net(checkpoint: Path, target: Path) -> bytes:
    """Write a checkpoint as ONNX; its three outputs are ``mask``, ``torso``, ``joints``."""
    net = FinderNet()
    net.load_state_dict(torch.load(checkpoint, weights_only=True))
    net = net.eval().to(memory_format=torch.contiguous_format)
    target.parent.mkdir(parents=True, exist_ok=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            net,
            (torch.zeros(1, CHANNELS, ROWS, COLS),),
            str(target),
            input_names=["features"],
            output_names=["mask", "torso", "joints"],
            opset_version=17,
            dynamo=False,
        )
    return target.read_bytes()


def hash_code() -> str:
    """Hash the code that makes the weights."""
    here = Path(__file__).resolve().parent
    digest = hashlib.sha256()
    for path in [here / name for name in _CODE] + [here.parents[1] / _FEATURES]:
        digest.update(path.read_bytes())
    return digest.hexdigest()


def write_settings(target: Path, model: bytes, **values: Any) -> None:
    """Write what lies beside the net."""
    settings = {"weights_sha256": hashlib.sha256(model).hexdigest(), "code_sha256": hash_code(), **values}
    target.write_text(json.dumps(settings, indent=1) + "\n")
