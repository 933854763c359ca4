"""Learning a model from performances (Sec. 3, Sec. 5)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict

import numpy as np
from numpy.typing import NDArray

from depth_pose.errors import ConfigError
from depth_pose.volume.config import LearnConfig
from depth_pose.volume.descriptor import Bins, describe
from depth_pose.volume.gp import Regression, learn_regression
from depth_pose.volume.gpdm import learn_dynamics
from depth_pose.volume.model import VolumeModel
from depth_pose.volume.performances import Performance, headings_of, turns, without_headings
from depth_pose.volume.posespace import PoseSpace, learn_pose_space
from depth_pose.volume.reliability import learn_trust
from depth_pose.volume.space import learn_space

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]
"""Called with what is being done, how far, and of how many."""

DETAIL_BINS = Bins(8, 16, 3)
DETAIL_COMPONENTS = 40
COMPONENTS = 40
"""Dimensions of the descriptor space."""

_JITTER_STEPS = (-3, 0, 3)
"""Wrong headings, in steps of the fine azimuth, that the last regression learns to put right."""

_MOST_DETAIL_ROWS = 2400
_LATENT_WEIGHT = 2.0


def learn_model(
    wearers: Sequence[Sequence[Performance]],
    config: LearnConfig | None = None,
    progress: Progress | None = None,
    about: str = "",
) -> VolumeModel:
    """Learn a model from hulls.

    Parameters
    ----------
    wearers : sequence of sequences of Performance
        For each wearer the same performances, frame by frame with the same poses.
    config : LearnConfig
    progress : callable, optional
    about : str
        What the model is trained on, for people.
    """
    config = config or LearnConfig()
    tell = progress or (lambda what, done, of: None)
    first = wearers[0]
    _check(wearers)
    rotations = np.concatenate([without_headings(p.rotations) for p in first])
    lengths = [len(p) for p in first]
    bins = Bins()
    tell("descriptors", 0, 1)
    aligned = [_aligned(person, bins) for person in wearers]
    space = learn_space(aligned, min(COMPONENTS, len(rotations) - 1))
    parts = [space.split(v)[0] for v in aligned]
    volumes = np.mean(parts, axis=0)
    scale = float(volumes.std())
    found = learn_dynamics(
        [v / scale for v in parts], lengths, config, lambda n: tell("dynamics", n, config.iterations)
    )
    tell("regressions", 0, 4)
    to_volume = learn_regression(found.latent, volumes)
    to_latent = learn_regression(volumes, found.latent)
    offsets = np.mean([_offsets(person) for person in wearers], axis=0)
    pose_space = learn_pose_space(rotations, offsets, config.pose_variance)
    poses = pose_space.encode(rotations, offsets)
    to_pose = learn_regression(found.latent, poses)
    tell("regressions", 2, 4)
    detail, mean, basis = _learn_detail(wearers, found.latent, rotations, pose_space)
    tell("regressions", 3, 4)
    trust = learn_trust([p for person in wearers for p in person])
    tell("regressions", 4, 4)
    return VolumeModel(
        latent=found.latent, lengths=np.array(lengths), volumes=volumes[None],
        spread=np.mean([((v - volumes) ** 2).sum(axis=1) for v in parts], axis=0)[None], poses=poses,
        space_mean=space.mean, space_whiten=space.whiten, space_basis=space.basis,
        pose_mean=pose_space.mean, pose_basis=pose_space.basis,
        volume_kernel=to_volume.kernel.as_array(), motion_kernel=found.motion_kernel.as_array(),
        recall_kernel=to_latent.kernel.as_array(), pose_kernel=to_pose.kernel.as_array(),
        detail_inputs=detail.inputs, detail_poses=detail.outputs, detail_kernel=detail.kernel.as_array(),
        detail_mean=mean, detail_basis=basis, trust=trust,
        meta={
            "bins": list(asdict(bins).values()), "detail_bins": list(asdict(DETAIL_BINS).values()),
            "fps": first[0].fps, "noise_floor": config.noise_floor, "input": "silhouettes",
            "about": about, "performances": [p.name for p in first], "frames": int(sum(lengths)),
            "wearers": len(wearers), "statures": [round(w[0].stature, 3) for w in wearers],
            "learning": asdict(config),
        },
    )  # fmt: skip


def _check(wearers: Sequence[Sequence[Performance]]) -> None:
    first = wearers[0]
    for person in wearers:
        if [len(p) for p in person] != [len(p) for p in first] or any(
            not np.allclose(a.rotations, b.rotations) for a, b in zip(person, first, strict=True)
        ):
            raise ConfigError("every wearer must perform the same motions, frame by frame")
        for p in person:
            empty = sum(v.is_empty for v in p.volumes)
            if empty:
                raise ConfigError(f"the performance {p.name} has {empty} frames without a volume")


def _steps(performance: Performance, bins: Bins) -> Array:
    return headings_of(performance.rotations) / (2 * np.pi) * bins.fine


def _aligned(person: Sequence[Performance], bins: Bins) -> Array:
    """Descriptors (N, D) seen from where the pelvis faces."""
    rows = []
    for p in person:
        for volume, step in zip(p.volumes, _steps(p, bins), strict=True):
            rows.append(at_heading(describe(volume, p.stature, bins), step))
    return np.array(rows)


def at_heading(descriptors: Array, step: float) -> Array:
    """Descriptor (D,) for a heading between the steps of (fine, D) descriptors."""
    low = int(np.floor(step))
    share, n = step - low, len(descriptors)
    mixed: Array = (1.0 - share) * descriptors[low % n] + share * descriptors[(low + 1) % n]
    return mixed


def _offsets(person: Sequence[Performance]) -> Array:
    """Pelvis relative to the volume's axis (x, z) and the floor (y), facing +z, in statures, (N, 3)."""
    rows = []
    for p in person:
        centres = np.array([v.centroid for v in p.volumes])
        centres[:, 1] = 0.0
        back = np.swapaxes(turns(headings_of(p.rotations)), -1, -2)
        rows.append((back @ (p.pelvis - centres)[..., None])[..., 0] / p.stature)
    return np.concatenate(rows)


def _learn_detail(
    wearers: Sequence[Sequence[Performance]], latent: Array, rotations: Array, pose_space: PoseSpace
) -> tuple[Regression, Array, Array]:
    """Regression from latent points and finer descriptors, under slightly wrong headings, to poses."""
    fine, targets, points = [], [], []
    total = len(latent) * len(wearers) * len(_JITTER_STEPS)
    keep = max(1, int(np.ceil(total / _MOST_DETAIL_ROWS)))
    row = 0
    for person in wearers:
        at = 0
        offsets = _offsets(person)
        for p in person:
            for i, (volume, step) in enumerate(zip(p.volumes, _steps(p, DETAIL_BINS), strict=True)):
                for jitter in _JITTER_STEPS:
                    row += 1
                    if row % keep:
                        continue
                    back = turns(-jitter * 2 * np.pi / DETAIL_BINS.fine)
                    fine.append(at_heading(describe(volume, p.stature, DETAIL_BINS), step + jitter))
                    targets.append((back @ rotations[at + i], back @ offsets[at + i]))
                    points.append(latent[at + i])
            at += len(p)
    values = np.array(fine)
    mean = values.mean(axis=0)
    _, _, vt = np.linalg.svd(values - mean, full_matrices=False)
    basis = np.ascontiguousarray(vt[:DETAIL_COMPONENTS].T)
    inputs = detail_inputs(np.array(points), values, mean, basis)
    poses = pose_space.encode(np.array([r for r, _ in targets]), np.array([o for _, o in targets]))
    some = np.random.default_rng(0).permutation(len(inputs))[:500]
    kernel = learn_regression(inputs[some], poses[some]).kernel
    return Regression(inputs, poses, kernel), mean, basis


def detail_inputs(latent: Array, fine: Array, mean: Array, basis: Array) -> Array:
    """Inputs of the last regression: latent points (N, d) beside components of the finer descriptor."""
    scaled = (fine - mean) @ basis * 10.0
    return np.concatenate([_LATENT_WEIGHT * latent, scaled], axis=1)
