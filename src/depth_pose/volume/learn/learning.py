"""Learning a model from performances (Sec. 3, Sec. 5)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import ConfigError
from depth_pose.volume.config import LearnConfig
from depth_pose.volume.descriptor import Bins, describe
from depth_pose.volume.gp import Kernel, learn_regression
from depth_pose.volume.gpdm import learn_dynamics
from depth_pose.volume.headings import headings_of, turns, without_headings
from depth_pose.volume.learn.performances import Performance
from depth_pose.volume.learn.reliability import learn_trust
from depth_pose.volume.model import VolumeModel
from depth_pose.volume.posespace import PoseSpace, learn_pose_space
from depth_pose.volume.space import learn_space
from depth_pose.volume.tuning import LearnTuning

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]
"""Function called with the task, the number done, and the total."""

COMPONENTS = 40
"""Dimensions of the descriptor space; chosen like those of `depth_pose.volume.tuning`."""


def learn_model(
    views: Sequence[Sequence[Sequence[Performance]]],
    config: LearnConfig | None = None,
    progress: Progress | None = None,
    about: str = "",
    tuning: LearnTuning = LearnTuning(),
) -> VolumeModel:
    """Learn a model.

    Parameters
    ----------
    views : sequence of sequences of sequences of Performance
        By view and wearer: the same performances, with the same poses in each frame. Hulls have one view; a
        depth camera has one for each of several evenly spaced directions, the front first.
    config : LearnConfig
    progress : callable, optional
    about : str
        Description of the training data.
    tuning : LearnTuning

    Raises
    ------
    ConfigError
        Where the performances do not match, or have fewer frames than latent dimensions.
    """
    config = config or LearnConfig()
    tell = progress or (lambda what, done, of: None)
    everybody = [person for wearers in views for person in wearers]
    first = everybody[0]
    _check(everybody, config.latent)
    bins = Bins()
    tell("descriptors", 0, 1)
    aligned = [[_aligned(person, bins) for person in wearers] for wearers in views]
    space = learn_space(aligned, min(COMPONENTS, sum(len(p) for p in first) - 1))
    split = [[space.split(v) for v in wearers] for wearers in aligned]
    volumes = np.array([np.mean([v for v, _ in wearers], axis=0) for wearers in split])
    spread = np.mean(
        [np.mean([((v - mean) ** 2).sum(axis=1) + rest for v, rest in wearers], axis=0)
         for wearers, mean in zip(split, volumes, strict=True)], axis=0,
    )  # fmt: skip
    tell("descriptors", 1, 1)
    centred = [v - v.mean(axis=0) for wearers in split for v, _ in wearers]
    scale = float(np.std(centred))
    found = learn_dynamics(
        [v / scale for v in centred],
        [len(p) for p in first],
        config,
        lambda n: tell("dynamics", n, config.iterations),
        tuning,
    )
    tell("regressions", 0, 3)
    to_volume = learn_regression(found.latent, np.concatenate(list(volumes), axis=1))
    to_latent = learn_regression(volumes[0], found.latent)
    rotations = np.concatenate([without_headings(p.rotations) for p in first])
    tell("regressions", 1, 3)
    poses, pose_space, pose_kernel = _learn_poses(views, found.latent, rotations, tuning.pose_variance)
    tell("regressions", 2, 3)
    trust = learn_trust([p for wearers in views[::4] for person in wearers for p in person])
    tell("regressions", 3, 3)
    return VolumeModel(
        latent=found.latent, lengths=np.array([len(p) for p in first]), volumes=volumes, spread=spread,
        poses=poses, rotations=rotations,
        space_mean=space.mean, space_whiten=space.whiten, space_basis=space.basis,
        pose_mean=pose_space.mean, pose_basis=pose_space.basis,
        volume_kernel=to_volume.kernel.as_array(), motion_kernel=found.motion_kernel.as_array(),
        recall_kernel=to_latent.kernel.as_array(), pose_kernel=pose_kernel.as_array(),
        trust=trust,
        meta={
            "bins": list(asdict(bins).values()), "fps": first[0].fps, "noise_floor": tuning.noise_floor,
            "input": "depth" if len(first[0].volumes[0].eyes) else "silhouettes",
            "about": about, "performances": [p.name for p in first], "frames": len(rotations),
            "wearers": len(views[0]), "statures": [round(w[0].stature, 3) for w in views[0]],
            "learning": asdict(config) | tuning._asdict(),
        },
    )  # fmt: skip


def _learn_poses(
    views: Sequence[Sequence[Sequence[Performance]]], latent: Array, rotations: Array, variance: float
) -> tuple[Array, PoseSpace, Kernel]:
    """Pose components (views, N, k), their space, and the kernel from latent points.

    The rotations are the same in all views; the position of the pelvis relative to the centroid is not.
    """
    offsets = [np.mean([_offsets(person) for person in wearers], axis=0) for wearers in views]
    space = learn_pose_space(np.concatenate([rotations] * len(views)), np.concatenate(offsets), variance)
    poses = np.array([space.encode(rotations, o) for o in offsets])
    return poses, space, learn_regression(latent, np.concatenate(list(poses), axis=1)).kernel


def _check(everybody: Sequence[Sequence[Performance]], latent: int) -> None:
    first = everybody[0]
    frames = sum(len(p) for p in first)
    if frames <= latent:
        raise ConfigError(f"{frames} frames are too few for {latent} latent dimensions: give more, or fewer")
    for person in everybody:
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
    """Descriptors (N, D) for the heading of the pelvis."""
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
