"""Joint angles and gait against the truth, by view and distance: the tables of docs/gait.md.

    python benchmarks/angles.py angles           # four motions, four views, three distances
    python benchmarks/angles.py gait             # straight walks, four views, two distances
    python benchmarks/angles.py angles --joints  # also deviations of joints by kind and confidence
    python benchmarks/angles.py constants        # numbers of the report halved and doubled

People, motions and noise are simulated before the time-of-flight sensor and a wall (angles), or a
sensor of 320 x 240 pixels (gait), and followed from the first frame with the default bank. Angles and
their deviations are those of `depth_pose.joint_angles`, the true ones those of the true joints and
segments. With ``--folder`` clips and skeletons are kept, and those that are there are not made again.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import one_thread  # noqa: F401
from command_line import make_parser
from parts.analysis_constants import Known, sweep, true_sway
from parts.builds import sample_person

from depth_pose.analysis import analyse_recording
from depth_pose.bank import Bank, default_bank_path
from depth_pose.body.angle_definitions import JOINT_ANGLES, angles_of
from depth_pose.body.joint_angles import measure_angles
from depth_pose.core.rotations import quat_to_matrix
from depth_pose.core.skeleton import JOINT_INDEX, JOINTS, JointState
from depth_pose.export.tracks import read_tracks
from depth_pose.io.mcap_read import DepthReader
from depth_pose.motion.clip import Clip
from depth_pose.motion.procedural.generator import make_clip
from depth_pose.offline import process_recording
from depth_pose.pipeline import PosePipeline
from depth_pose.sim.config import Placement, Room
from depth_pose.sim.function import FUNCTION_CLIPS, walk_straight
from depth_pose.sim.sensor import SENSORS, SensorModel
from depth_pose.sim.simulate import Stage, simulate

VIEWS = {"front": 0, "oblique": 45, "side": 90, "back": 180}
MOTIONS = ("walk", "squats", "bends", "play")
DISTANCES_M = (2.2, 3.2, 4.5)
WALK_DISTANCES_M = (4.0, 5.0)
HEIGHT_M = 1.0
UP = np.array([0.0, -1.0, 0.0])
SHOWN = (
    "hip_flexion",
    "hip_abduction",
    "hip_rotation",
    "knee_flexion",
    "ankle_dorsiflexion",
    "shoulder_elevation",
)
SHOWN += (
    "shoulder_rotation",
    "elbow_flexion",
    "trunk_flexion",
    "trunk_side",
    "trunk_rotation",
    "pelvis_tilt",
)


class Follower:
    """Makes clips and follows the person in them."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._pipeline: PosePipeline | None = None

    def follow(self, name: str, clip: Clip, seed: int, stage: Stage) -> tuple[Path, Path]:
        """Return the truth and the recording of skeletons of a clip."""
        recording = self._folder / f"{name}.mcap"
        skeletons = self._folder / f"{name}_skeletons.mcap"
        if not skeletons.exists():
            if self._pipeline is None:
                self._pipeline = PosePipeline(Bank.load(default_bank_path()))
                self._pipeline.warm_up()
            if not recording.exists():
                body = sample_person(np.random.default_rng(seed)).body()
                simulate(recording, body, clip, stage, seed=seed)
            process_recording(DepthReader(recording), skeletons, self._pipeline)
            print(name, flush=True)
        return recording.with_suffix(".npz"), skeletons


def clips(follower: Follower) -> Iterator[tuple[str, str, float, Path, Path]]:
    """Yield motion, view, distance, truth and skeletons of each clip of people who move on the spot."""
    sensor = SENSORS["tof"]
    for k, motion in enumerate(MOTIONS):
        clip = make_clip(motion, sensor.fps, 40 / sensor.fps, seed=100 + k)
        for view, azimuth in VIEWS.items():
            for distance in DISTANCES_M:
                stage = Stage(sensor, Placement(distance=distance, azimuth=azimuth, height=HEIGHT_M))
                name = f"{motion}_{view}_{distance}"
                yield motion, view, distance, *follower.follow(name, clip, k, stage)


def angle_errors(truth: Path, skeletons: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Errors and deviations of angles (T, 25), degrees; errors and confidences of joints (T, 19)."""
    true, tracks = np.load(truth), read_tracks(skeletons)
    track = max(tracks.people, key=lambda person: person.present.sum())
    seen = track.present
    at = np.searchsorted(true["stamps_ns"], track.stamps_ns[seen])
    joints, quats = true["joints"][at].astype(float), true["quats_xyzw"][at].astype(float)
    pelvis, thorax = (quat_to_matrix(quats[:, JOINT_INDEX[name]]) for name in ("pelvis", "chest"))
    known = angles_of(joints, pelvis, thorax, UP)
    confidence = track.joint_confidence[seen]
    carried = track.covariances[seen]
    states = track.joint_states[seen]
    found, stated = measure_angles(
        track.positions[seen], track.quats_xyzw[seen], confidence, states, carried, UP
    )
    # angles that the true posture shows
    shown = np.full_like(states, JointState.SEEN)
    shows = np.isfinite(measure_angles(joints, quats, np.ones_like(confidence), shown, None, UP)[0])
    errors = np.where(shows, (found - known + 180.0) % 360.0 - 180.0, np.nan)
    apart = track.positions[seen] - joints
    return errors, stated, apart - np.median(apart, axis=1, keepdims=True), confidence


def angles(arguments: argparse.Namespace, folder: Path) -> None:
    """Print errors of angles by view and distance."""
    rows = []
    for _, view, distance, truth, skeletons in clips(Follower(folder)):
        errors, stated, joints, confidence = angle_errors(truth, skeletons)
        rows.append((view, distance, errors[5:], stated[5:], joints[5:], confidence[5:]))
    columns = {"all": rows}
    columns |= {view: [r for r in rows if r[0] == view] for view in VIEWS}
    columns |= {f"{d} m": [r for r in rows if r[1] == d] for d in DISTANCES_M}
    print("| mean error, degrees | " + " | ".join(columns) + " | stated | measured |")
    print("|---" * (len(columns) + 3) + "|")
    for name in SHOWN:
        own = [
            i
            for i, angle in enumerate(JOINT_ANGLES)
            if angle.removeprefix("left_").removeprefix("right_") == name
        ]
        cells = [
            f"{np.nanmean(np.abs(np.concatenate([r[2][:, own] for r in part]))):.1f}"
            for part in columns.values()
        ]
        errors = np.concatenate([r[2][:, own] for r in rows])
        stated = np.concatenate([r[3][:, own] for r in rows])[np.isfinite(errors)]
        told = f"{np.sqrt(np.mean(stated**2)):.1f} for {np.sqrt(np.nanmean(errors**2)):.1f}"
        shown = f"{np.isfinite(errors).mean():.2f}"
        print(f"| {name.replace('_', ' ')} | " + " | ".join(cells) + f" | {told} | {shown} |")
    if arguments.joints:
        report_joints(np.concatenate([r[4] for r in rows]), np.concatenate([r[5] for r in rows]))


def report_joints(errors: np.ndarray, confidence: np.ndarray) -> None:
    """Print the root mean square of joints' errors in one direction, by kind and confidence, mm."""
    bins = ((0.0, 0.5), (0.5, 0.8), (0.8, 0.95), (0.95, 1.01))
    for kind in dict.fromkeys(name.rpartition("_")[2] for name in JOINTS):
        own = [i for i, name in enumerate(JOINTS) if name.endswith(kind)]
        cells = []
        for low, high in bins:
            inside = (confidence[:, own] >= low) & (confidence[:, own] < high)
            rms = 1e3 * np.sqrt(np.mean(errors[:, own][inside] ** 2)) if inside.any() else np.nan
            cells.append(f"{rms:.0f} ({inside.sum()})")
        print(f"{kind}: " + ", ".join(cells))


def walks(follower: Follower) -> Iterator[tuple[str, float, float, float, Path, Path]]:
    """Yield view, distance, true cadence and speed, truth and skeletons of straight walks."""
    sensor: SensorModel = SENSORS["kinect_v1"].with_width(320)
    for k, (view, azimuth) in enumerate(VIEWS.items()):
        for n, distance in enumerate(WALK_DISTANCES_M):
            seed = 2 * k + n
            cadence = 92.0 + 4.0 * seed
            clip = walk_straight(sensor.fps, 4.0, seed, cadence=cadence, size=0.8)
            room = Room(wall=4.5 if view != "side" else 2.0)
            stage = Stage(sensor, Placement(distance=distance, azimuth=azimuth, height=1.2, pitch=8.0), room)
            yield view, distance, cadence, *follower.follow(f"walk_{view}_{distance}", clip, seed, stage)


def true_step(joints: np.ndarray, cadence: float, fps: float) -> float:
    """Mean step length, metres, of true joints: between standing ankles, along the walk, both sides alike."""
    ahead = joints[-1, 0] - joints[0, 0]
    ahead /= np.linalg.norm(ahead)
    places = []
    for k in range(round(len(joints) / fps * cadence / 60.0) + 1):  # the left foot touches down at even k
        frame = round((k / 2 + 0.2) * 120.0 / cadence * fps)
        if frame < len(joints):
            ankle = JOINT_INDEX[f"{'left' if k % 2 == 0 else 'right'}_ankle"]
            places.append(joints[frame, ankle] @ ahead)
    steps = np.diff(places)
    return float(0.5 * (steps[0::2].mean() + steps[1::2].mean()))


def gait(_: argparse.Namespace, folder: Path) -> None:
    """Print measures of gait beside the true ones."""
    head = ("cadence, steps/min", "speed, m/s", "step length, cm", "step width, cm", "stance, %", "steps")
    print("| view | distance | " + " | ".join(head) + " |")
    print("|---" * 8 + "|")
    for view, distance, cadence, truth, skeletons in walks(Follower(folder)):
        joints = np.load(truth)["joints"].astype(float)
        step = true_step(joints, cadence, 30.0)
        person = max(analyse_recording(skeletons).people, key=lambda one: one.motion.present.sum())
        found = {m.name: m for m in person.gait.measures if not m.side}
        stance = [m for m in person.gait.measures if m.name == "stance" and m.is_known]
        if not found["cadence"].is_known:
            print(f"| {view} | {distance} m | not known: {found['cadence'].reason} | | | | | |")
            continue
        speed = step * cadence / 60.0
        length, width = found["step length"], found["step width"]
        cells = [
            f"{found['cadence'].value:.1f} of {cadence:.1f}",
            f"{found['speed'].value:.3f} of {speed:.3f}",
            f"{100 * length.value:.1f} ± {100 * length.deviation:.1f} of {100 * step:.1f}",
            f"{100 * width.value:.1f} ± {100 * width.deviation:.1f}",
            " ".join(f"{m.value:.0f}" for m in stance) or "not known",
            str(length.count),
        ]
        print(f"| {view} | {distance} m | " + " | ".join(cells) + " |")


def functions(follower: Follower) -> Iterator[tuple[str, Path, Path]]:
    """Yield motion, truth and skeletons of people who rise from a chair or stand still."""
    sensor: SensorModel = SENSORS["kinect_v1"].with_width(320)
    for motion, seconds in (("sit_to_stand", 22.0), ("stand_still", 12.0)):
        for k, view in enumerate(("front", "oblique")):
            clip = FUNCTION_CLIPS[motion](sensor.fps, seconds, k)
            placement = Placement(distance=3.2, azimuth=VIEWS[view], height=1.2, pitch=8.0)
            yield motion, *follower.follow(f"{motion}_{view}", clip, k, Stage(sensor, placement))


def report_constants(arguments: argparse.Namespace, folder: Path) -> None:
    """Halve and double the numbers of the report."""
    follower, recordings = Follower(folder), []
    for _, _, cadence, truth, skeletons in walks(follower):
        step = true_step(np.load(truth)["joints"].astype(float), cadence, 30.0)
        recordings.append(Known(skeletons, 1.2, 8.0, cadence=cadence, step=step))
    for motion, truth, skeletons in functions(follower):
        shown = {"rises": 6.0} if motion == "sit_to_stand" else {"sway": true_sway(truth)}
        recordings.append(Known(skeletons, 1.2, 8.0, **shown))
    sweep(recordings, arguments.only)


def main() -> None:
    """Simulate, follow and report."""
    parser = make_parser(__doc__)
    parser.add_argument("part", choices=("angles", "gait", "constants"))
    parser.add_argument("--joints", action="store_true")
    parser.add_argument("--only", nargs="*", default=[""], help="constants: beginnings of names")
    parser.add_argument("--folder", type=Path)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        kept = arguments.folder or Path(folder)
        kept.mkdir(parents=True, exist_ok=True)
        {"angles": angles, "gait": gait, "constants": report_constants}[arguments.part](arguments, kept)


if __name__ == "__main__":
    main()
