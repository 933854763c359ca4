"""Errors of the tracker on performances, with baselines."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.volume.config import VolumeConfig
from depth_pose.volume.headings import headings_of, turns
from depth_pose.volume.learn.performances import Performance
from depth_pose.volume.model import VolumeModel
from depth_pose.volume.pipeline import VolumePose, VolumePoseTracker
from depth_pose.volume.scoring import Score, best_training_estimate, mean_pose_estimate, score

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Report:
    """Errors on one performance.

    Attributes
    ----------
    name : str
    mean_pose : Score
        Score of the mean training pose in every frame, under the true heading.
    best_training : Score
        Score of the training pose nearest to the truth, under the true heading.
    regressed : Score
        Score of the pose regressed from the latent point.
    fitted : Score
        Score after the fit to the volume.
    stature_m : float
        Estimated stature.
    true_stature_m : float
    root_cm : float
        Mean position error of the pelvis.
    ms : float
        Median processor time from volume to pose, once the stature is fixed.
    poses : tuple of VolumePose
    """

    name: str
    mean_pose: Score
    best_training: Score
    regressed: Score
    fitted: Score
    stature_m: float
    true_stature_m: float
    root_cm: float
    ms: float
    poses: tuple[VolumePose, ...]


def track_performance(
    model: VolumeModel,
    performance: Performance,
    config: VolumeConfig | None = None,
    progress: Callable[[int], None] | None = None,
) -> Report:
    """Track a performance with known poses."""
    tracker = VolumePoseTracker(model, config)
    tracker.warm_up()
    poses: list[VolumePose] = []
    times = []
    for i, volume in enumerate(performance.volumes):
        start = time.thread_time()
        poses.append(tracker.process(volume, 1 + round(i * 1e9 / performance.fps)))
        times.append(1e3 * (time.thread_time() - start))
        if progress is not None:
            progress(i + 1)
    truth = performance.rotations
    headings = turns(headings_of(truth))
    found = [p for p in poses if not p.skeleton.is_lost]
    roots = np.array([p.skeleton.positions[0] for p in found])
    where = performance.pelvis[[not p.skeleton.is_lost for p in poses]]
    return Report(
        name=performance.name,
        mean_pose=score(mean_pose_estimate(model.rotations, headings), truth),
        best_training=score(best_training_estimate(model.rotations, truth, headings), truth),
        regressed=score(np.array([p.regressed for p in poses]), truth),
        fitted=score(np.array([p.rotations for p in poses]), truth),
        stature_m=found[-1].stature if found else float("nan"),
        true_stature_m=performance.stature,
        root_cm=float(100 * np.linalg.norm(roots - where, axis=1).mean()) if len(found) else float("nan"),
        ms=float(np.median(times[len(times) // 2 :])),
        poses=tuple(poses),
    )


def report_rows(reports: Sequence[Report]) -> list[list[str]]:
    """Make a table: a heading, a row for each performance, and their mean."""
    head = [
        "performance", "mean pose", "best training pose", "regressed", "fitted", "fitted / best",
        "fitted, paper's RMS", "joints", "stature",
    ]  # fmt: skip
    rows = [head, *(_row(r.name, [r], f"{r.stature_m:.2f} m of {r.true_stature_m:.2f}") for r in reports)]
    return rows if len(reports) == 1 else [*rows, _row("mean", reports, "")]


def _row(name: str, reports: Sequence[Report], stature: str) -> list[str]:
    kinds = ("mean_pose", "best_training", "regressed", "fitted")
    angles = [float(np.mean([getattr(r, kind).angle_deg for r in reports])) for kind in kinds]
    rms = np.mean([r.fitted.rms_deg for r in reports])
    joints = np.mean([r.fitted.joint_cm for r in reports])
    ratio = f"{angles[3] / angles[1]:.2f}"
    return [name, *(f"{a:.2f}°" for a in angles), ratio, f"{rms:.2f}°", f"{joints:.1f} cm", stature]
