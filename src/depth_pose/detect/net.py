"""Open a net: one thread, reproducible sums."""

from __future__ import annotations

import os
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from onnxruntime import InferenceSession


def open_net(model: bytes) -> InferenceSession:
    """Open a net (ONNX)."""
    # otherwise it sends telemetry, from a thread that forked processes lack
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.use_deterministic_compute = True
    options.log_severity_level = 3
    return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])


def read_weights(name: str, folder: Path | None = None) -> bytes:
    """Read a file of weights from a folder, or from the package."""
    return ((folder or resources.files("depth_pose.detect") / "weights") / name).read_bytes()
