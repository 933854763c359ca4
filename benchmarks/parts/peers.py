"""Compare steps of the pipeline with common alternatives, on the same input in the same run.

A simulated person before a time-of-flight camera, twenty-five frames:

denoise    the person's raw points, by the modified locally optimal projection, and by Open3D's statistical
           outlier removal (20 neighbours, 2 deviations), and that with voxels of 2 cm; how far the points
           then are from the true surface, on average and at the 95th percentile
search     the 128 nearest of the bank's entries to the frame's descriptor, exactly: `SubspaceSearch`, SciPy's
           cKDTree, NumPy comparing with every entry; all find the same ones
fit        from the matcher's best exemplar: the articulated fit, and Open3D's rigid point-to-plane ICP, which
           can only move the exemplar as a whole: not the same task, but what a rigid tool offers

Prints medians of the processor time, all threads together.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from depth_pose.bank import Bank
from depth_pose.bank.canonical import describe
from depth_pose.bank.views import AXES
from depth_pose.body.body import Body
from depth_pose.body.build import BUILD_NAMES
from depth_pose.core.camera import Camera
from depth_pose.core.config import DenoiseConfig, SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.core.open3d import load_open3d
from depth_pose.core.skeleton import JOINT_NODES
from depth_pose.denoise.denoise import denoise_depth
from depth_pose.detect.plane_segmenter import PlaneSegmenter
from depth_pose.match.search import SubspaceSearch
from depth_pose.match.tuning import MatchTuning
from depth_pose.perception import Perception
from depth_pose.refine.body_fitter import BodyFitter
from depth_pose.refine.objective import Objective
from depth_pose.refine.solver import Hypothesis
from depth_pose.sim.config import Person, Placement, Room
from depth_pose.sim.motion import load_motion
from depth_pose.sim.placement import camera_pose, room_mesh
from depth_pose.sim.sensor import SENSORS, VirtualSensor
from depth_pose.sim.simulate import root_scale, transform
from parts.known_people import make_matcher

o3d = load_open3d()

FRAMES, STRIDE = 25, 3
"""Number of frames compared, and step between them. Set by hand."""
_NEAREST = 128
"""Number of neighbours per search. Set by hand."""
_ICP_M, _ICP_ITERATIONS = 0.1, 30
"""Maximum pair distance, metres, and maximum iterations of ICP. Set by hand."""


@dataclass(frozen=True)
class Peer:
    """Result of one method for a step: median milliseconds, and its quality, as text."""

    step: str
    name: str
    ms: float
    worth: str


@dataclass(frozen=True)
class Scene:
    """A frame, the true surface (vertices, camera frame) and the joints."""

    frame: DepthFrame
    vertices: np.ndarray
    joints: np.ndarray


class _Stopwatch:
    """Timer that calls a function and records the processor time."""

    def __init__(self) -> None:
        self.ms: list[float] = []

    def __call__(self, call: Callable[[], Any]) -> Any:
        started = time.process_time()
        answer = call()
        self.ms.append(1e3 * (time.process_time() - started))
        return answer

    @property
    def median(self) -> float:
        return float(np.median(self.ms[1:]))  # without the first, which may load libraries


def scenes() -> tuple[Body, list[Scene]]:
    """Simulate frames with a known surface."""
    body, sensor = Person().body(), VirtualSensor(SENSORS["tof"], seed=1)
    clip = load_motion("play", SENSORS["tof"].fps, FRAMES * STRIDE / SENSORS["tof"].fps, seed=1)
    roots = clip.roots * root_scale(body)
    target = 0.5 * (roots.min(axis=0) + roots.max(axis=0))
    T_camera_model = camera_pose(Placement(), target)
    vertices, faces = room_mesh(Room(), Placement(), target)
    room = (transform(T_camera_model, vertices), faces)
    made = []
    for i in range(0, len(roots), STRIDE):
        posed = body.pose(clip.rotations[i], roots[i])
        surface = transform(T_camera_model, posed.vertices)
        depth = sensor.render([(surface, body.faces), room])
        frame = DepthFrame(len(made) * 40_000_000, "camera", depth, sensor.model.camera)
        made.append(Scene(frame, surface, transform(T_camera_model, posed.nodes[JOINT_NODES])))
    return body, made


def _points(depth: np.ndarray, camera: Camera) -> np.ndarray:
    points = camera.back_project(depth)
    return np.asarray(points[depth > 0], np.float64)


def _off_surface(points: np.ndarray, scene: Scene, body: Body) -> np.ndarray:
    from open3d import core

    casting = o3d.t.geometry.RaycastingScene()
    casting.add_triangles(
        core.Tensor(scene.vertices.astype(np.float32)), core.Tensor(body.faces.astype(np.uint32))
    )
    return casting.compute_distance(core.Tensor(points.astype(np.float32))).numpy()


def compare_denoising(body: Body, made: list[Scene]) -> list[Peer]:
    """Denoise the same points with three methods."""
    segmenter, config = PlaneSegmenter(SegmentConfig()), DenoiseConfig()

    def outliers(points: np.ndarray) -> o3d.geometry.PointCloud:
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
        return cloud.remove_statistical_outlier(20, 2.0)[0]

    names = (
        "none", "modified locally optimal projection (ours)",
        "Open3D statistical outlier removal", "Open3D outlier removal, then voxels of 2 cm",
    )  # fmt: skip
    watches, off = [_Stopwatch() for _ in names], [[] for _ in names]
    for scene in made:
        person = segmenter.segment(scene.frame)
        depth, camera = person.depth, person.camera
        raw = _points(depth, camera)
        smooth = watches[1](lambda d=depth, c=camera: denoise_depth(d, c, config))
        kept = watches[2](lambda r=raw: outliers(r))
        boxed = watches[3](lambda r=raw: outliers(r).voxel_down_sample(0.02))
        for k, points in enumerate((raw, _points(smooth, camera), kept.points, boxed.points)):
            off[k].append(_off_surface(np.asarray(points), scene, body))
    rows = []
    for name, watch, gaps in zip(names, watches, off, strict=True):
        all_ = 1e3 * np.concatenate(gaps)
        worth = (
            f"{all_.mean():.1f} mm off, 95 % {np.percentile(all_, 95):.1f} mm, {len(all_) // FRAMES} points"
        )
        rows.append(Peer("denoise", name, watch.median if watch.ms else 0.0, worth))
    return rows


def compare_search(bank: Bank, made: list[Scene]) -> list[Peer]:
    """Search the bank's entries with three methods."""
    table = np.ascontiguousarray(bank.coefficients.reshape(-1, bank.coefficients.shape[-1]))
    ours, tree = SubspaceSearch(table), cKDTree(table)
    squares = np.einsum("nd,nd->n", table, table)

    def brute(point: np.ndarray) -> np.ndarray:
        return np.argpartition(squares - 2.0 * (table @ point), _NEAREST)[:_NEAREST]

    perception = Perception(SegmentConfig(), DenoiseConfig())
    watches, same = [_Stopwatch() for _ in range(3)], 0
    for scene in made:
        (person,) = perception.perceive(scene.frame).persons
        axes = AXES[bank.view_scheme](person.points)[0]
        descriptor = describe(person.points, axes, 1.0).astype(np.float32)
        point = bank.components @ (descriptor - bank.mean)
        found = [
            watches[0](lambda p=point: ours.find(p, _NEAREST).entries),
            watches[1](lambda p=point: tree.query(p, _NEAREST)[1]),
            watches[2](lambda p=point: brute(p)),
        ]
        same += len(set.intersection(*(set(map(int, f)) for f in found)))
    worth = f"{same / (_NEAREST * len(made)):.2%} found by all"
    names = ("bounded by 24 dimensions (ours)", "SciPy cKDTree", "NumPy, every entry")
    return [
        Peer(f"search, {len(table):,} entries", n, w.median, worth)
        for n, w in zip(names, watches, strict=True)
    ]


def compare_fits(bank: Bank, made: list[Scene]) -> list[Peer]:
    """Fit from the matcher's best exemplar, articulated and rigid."""
    body, normals = bank.body, bank.body.normals
    perception, matcher = (
        Perception(SegmentConfig(), DenoiseConfig()),
        make_matcher(bank, MatchTuning(search_every=1)),
    )
    fitter, objective, watches = BodyFitter(body), Objective(bank), [_Stopwatch(), _Stopwatch()]
    usual = np.zeros(len(BUILD_NAMES), np.float32)
    errors: list[list[float]] = [[], [], []]
    estimate = o3d.pipelines.registration.TransformationEstimationPointToPlane()
    criteria = o3d.pipelines.registration.ICPConvergenceCriteria(max_iteration=_ICP_ITERATIONS)
    for scene in made:
        people = perception.perceive(scene.frame)
        (person,), (match,) = people.persons, matcher.match(people)
        start = bank.pose(match.candidates[0], match.scale)
        posed = body.pose(start.rotations, start.root, start.scale)

        def articulated(person=person, start=start):
            frame = fitter.problem(person, usual, objective)
            return frame.fine(frame.best([Hypothesis(start, "exemplar")], 1)).body.nodes

        def rigid(person=person, start=start, posed=posed):
            source = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(person.points))
            target = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(posed.vertices))
            weights = body.weights @ start.rotations.reshape(21, 9)
            turned = np.einsum("vij,vj->vi", weights.reshape(-1, 3, 3), normals)
            target.normals = o3d.utility.Vector3dVector(turned)
            found = o3d.pipelines.registration.registration_icp(
                source, target, _ICP_M, np.eye(4), estimate, criteria
            )
            return transform(np.linalg.inv(found.transformation), posed.nodes)

        for k, nodes in enumerate((posed.nodes, watches[0](articulated), watches[1](rigid))):
            errors[k].append(float(np.linalg.norm(nodes[JOINT_NODES] - scene.joints, axis=1).mean()))
    names = ("none: the exemplar", "articulated fit, 8 iterations (ours)", "Open3D point-to-plane ICP, rigid")
    times = (0.0, watches[0].median, watches[1].median)
    return [
        Peer("fit", n, t, f"joints {1e3 * np.mean(e):.0f} mm off")
        for n, t, e in zip(names, times, errors, strict=True)
    ]


def compare_all(bank: Bank) -> list[Peer]:
    """Run all comparisons."""
    body, made = scenes()
    return [*compare_denoising(body, made), *compare_search(bank, made), *compare_fits(bank, made)]


def table(peers: list[Peer]) -> str:
    """Format comparisons in Markdown."""
    lines = ["| step | by | ms | worth |", "|---|---|---|---|"]
    lines += [f"| {p.step} | {p.name} | {f'{p.ms:.2f}' if p.ms else ''} | {p.worth} |" for p in peers]
    return "\n".join(lines)
