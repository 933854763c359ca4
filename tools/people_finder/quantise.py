"""Turn most convolutions of the nets into 8-bit integers: half the time, and half the space.

    python tools/people_finder/quantise.py build/people_finder/weights src/depth_pose/detect/weights

Values between the layers get 8 bits, over their range in simulated rooms; weights get 7, with a scale for
each channel: with 8, the sums of processors without VNNI could overflow. So all processors compute the same.
Rectifiers are included, so that a convolution before one uses its 8 bits for the values that the rectifier
keeps: half the error, and one step less.
The first layers, which read metres, and those that output metres stay in floats (`_KEPT`); docs/method.md
gives the effect.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np
import onnx
import typer
from numpy.typing import NDArray
from onnx_weights import double_by_copies, free_sides, halve, move_integers, widen
from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static
from onnxruntime.quantization.shape_inference import quant_pre_process
from rich.progress import track

from depth_pose.core.config import SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.detect.learned_segmenter import LearnedSegmenter
from depth_pose.detect.tuning import DetectTuning
from depth_pose.sim.clips import sample_clip

_KEPT = {
    "people_finder": ("/stem/stem.0/stem.0.0/Conv", "/torso/Conv", "/mask/Conv"),
    "joint_finder": (
        "/coarse/stem/stem.0/stem.0.0/Conv",
        "/coarse/stem/stem.1/stem.1.0/Conv",
        "/coarse/down4/down4.0/down4.0.0/Conv",
        "/coarse/votes/votes.1/Conv",
        "/votes/Conv",
        "/mask/Conv",
    ),
}
"""Convolutions that stay in 32 bits; the fine net alone has none of the coarse ones. With the coarse net's
last in 8 as well its joints move by 25 mm (median), with its first three by 9 instead of 6."""

_SEED, _FRAMES, _EVERY, _MOST = 77, 12, 4, 100
"""Seed of the rooms, frames of each, every n-th of which is used, and number of inputs to find a range."""

Features = dict[str, NDArray[np.float32]]
"""Inputs of a net, by their names."""


class _Watched:
    """A net whose inputs are recorded."""

    def __init__(self, session: Any) -> None:
        self._session, self.inputs = session, list[Features]()

    def run(self, outputs: list[str] | None, inputs: Features) -> list[NDArray[Any]]:
        """Run the net and record its inputs."""
        self.inputs.append({name: v.copy() for name, v in inputs.items()})
        return self._session.run(outputs, inputs)


class _Inputs(CalibrationDataReader):
    """Recorded inputs, one at a time, as ONNX Runtime's quantiser reads them."""

    def __init__(self, inputs: Iterable[Features]) -> None:
        self._inputs = iter(inputs)

    def get_next(self) -> Features | None:
        """Return the next input; None after the last."""
        return next(self._inputs, None)


def watch(weights: Path, rooms: int) -> dict[str, list[Features]]:
    """Record the inputs of both nets in simulated rooms, by the net's name."""
    segmenter = LearnedSegmenter(SegmentConfig(), weights, DetectTuning(find_every=1))
    finder, joints = segmenter.candidates.finder, segmenter.joint_net
    finder._session, joints.session = _Watched(finder._session), _Watched(joints.session)
    for k in track(range(rooms), "rooms"):
        clip = sample_clip(np.random.default_rng([_SEED, k]), frames=_FRAMES, people=1 + k % 3)
        segmenter.reset()
        for stamp, depth in list(zip(clip.stamps_ns, clip.depth, strict=True))[::_EVERY]:
            segmenter.segment(DepthFrame(int(stamp), "", depth, clip.camera))
    return {"people_finder": finder._session.inputs, "joint_finder": joints.session.inputs}


def quantise(source: Path, target: Path, inputs: list[Features]) -> None:
    """Write a net whose convolutions, except those of `_KEPT`, use integers."""
    model = onnx.load(source)
    has_coarse = any(n.name.startswith("/coarse/") for n in model.graph.node)
    kept = [name for name in _KEPT[source.stem] if has_coarse or not name.startswith("/coarse/")]
    with TemporaryDirectory() as folder:
        wide, ready = Path(folder) / "wide.onnx", Path(folder) / "ready.onnx"
        if missing := set(kept) - {n.name for n in model.graph.node}:
            raise typer.BadParameter(f"{source} has no layer {', '.join(sorted(missing))}")
        widen(model)
        onnx.save(model, wide)
        quant_pre_process(str(wide), str(ready), skip_symbolic_shape=True)
        quantize_static(
            str(ready),
            str(target),
            _Inputs(inputs),
            quant_format=QuantFormat.QDQ,
            op_types_to_quantize=["Conv", "Relu"],
            nodes_to_exclude=kept,
            per_channel=True,
            reduce_range=True,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
        )
    halve(target)


def main(
    weights: Annotated[Path, typer.Argument(help="Folder of both nets, as make_weights.py trained them")],
    out: Annotated[Path, typer.Argument(help="Folder for both nets as integers, and their settings")],
    rooms: Annotated[int, typer.Option(help="Number of simulated rooms for finding the ranges", min=1)] = 40,
    only: Annotated[str | None, typer.Option(help="One of the nets; the other one is copied")] = None,
) -> None:
    """Write both nets as integers."""
    out.mkdir(parents=True, exist_ok=True)
    for name, inputs in watch(weights, rooms).items():
        if only not in (None, name):
            for kind in ("onnx", "json"):
                shutil.copyfile(weights / f"{name}.{kind}", out / f"{name}.{kind}")
            continue
        settings = json.loads((weights / f"{name}.json").read_text())
        quantise(weights / f"{name}.onnx", out / f"{name}.onnx", inputs[:_MOST])
        if name == "people_finder":  # wide views have a larger image
            free_sides(out / f"{name}.onnx")
        move_integers(out / f"{name}.onnx")
        double_by_copies(out / f"{name}.onnx")
        digest = hashlib.sha256((out / f"{name}.onnx").read_bytes()).hexdigest()
        settings = {"weights_sha256": digest, "trained_sha256": settings["weights_sha256"]} | {
            key: value for key, value in settings.items() if key != "weights_sha256"
        }
        (out / f"{name}.json").write_text(json.dumps(settings, indent=1) + "\n")


if __name__ == "__main__":
    typer.run(main)
