"""Coherent point drift: this implementation against pycpd, with the same points and settings.

Source: 632 visible vertices of the embedded body; target: 578 points of the body in another pose,
seen from the same camera, with 5 mm of noise. Both get the same kernel width, stiffness, outlier weight,
first variance and number of iterations. Ours runs with the kernel's full-rank basis (the same problem as
pycpd's), with 60 basis points, and with what the pipeline uses: a wider, stiffer kernel, a floor under the
variance, distances along the surface. Reported are the median processor time of several runs, the mean
distance from the moved points to the nearest target point, and that to the true positions of the vertices.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import version

import numpy as np
from scipy.spatial import cKDTree

from depth_pose.body.procedural import make_body
from depth_pose.body.rendered_depth import render_depth
from depth_pose.core.camera import Camera
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL as FACING
from depth_pose.core.rotations import rotvec_to_matrix
from depth_pose.core.skeleton import NODE_INDEX
from depth_pose.paper.coherence import geodesic_basis
from depth_pose.paper.cpd import euclidean_basis, register
from depth_pose.paper.laplacian import LaplacianCompleter
from depth_pose.paper.tuning import CpdTuning
from depth_pose.refine._visibility_kernels import mark_visible

SOURCE, TARGET = 632, 578
"""Number of source and target points: as many as a person has in a small image."""


def scene(seed: int):
    """Body, visible vertices, their true positions in the target pose, and the target points."""
    rng = np.random.default_rng(seed)
    body = make_body()
    rotations = np.tile(FACING, (21, 1, 1))
    before = body.pose(rotations, np.array([0, 0, 3.0])).vertices
    for names, turn in (
        (("left_shoulder", "left_elbow", "left_wrist"), (0, 0, 0.25)),
        (("right_elbow", "right_wrist"), (0, 0.2, -0.3)),
        (("left_hip", "left_knee", "left_ankle", "left_foot"), (0.2, 0, 0.1)),
    ):
        for name in names:
            n = NODE_INDEX[name]
            rotations[n] = rotvec_to_matrix(np.array(turn)) @ rotations[n]
    after = body.pose(rotations, np.array([0.03, 0, 3.03])).vertices
    seen = []
    for vertices in (before, after):
        visible = np.empty(len(vertices), np.bool_)
        camera = Camera(176, 144, 200.0, 200.0, 87.5, 71.5)
        zbuffer = render_depth(vertices, body.faces, camera)
        mark_visible(vertices, body.normals @ FACING.T, zbuffer, camera, 0.05, visible)
        seen.append(np.flatnonzero(visible))
    chosen = np.sort(rng.choice(seen[0], SOURCE, replace=False))
    points = after[rng.choice(seen[1], TARGET, replace=False)] + rng.normal(size=(TARGET, 3)) * 0.005
    return body, chosen, before, after, points


@dataclass(frozen=True)
class Registration:
    """Result of one method: median milliseconds, and mean distances in millimetres."""

    name: str
    ms: float
    residual_mm: float
    off_truth_mm: float


def median_time(run: Callable[[], object], repeats: int) -> float:
    """Median processor time, milliseconds, after a first run that is not counted."""
    run()
    times = []
    for _ in range(repeats):
        started = time.process_time()
        run()
        times.append(time.process_time() - started)
    return 1e3 * float(np.median(times))


def pycpd_run(source, target, config: CpdTuning) -> Callable[[], np.ndarray]:
    """Register with pycpd."""
    from pycpd import DeformableRegistration

    def run() -> np.ndarray:
        registration = DeformableRegistration(
            X=target, Y=source, alpha=config.stiffness, beta=config.beta, w=config.outlier_weight,
            sigma2=config.sigma_start**2, max_iterations=config.max_iterations, tolerance=0.0,
        )  # fmt: skip
        return registration.register()[0]

    return run


def _ways(body, chosen, source, target) -> Iterator[tuple[str, Callable[[], np.ndarray]]]:
    same = CpdTuning(beta=0.5, stiffness=3.0, max_iterations=27, sigma_floor=1e-3, tolerance=0.0)
    yield f"pycpd {version('pycpd')}", pycpd_run(source, target, same)
    full = euclidean_basis(source, SOURCE, same.beta, 1e-8)
    yield "ours, full-rank basis", lambda: register(source, target, same, full).moved
    yield "ours, basis of 60 points made anew", lambda: register(source, target, same).moved
    used = CpdTuning()
    surface = geodesic_basis(body.vertices, body.faces, used.basis_points, used.beta)[chosen]
    soft = used._replace(stiffness=same.stiffness)
    yield (
        "ours, pipeline's width and floor, along the surface",
        lambda: register(source, target, soft, surface).moved,
    )
    yield "ours, pipeline's settings", lambda: register(source, target, used, surface).moved


def compare(seed: int = 0, repeats: int = 5) -> list[Registration]:
    """Register the same points with every method."""
    body, chosen, before, after, target = scene(seed)
    source, truth = before[chosen], after[chosen]
    tree, rows = cKDTree(target), []
    for name, run in _ways(body, chosen, source, target):
        moved = run()
        residual = 1e3 * float(tree.query(moved)[0].mean())
        off = 1e3 * float(np.linalg.norm(moved - truth, axis=1).mean())
        rows.append(Registration(name, median_time(run, repeats), residual, off))
    return rows


def completion_time(repeats: int = 5) -> float:
    """Median time of the Laplacian completion of the body, milliseconds."""
    body, chosen, before, after, _ = scene(0)
    completer = LaplacianCompleter(body.vertices, body.faces)
    targets, weights = before.copy(), np.zeros(len(before))
    targets[chosen], weights[chosen] = after[chosen], 0.1
    return median_time(lambda: completer.complete(before, targets, weights), repeats)


def table(rows: list[Registration]) -> str:
    """Format the registrations in Markdown; speed is relative to pycpd."""
    slow = next(r.ms for r in rows if r.name.startswith("pycpd"))
    lines = ["| by | ms | speed | residual mm | off the truth mm |", "|---|---|---|---|---|"]
    lines += [
        f"| {r.name} | {r.ms:.1f} | {slow / r.ms:.1f} x | {r.residual_mm:.3f} | {r.off_truth_mm:.2f} |"
        for r in rows
    ]
    return "\n".join(lines)
