"""Accuracy of the volume tracker on unseen performances, and its cost.

    python benchmarks/volume.py dances accuracy --out docs/images   # tables and plots, about ten minutes
    python benchmarks/volume.py dances depth --out docs/images      # 1, 2 and 4 depth cameras, ten minutes
    python benchmarks/volume.py dances cost                         # time by voxel, particles, cameras
    python benchmarks/volume.py dances constants --dance swing      # numbers halved and doubled

Training uses ten performances of each dance, 350 frames in all, on wearers of three builds; the test uses 300
frames each of three other people in other garments, in other performances. Prints tables in Markdown.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from command_line import make_parser

from depth_pose.core.camera import Camera
from depth_pose.motion.procedural.dance import DANCES, perform
from depth_pose.rooms.rigfile import Rig
from depth_pose.sim.clothing import Garment
from depth_pose.sim.roof_cameras import (
    ROOF_CAMERA,
    RigRenderer,
    depth_ring,
    front_camera,
    roof_rig,
    roughen,
)
from depth_pose.sim.wearers import Wearer, dressed_frames
from depth_pose.volume.config import LearnConfig, SpaceConfig, TrackConfig, ViewsConfig, VolumeConfig
from depth_pose.volume.hull import HullCarver
from depth_pose.volume.learn.learning import learn_model
from depth_pose.volume.learn.performances import TEST_SHAPES, rig_eyes, watch
from depth_pose.volume.learn.plots import save_latent, save_report
from depth_pose.volume.learn.report import Report, report_rows, track_performance
from depth_pose.volume.learn.training import dance_clips, default_wearers, simulate_views
from depth_pose.volume.model import VolumeModel
from depth_pose.volume.pipeline import VolumePipeline
from depth_pose.volume.synchroniser import ViewSet
from depth_pose.volume.tuning import LearnTuning
from parts.changed_constant.factors import FACTORS, times
from parts.constants import changed, constants, shown

TEST_SEEDS = (11, 12, 13)
"""Performances of the three test dancers; training uses 1 to 10, settings were chosen on 101, 102."""

TEST_BEATS = (0.0, 4.0, 7.0)
"""Beats of the dance at which the tests begin."""
TEST_GARMENTS = (
    Garment(skirt=0.50, flare=0.36),
    Garment(skirt=0.65, flare=0.27),
    Garment(skirt=0.74, flare=0.24, drag=2.0),
)
"""Different from those of training."""


SHOWN = range(20, 300, 40)
"""Frames in the pictures."""


def table(rows: list[list[str]]) -> None:
    print("| " + " | ".join(rows[0]) + " |")
    print("|" + "---|" * len(rows[0]))
    for row in rows[1:]:
        print("| " + " | ".join(row) + " |", flush=True)
    print()


def test_clips(dance: str):
    return [perform(dance, s, 10.0, start_beat=b) for s, b in zip(TEST_SEEDS, TEST_BEATS, strict=True)]


def watch_all(dance: str, eyes, dressed: bool = True):
    return [
        watch(clip, Wearer(shape, garment if dressed else None), eyes)
        for clip, shape, garment in zip(test_clips(dance), TEST_SHAPES, TEST_GARMENTS, strict=True)
    ]


def summary(name: str, reports: list[Report], which: str = "fitted") -> list[str]:
    means = [np.mean([getattr(r, n).angle_deg for r in reports]) for n in ("mean_pose", "best_training")]
    found = [getattr(r, which) for r in reports]
    angle = float(np.mean([s.angle_deg for s in found]))
    return [
        name, f"{means[0]:.1f}°", f"{means[1]:.2f}°", f"**{angle:.2f}°**", f"{angle / means[1]:.2f}",
        f"{np.mean([s.rms_deg for s in found]):.2f}°", f"{np.mean([s.joint_cm for s in found]):.1f} cm",
    ]  # fmt: skip


HEAD = ["", "mean pose", "best training pose", "error", "error / best", "RMS as the paper", "joints"]


def accuracy(out: Path, models: Path, dances: list[str]) -> None:
    models.mkdir(parents=True, exist_ok=True)
    rig = roof_rig()
    eyes = rig_eyes("silhouettes", rig)
    shown: list[tuple[VolumeModel, Report]] = []
    for dance in dances:
        began = time.monotonic()
        views = simulate_views(dance_clips(dance), default_wearers(), rig=rig)
        simulated, cpu = time.monotonic() - began, time.process_time()
        model = learn_model(views, LearnConfig(), about=f"dance {dance}")
        learned = time.process_time() - cpu
        model.save(models / f"{dance}.npz")
        print(f"## {dance}\n\n{model.meta['frames']} frames: simulated in {simulated:.0f} s, learned in "
              f"{learned:.1f} s of one core\n")  # fmt: skip
        tests = watch_all(dance, eyes)
        reports = [track_performance(model, p) for p in tests]
        table(report_rows(reports))
        shown.append((model, reports[0]))
        save_report(reports[1], tests[1], out / f"volume_{dance}.png", SHOWN)

        rows = [HEAD, summary("default", reports), summary("regressed only, no fit", reports, "regressed")]
        latent = VolumeConfig(track=TrackConfig(likelihood="latent"))
        paper = [track_performance(model, p, latent) for p in tests]
        rows.append(summary("eq. 4 likelihood, no fit", paper, "regressed"))
        rows.append(summary("eq. 4 likelihood, fit", paper))
        given = [
            track_performance(model, p, VolumeConfig(track=TrackConfig(stature=p.stature))) for p in tests
        ]
        rows.append(summary("height given", given))
        pv = learn_model(views, tuning=LearnTuning(pose_variance=0.95))
        rows.append(summary("95 % of the poses' variance", [track_performance(pv, p) for p in tests]))
        bare = watch_all(dance, eyes, dressed=False)
        rows.append(summary("no skirt in the test", [track_performance(model, p) for p in bare]))
        one = learn_model([views[0][:1]], LearnConfig())
        rows.append(summary("one wearer taught", [track_performance(one, p) for p in tests]))
        naked = learn_model([[views[0][3], views[0][4]]], LearnConfig())
        rows.append(
            summary("no skirt taught, skirt in the test", [track_performance(naked, p) for p in tests])
        )
        clothed = learn_model([views[0][:3]], LearnConfig())
        rows.append(summary("skirts taught, none in the test", [track_performance(clothed, p) for p in bare]))
        rows.append(summary("one performance, 350 frames", single_performance(dance, rig, tests)))
        rows.append(summary("rough silhouettes", rough(dance, model, rig)))
        table(rows)
    for (model, report), dance in zip(shown, dances, strict=True):
        save_latent(model, [report], out / f"volume_latent_{dance}.png", [dance])


DEPTH_RIGS = {
    "1, in front of where the dance begins": (0,), "1, to the left (90°)": (90,), "1, behind (200°)": (200,),
    "2, to the front left and right (±45°)": (-45, 45), "2, in front and behind": (0, 180),
    "4, all around": (0, 90, 180, 270),
}  # fmt: skip
"""Azimuths of depth cameras."""


def depth_accuracy(out: Path, models: Path, dances: list[str]) -> None:
    """Test one model with any number of depth cameras at any position."""
    for dance in dances:
        views = simulate_views(dance_clips(dance), default_wearers(), "depth")
        model = learn_model(views, LearnConfig(), about=f"dance {dance}")
        model.save(models / f"{dance}_depth.npz")
        print(f"## {dance}, depth cameras\n")
        rows = [[*HEAD, "volume to pose"]]
        for name, degrees in DEPTH_RIGS.items():
            rig = [front_camera(azimuth=np.radians(d)) for d in degrees]
            seen = watch_all(dance, rig_eyes("depth", rig))
            found = [track_performance(model, p) for p in seen]
            rows.append([*summary(name, found), f"{np.median([r.ms for r in found]):.1f} ms"])
            if degrees in ((0,), (-45, 45)):
                tail = "" if len(rig) == 1 else f"_{len(rig)}"
                save_report(found[1], seen[1], out / f"volume_{dance}_depth{tail}.png", SHOWN)
        table(rows)


def single_performance(dance, rig, tests):
    views = simulate_views([perform(dance, 1, 350 / 30)], default_wearers(), every=1, rig=rig)
    model = learn_model(views, LearnConfig())
    return [track_performance(model, p) for p in tests]


def rough(dance, model, rig):
    """Silhouettes with ragged outlines and specks."""
    rng, carver, renderer = np.random.default_rng(0), HullCarver(rig), RigRenderer(rig)

    def eyes(meshes):
        return carver.carve([roughen(s, rng, 0.15, 0.0005) for s in renderer.silhouettes(meshes)])

    return [track_performance(model, p) for p in watch_all(dance, eyes)]


def cost(models: Path, out: Path) -> None:
    """Processor time from images to pose, single thread, medians."""
    model = VolumeModel.load(models / "swing.npz")
    clip = perform("swing", 21, 4.0)
    wearer = Wearer(TEST_SHAPES[1], TEST_GARMENTS[1])
    scenes = [meshes for meshes, _ in dressed_frames(wearer, clip)]
    rows = [["", "images to volume", "volume to pose", "in all", "frames a second", "95 % below"]]
    points = {}
    fine = Camera(512, 384, 380.0, 380.0, 255.5, 191.5)
    cases = [
        ("2 cm, 8 cameras, 100 particles", 0.02, 8, 100, ROOF_CAMERA),
        ("1 cm", 0.01, 8, 100, ROOF_CAMERA), ("1 cm, 512 x 384", 0.01, 8, 100, fine),
        ("3 cm", 0.03, 8, 100, ROOF_CAMERA), ("4 cm", 0.04, 8, 100, ROOF_CAMERA),
        ("50 particles", 0.02, 8, 50, ROOF_CAMERA), ("400 particles", 0.02, 8, 400, ROOF_CAMERA),
        ("4 cameras", 0.02, 4, 100, ROOF_CAMERA), ("16 cameras", 0.02, 16, 100, ROOF_CAMERA),
        ("no fit", 0.02, 8, 100, ROOF_CAMERA),
    ]  # fmt: skip
    for name, voxel, cameras, particles, camera in cases:
        track = TrackConfig(particles=particles, refine=name != "no fit")
        config = VolumeConfig(space=SpaceConfig(voxel=voxel), track=track)
        times = measure(model, roof_rig(cameras, camera=camera), config, scenes)
        points[name] = add_cost(rows, name, times)
    model = VolumeModel.load(models / "swing_depth.npz")
    for count in (1, 2, 4):  # of images that show the person only
        name = f"{count} depth camera{'s' if count > 1 else ''}"
        times = measure(model, depth_ring(count), VolumeConfig(views=ViewsConfig(cut_out=False)), scenes)
        points[name] = add_cost(rows, name, times)
    table(rows)
    draw_cost(points, out / "volume_cost.png")


def measure(model: VolumeModel, rig, config: VolumeConfig, scenes) -> list[tuple[float, float]]:
    """Measure the seconds from images to volume, and from there to the pose."""
    pipeline, renderer, times = VolumePipeline(model, Rig(rig), config), RigRenderer(rig), []
    pipeline.warm_up()
    for i, meshes in enumerate(scenes):
        views = ViewSet(1 + round(i * 1e9 / 30), renderer.images(meshes, model.meta["input"]))
        started = time.thread_time()
        volume, _ = pipeline.eyes.see(views)
        between = time.thread_time()
        pipeline.tracker.process(volume, views.stamp_ns)
        times.append((between - started, time.thread_time() - between))
    return times


def add_cost(rows: list[list[str]], name: str, times: list[tuple[float, float]]):
    """Add a row of medians, from when the height is settled; return them."""
    settled = 1e3 * np.array(times)[60:]
    total, middle = settled.sum(axis=1), np.median(settled, axis=0)
    rows.append([name, *(f"{m:.1f} ms" for m in middle), f"{np.median(total):.1f} ms",
                 f"{1e3 / np.median(total):.0f}", f"{np.percentile(total, 95):.1f} ms"])  # fmt: skip
    return middle


def sweep(dances: list[str], only: list[str]) -> None:
    """Halve and double the numbers of the learning and of the tracker; print the changes of the error."""
    rig = roof_rig()
    tests = {dance: watch_all(dance, rig_eyes("silhouettes", rig)) for dance in dances}
    views = {d: simulate_views(dance_clips(d), default_wearers(), rig=rig) for d in dances}

    def error() -> float:
        angles = []
        for dance in dances:
            model = learn_model(views[dance], LearnConfig())
            angles += [track_performance(model, p).fitted.angle_deg for p in tests[dance]]
        return float(np.mean(angles))

    base, rows = error(), []
    for name, module, variable, value in constants(("volume", "volume.learn")):
        if not name.removeprefix("volume.").startswith(tuple(only)):
            continue
        changes = []
        for factor in FACTORS:
            with changed(module, variable, times(value, factor)):
                try:
                    changes.append(f"{error() - base:+.2f}")
                except (ValueError, IndexError) as failure:
                    changes.append(f"out of range: {failure}")
        rows.append([name, shown(value), *changes])
        print(" | ".join(rows[-1]), flush=True)
    print(f"\n{base:.2f}°; change:")
    table([["", "value", "half", "double"], *rows])


def draw_cost(points, path: Path) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 3.8), dpi=110)
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    names, values = list(points), np.array(list(points.values()))
    rows = np.arange(len(names))
    axes.barh(rows, values[:, 0], color="#1f9bcf", label="images to volume")
    axes.barh(rows, values[:, 1], left=values[:, 0], color="#f08a24", label="volume to pose")
    axes.axvline(1e3 / 60, color="black", lw=1, ls="--")
    axes.text(1e3 / 60 + 0.1, len(names) - 0.6, "60 a second", fontsize=8, va="top")
    axes.set_yticks(rows, names, fontsize=8)
    axes.invert_yaxis()
    axes.set_xlabel("milliseconds of one core per frame (median)")
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(0.7, 0.6))
    axes.spines[["top", "right"]].set_visible(False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, bbox_inches="tight")


def main() -> None:
    parser = make_parser(__doc__)
    parser.add_argument("what", choices=("accuracy", "depth", "cost", "constants"))
    parser.add_argument("--out", type=Path, default=Path("volume_plots"), help="folder for the plots")
    parser.add_argument("--models", type=Path, default=Path("volume_models"), help="folder for the models")
    parser.add_argument("--dance", action="append", choices=list(DANCES), help="only this one")
    parser.add_argument("--only", nargs="*", default=[""], help="constants: beginnings of names")
    given = parser.parse_args()
    if given.what == "accuracy":
        accuracy(given.out, given.models, given.dance or list(DANCES))
    elif given.what == "depth":
        depth_accuracy(given.out, given.models, given.dance or list(DANCES))
    elif given.what == "constants":
        sweep(given.dance or list(DANCES), given.only)
    else:
        cost(given.models, given.out)
