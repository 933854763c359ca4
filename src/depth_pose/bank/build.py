"""Build a bank: render every pose's partial views, learn the subspace, project (Sec. 5)."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import eigsh
from threadpoolctl import threadpool_limits

from depth_pose.bank.bank import Bank
from depth_pose.bank.bank_file import BANK_SCHEMES, round_quats
from depth_pose.bank.views import PoseViews, render_views
from depth_pose.body.body import Body
from depth_pose.core.errors import ConfigError
from depth_pose.core.options import Checked, option
from depth_pose.core.rotations import matrix_to_quat, quat_to_matrix
from depth_pose.core.workers import run_parts

Progress = Callable[[int, int], None]
"""Called with the number of poses done and their total."""

POSES_PER_PART = 50
"""Number of poses a worker renders at a time."""

_SAMPLE = 24_000
"""Descriptors from which the subspace is learned, evenly spread: all 160,000 would take 1.5 GB; not swept."""


@dataclass(frozen=True)
class BuildConfig(Checked):
    """How a bank is built."""

    poses: int = option(10_000, "Number of poses of the embedded source", low=10, high=1_000_000)
    dimensions: int = option(48, "Dimensions of the PCA subspace", low=2, high=512)
    seed: int = option(1, "Seed of the embedded pose source", low=0)
    views: str = option(
        "partial",
        "partial: clouds seen from all around; paper: the whole mesh's principal axes",
        choices=BANK_SCHEMES,
    )


@dataclass(frozen=True)
class Subspace:
    """PCA of descriptors: mean (P,), components (D, P), float32, largest variance first.

    ``explained`` is the share of the descriptors' variance that the components carry.
    """

    mean: NDArray[np.float32]
    components: NDArray[np.float32]
    explained: float = 1.0


def build_bank(
    body: Body,
    rotations: NDArray[np.float64],
    config: BuildConfig,
    source: dict[str, Any],
    progress: Progress | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Bank:
    """Build a bank; the same input gives the same bank, whoever does the work.

    Parameters
    ----------
    body : Body
    rotations : (N, 21, 3, 3)
        Segment rotations of the poses, model frame.
    config : BuildConfig
        Its number of poses and its seed are not used here.
    source : dict
        What the poses come from, for the file's header.
    progress : callable, optional
        Called with (poses done, poses in all).
    workers : int, optional
        Processes; all cores by default, 0 works in this process.
    scheduler : str, optional
        Address of a Dask scheduler; its workers render instead of processes of this machine.
    """
    # as they will be read back from the file, so that views and poses belong together exactly
    quats = round_quats(matrix_to_quat(rotations))
    poses = quat_to_matrix(quats.astype(np.float64))
    tasks = [
        (body, poses[i : i + POSES_PER_PART], i, config.views) for i in range(0, len(poses), POSES_PER_PART)
    ]
    views = _gather_views(run_parts(render_views, tasks, workers, scheduler), len(poses), progress)
    descriptors = views.descriptors
    with threadpool_limits(1):  # sums in the same order on any number of cores
        subspace = learn_subspace(descriptors.reshape(-1, descriptors.shape[-1]), config.dimensions)
        coefficients = project(descriptors, subspace)
    return Bank(
        body=body,
        pose_quats=quats,
        view_quats=matrix_to_quat(views.rotations.astype(np.float64)).astype(np.float32),
        view_origins=views.origins,
        coefficients=coefficients,
        mean=subspace.mean,
        components=subspace.components,
        source={**source, "views": config.views, "explained_variance": round(subspace.explained, 4)},
    ).rounded()


def _gather_views(parts: Iterable[PoseViews], count: int, progress: Progress | None) -> PoseViews:
    """Combine the parts as they arrive; the descriptors dominate the memory."""
    whole: PoseViews | None = None
    done = 0
    for part in parts:
        if whole is None:
            empty = [
                np.empty((count, *a.shape[1:]), a.dtype)
                for a in (part.descriptors, part.rotations, part.origins)
            ]
            whole = PoseViews(*empty)
        rows = slice(done, done + len(part.descriptors))
        whole.descriptors[rows] = part.descriptors
        whole.rotations[rows] = part.rotations
        whole.origins[rows] = part.origins
        done = rows.stop
        if progress is not None:
            progress(done, count)
    if whole is None:
        raise ConfigError("a bank needs at least one pose")
    return whole


def learn_subspace(descriptors: NDArray[np.float16], dimensions: int) -> Subspace:
    """Principal components of descriptors, from the covariance of about 24,000 of them.

    Parameters
    ----------
    descriptors : (M, P) float16
    dimensions : int
        Components to keep; fewer where there are fewer descriptors.
    """
    step = max(1, len(descriptors) // _SAMPLE)
    sample = descriptors[::step].astype(np.float32)
    mean = sample.mean(axis=0, dtype=np.float64).astype(np.float32)
    sample -= mean
    covariance = (sample.T @ sample).astype(np.float64)
    keep = min(dimensions, len(sample), len(mean))
    if 4 * keep < min(sample.shape):  # much faster than all vectors
        values, vectors = eigsh(covariance, k=keep, v0=np.ones(len(mean)))
    else:
        values, vectors = np.linalg.eigh(covariance)
    largest = np.argsort(-values, kind="stable")[:keep]
    explained = float(values[largest].sum() / max(float(np.trace(covariance)), 1e-12))
    return Subspace(mean, np.ascontiguousarray(vectors[:, largest].T.astype(np.float32)), explained)


def project(descriptors: NDArray[np.float16], subspace: Subspace) -> NDArray[np.float32]:
    """Coefficients of descriptors, shape (N, W, P), in the subspace, shape (N, W, D)."""
    n, views, _ = descriptors.shape
    out = np.empty((n, views, len(subspace.components)), np.float32)
    for i in range(0, n, 500):
        part = descriptors[i : i + 500].astype(np.float32) - subspace.mean
        out[i : i + 500] = part @ subspace.components.T
    return out
