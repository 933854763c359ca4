"""Coherent point drift: this implementation against pycpd, on the same points with the same settings.

    pip install pycpd==2.0.0
    OMP_NUM_THREADS=1 python benchmarks/cpd.py

Source: 632 visible vertices of the embedded body; target: 578 points of the body in another pose,
seen from the same camera, with 5 mm of noise. Both libraries get the same kernel width, stiffness,
outlier weight, first variance and number of iterations. Ours runs with the kernel's full-rank basis
(the same problem as pycpd's), with 60 basis points, and with what the pipeline uses: a wider kernel,
a floor under the variance, distances along the surface. Printed are the best processor time of
several runs, the mean distance from the moved points to the nearest target point, and the mean
distance to where the vertices really went.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from depth_pose._raster_kernels import rasterize
from depth_pose.body.procedural import make_body
from depth_pose.geometry import rotvec_to_matrix
from depth_pose.registration._articulated_kernels import mark_visible
from depth_pose.registration.articulated import vertex_normals
from depth_pose.registration.coherence import geodesic_basis
from depth_pose.registration.cpd import CpdConfig, euclidean_basis, register
from depth_pose.registration.laplacian import LaplacianCompleter
from depth_pose.skeleton import NODE_INDEX

SOURCE, TARGET = 632, 578
FACING = np.diag([1.0, -1.0, -1.0])


def scene(seed: int):
    """Body, visible vertices, their true place in the target pose, and the target points."""
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
        zbuffer, visible = np.empty((144, 176)), np.empty(len(vertices), np.bool_)
        camera = (200.0, 200.0, 87.5, 71.5)
        rasterize(vertices, body.faces, *camera, zbuffer)
        mark_visible(vertices, vertex_normals(body) @ FACING.T, zbuffer, *camera, 0.05, visible)
        seen.append(np.flatnonzero(visible))
    chosen = np.sort(rng.choice(seen[0], SOURCE, replace=False))
    points = after[rng.choice(seen[1], TARGET, replace=False)] + rng.normal(size=(TARGET, 3)) * 0.005
    return body, chosen, before, after, points


def best_time(run: Callable[[], object], repeats: int) -> float:
    run()
    times = []
    for _ in range(repeats):
        started = time.process_time()
        run()
        times.append(time.process_time() - started)
    return min(times)


def pycpd_run(source, target, config: CpdConfig) -> Callable[[], np.ndarray]:
    from pycpd import DeformableRegistration

    def run() -> np.ndarray:
        registration = DeformableRegistration(
            X=target, Y=source, alpha=config.stiffness, beta=config.beta, w=config.outlier_weight,
            sigma2=config.sigma_start**2, max_iterations=config.max_iterations, tolerance=0.0,
        )  # fmt: skip
        return registration.register()[0]

    return run


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    body, chosen, before, after, target = scene(options.seed)
    source, truth = before[chosen], after[chosen]
    tree = cKDTree(target)

    def report(name: str, run: Callable[[], np.ndarray], reference: float | None) -> float:
        took = best_time(run, options.repeats)
        moved = run()
        residual = tree.query(moved)[0].mean()
        off = np.linalg.norm(moved - truth, axis=1).mean()
        gain = f"{reference / took:8.0f} x" if reference else "     1 x"
        print(f"{name:46s} {took * 1e3:9.1f} ms {gain} {residual * 1e3:9.2f} mm {off * 1e3:9.2f} mm")
        return took

    size = f"{SOURCE} x {TARGET} points"
    print(f"{size:46s} {'time':>12s} {'speed':>10s} {'residual':>12s} {'off truth':>12s}")
    same = CpdConfig(beta=0.5, stiffness=3.0, max_iterations=27, sigma_floor=1e-3, tolerance=0.0)
    try:
        slow = report("pycpd 2.0.0, 27 iterations", pycpd_run(source, target, same), None)
    except ModuleNotFoundError:
        print("pycpd is not installed: pip install pycpd==2.0.0")
        slow = None
    full = euclidean_basis(source, SOURCE, same.beta)
    report("ours, same settings, full-rank basis", lambda: register(source, target, same, full).moved, slow)
    report("ours, same settings, basis of 60 made anew", lambda: register(source, target, same).moved, slow)
    used = CpdConfig(stiffness=same.stiffness)
    report("ours, pipeline's kernel width and floor", lambda: register(source, target, used).moved, slow)
    surface = geodesic_basis(body.vertices, body.faces, used.basis_points, used.beta)[chosen]
    report("ours, the same along the surface", lambda: register(source, target, used, surface).moved, slow)
    stiff = replace(used, stiffness=CpdConfig().stiffness)
    report("ours, the pipeline's settings", lambda: register(source, target, stiff, surface).moved, slow)

    completer = LaplacianCompleter(body.vertices, body.faces)
    moved = register(source, target, stiff, surface).moved
    targets, weights = before.copy(), np.zeros(len(before))
    targets[chosen], weights[chosen] = moved, 0.1
    took = best_time(lambda: completer.complete(before, targets, weights), options.repeats)
    print(f"Laplacian completion of {len(before)} vertices: {took * 1e3:.1f} ms")


if __name__ == "__main__":
    main()
