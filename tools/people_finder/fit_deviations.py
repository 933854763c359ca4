"""Calibrate the joint net's deviations, and its windows, on simulated people in furnished rooms.

    python tools/people_finder/fit_deviations.py src/depth_pose/detect/weights

The factor on all deviations of a look is `depth_pose.detect.joint_calibration.DeviationScale`, fitted by
quantile regression (Koenker & Bassett 1978, *Regression quantiles*), in the plane and in depth, so that as
many errors lie within one deviation as of the net's own distributions: .70 and .76.

In a window of a crop the net's logit of a person is smaller, because means are taken over more of the person.
The median difference is added, measured on people who would be seen in a window next.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer
from numpy.typing import NDArray
from rich.progress import track
from scipy.optimize import minimize
from scipy.special import expit

from depth_pose.core.config import SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.core.measurement import JointMeasurement
from depth_pose.detect.crop import Crop
from depth_pose.detect.joint_calibration import DeviationScale, crop_measures
from depth_pose.detect.joint_net import VotingNet
from depth_pose.detect.joint_net_schedule import is_measured_well
from depth_pose.detect.learned_segmenter import LearnedSegmenter
from depth_pose.sim.clips import sample_clip
from depth_pose.sim.scene_noise import FAMILIES

UNFITTED = {"weights": [[0.0] * 10] * 2, "least": [0.0] * 3, "most": [1.0] * 3}
"""A `DeviationScale` with factors of 1, until this is run."""

_FRAMES, _FPS = 8, 6.0
"""Frames of each room, and frames a second."""
_SHARES = (0.70, 0.76)
"""Shares of the net's distributions within one deviation, in the plane and in depth."""
_NEAR_M, _SHOWN = 0.4, 0.3
"""Mean distance of proposals beyond which they are not a person's, and least visible share of a person."""
_LEAST, _SMOOTH = 1e-6, 0.02
"""Added to errors before their logarithm, and half-width of the loss's rounded corner. Set by hand."""
_EDGES = (0.02, 0.98)
"""Quantiles of the measures beyond which they are clipped. Set by hand."""


class Looks(NamedTuple):
    """Looks at simulated people.

    Attributes
    ----------
    measures : (N, M)
        From `crop_measures`.
    errors : (N, J, 2)
        Errors of joints in the plane (root mean square of both directions) and in depth, in deviations.
    lost : (W,)
        Logits of a person in whole crops less those in their windows.
    """

    measures: NDArray[np.float64]
    errors: NDArray[np.float64]
    lost: NDArray[np.float64]


class _Watched(VotingNet):
    """The joint net, whose answers and measures are recorded."""

    def __init__(self, weights: Path) -> None:
        super().__init__(weights)
        unfitted = DeviationScale(*map(np.array, UNFITTED.values()))
        self.calibration = self.calibration._replace(deviations=unfitted)
        self.seen = list[tuple[NDArray[np.float64], JointMeasurement]]()
        self.lost = list[float]()

    def look(self, crop: Crop) -> JointMeasurement:
        """Measure joints, and record them."""
        out = super().look(crop)
        sample = self.sampler.sample(crop)
        self.seen.append((crop_measures(sample, crop.label), out))
        if is_measured_well(out):
            around = out.places.astype(np.float64)
            crops = (crop._replace(expected=expected) for expected in (None, around))
            whole, window = (self._ask(sample, seen).person for seen in crops)
            self.lost.append(whole - window)
        return out


def collect(weights: Path, rooms: int, seed: int) -> Looks:
    """Look at one or two people in each of some rooms, of which each family of sensors sees a third."""
    measures, errors = [], []
    segmenter = LearnedSegmenter(SegmentConfig(), weights)
    segmenter.joint_net = watched = _Watched(weights)
    for k in track(range(rooms), "rooms"):
        rng = np.random.default_rng([seed, k])
        clip = sample_clip(rng, _FRAMES, _FPS, people=1 + k % 2, sensor=FAMILIES[k % len(FAMILIES)])
        segmenter.reset()
        for t in range(_FRAMES):
            watched.seen.clear()
            segmenter.segment(DepthFrame(int(clip.stamps_ns[t]), "", clip.depth[t], clip.camera))
            truth = clip.joints[t][clip.visible[t] > _SHOWN].astype(float)
            for measured, seen in watched.seen:
                gaps = np.linalg.norm(truth - seen.places, axis=-1).mean(axis=-1)
                if len(gaps) and gaps.min() < _NEAR_M:
                    measures.append(measured)
                    errors.append(in_deviations(seen, truth[gaps.argmin()]))
    return Looks(np.array(measures), np.array(errors), np.array(watched.lost))


def in_deviations(seen: JointMeasurement, truth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the errors (19, 2) of joints across and along their rays, in deviations."""
    off, ray = seen.places - truth, seen.places / np.linalg.norm(seen.places, axis=1, keepdims=True)
    deep = (off * ray).sum(axis=1)
    across = np.linalg.norm(off - deep[:, None] * ray, axis=1) / np.sqrt(2.0)
    return np.column_stack([across, np.abs(deep)]) / seen.sigma


def fit(looks: Looks) -> DeviationScale:
    """Fit the factors by quantile regression of the errors' logarithms."""
    least, most = np.quantile(looks.measures, _EDGES, axis=0)
    terms = DeviationScale(np.zeros((2, 1)), least, most).terms(looks.measures)
    weights = [
        quantile_regression(np.repeat(terms, off.shape[1], axis=0), np.log(off.ravel() + _LEAST), share)
        for off, share in zip(np.moveaxis(looks.errors, 2, 0), _SHARES, strict=True)
    ]
    return DeviationScale(np.array(weights), least, most)


def quantile_regression(x: NDArray[np.float64], y: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """Return weights (K,) with which ``share`` of ``y`` (N,) lies below ``x @ weights``, x (N, K)."""

    def loss(weights: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        rest = y - x @ weights
        value = share * rest + _SMOOTH * np.logaddexp(0.0, -rest / _SMOOTH)
        return float(value.mean()), x.T @ (expit(-rest / _SMOOTH) - share) / len(y)

    return minimize(loss, np.linalg.lstsq(x, y, rcond=None)[0], jac=True).x


def main(
    weights: Annotated[Path, typer.Argument(help="Folder of both nets, as they are released")],
    rooms: Annotated[int, typer.Option(help="Rooms with one or two people", min=1)] = 480,
    seed: Annotated[int, typer.Option(help="Start of all random numbers")] = 71,
) -> None:
    """Write the factors, and the odds in windows, to WEIGHTS/joint_finder.json."""
    looks = collect(weights, rooms, seed)
    scale = fit(looks)
    path = weights / "joint_finder.json"
    settings = json.loads(path.read_text())
    settings["deviations"] = {name: v.round(4).tolist() for name, v in scale._asdict().items()}
    first, second, bias = settings["person"]
    lost = float(np.median(looks.lost)) if len(looks.lost) else 0.0
    settings["person_in_window"] = [first, second, round(bias + second * lost, 2)]
    path.write_text(json.dumps(settings, indent=1) + "\n")
    print(f"windows of {len(looks.lost)} looks: {lost:.2f} less of a person's logit")
    factors = scale.factors(looks.measures)
    before, now = (looks.errors < 1.0), (looks.errors < factors[:, None])
    print(
        f"{len(factors)} looks; within one deviation, in the plane and in depth: "
        f"{before.mean(axis=(0, 1)).round(3)} before, {now.mean(axis=(0, 1)).round(3)} now"
    )


if __name__ == "__main__":
    typer.run(main)
