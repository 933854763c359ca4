"""Fit the joints' confidence to simulated people, and check it on recordings.

    python benchmarks/accuracy.py confidence --check DATA -o docs/images/reliability.png
    python benchmarks/accuracy.py confidence --check DATA --mocap captures
    python benchmarks/accuracy.py confidence --rooms 40   # the skeletons' confidence, in rooms with clutter

Clips (``--clips``) of 40 frames of people of other builds than the bank's, before both kinds of sensor with
half to twice their noise, from 1.5 m, where the image cuts off their feet, to 4 m away, half of them from all
around, from -10 to 25 degrees of elevation, in a room or in none; they move as the embedded source does and,
with ``--mocap``, half of them as BVH files do; and as many frames of people in homes (``depth-pose simulate
--room --home``) before every sensor. The pipeline runs over them as it is. Prints the figures of
`depth_pose.recover.confidence` (the probability that a joint lies within 10 cm; logistic regression), their
calibration on the simulated clips, separately for joints that are seen, hidden and outside the image, and,
with ``--check``, on recordings with known joints, which the fit does not use. The plot shows the confidence
against the share that is right, as the package states it now; and the skeletons' own confidence against the
share of frames whose mean error is below 10 cm.

With ``--rooms`` several people walk about in furnished rooms (``depth-pose simulate --room``). Prints the
figures of a skeleton's confidence: the probability that its seen joints are within 10 cm, on average, of
those of a person. It is fitted to every other clip, of rooms and of one person each, and checked on the rest.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from command_line import make_parser

from depth_pose.bank import Bank, default_bank_path
from depth_pose.core.frame import DepthFrame
from depth_pose.core.odds import logistic
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import JOINT_NODES, JOINTS, JointState, Source
from depth_pose.evaluate.truth import load_truth
from depth_pose.io.mcap_read import DepthReader
from depth_pose.motion.procedural.generator import CLIPS
from depth_pose.pipeline import FrameResult, PosePipeline
from depth_pose.recover.confidence import (
    KINDS,
    SCORE,
    SIGNS,
    SKELETON_SIGNS,
    joints_that_count,
    measure_joint_signs,
    skeleton_signs,
)
from depth_pose.sim.clips import RoomClip, sample_clip
from depth_pose.sim.config import Room
from depth_pose.sim.motion import load_motion
from depth_pose.sim.sensor import SENSORS
from depth_pose.sim.simulate import Stage, simulate
from parts.random_people import aimed, person_of

RIGHT_M = 0.1
"""A joint, or a skeleton on average, that is nearer than this to the truth is right."""
NOBODY_M = 0.4
"""A skeleton farther than this from every person is false, metres. Set by hand."""
ANOTHER_M = 0.5
"""Measured joints farther than this from every person, on average, show none of them. Set by hand."""
_TRUST = 0.9
"""Factor on the confidence of recovered joints (`depth_pose.recover.recover`)."""

_SEEDS, _FIRST_CLIPS, _FRAMES = (4207, 9311), 12, 40
"""Seeds of the first clips and of all others, number of the first ones, and their length."""

FIXED = ("in free space", "before the surface", "behind the surface")
"""Features that are not fitted: they are rare, and were fitted to sixty clips without proposals."""

HOME_MODELS = ("oak_d", "d435", "zed", "xtion", "azure_kinect")
"""Sensors in homes."""
HOME_FRAMES, HOME_FPS, HOME_WIDTH_PX, HOME_PEOPLE = 30, 15.0, 320, 2
"""Recordings of homes."""

_BINS = np.linspace(0, 1, 11)
"""Edges of the confidence bins."""


@dataclass(frozen=True)
class Answers:
    """Results, one row per frame.

    Attributes
    ----------
    right : (F, 19) bool
        Joint within 10 cm.
    stated : (F, 19)
        The joints' confidence.
    design : (F, 19, 25)
        What the confidence is made from: kind of joint, signs, score.
    frame_right, frame_stated : (F,)
        Mean error of the joints seen below 10 cm; the skeleton's confidence.
    recovered : (F,) bool
    states : (F, 19) uint8
        `depth_pose.core.skeleton.JointState`.
    """

    right: np.ndarray
    stated: np.ndarray
    design: np.ndarray
    frame_right: np.ndarray
    frame_stated: np.ndarray
    recovered: np.ndarray
    states: np.ndarray


def simulated(folder: Path, clips: int, captures: list[Path]) -> Iterator[Path]:
    """Simulate people, views, sensors and motions drawn at random."""
    names = sorted(CLIPS)
    for k in range(clips):
        seed, number = (_SEEDS[0], k) if k < _FIRST_CLIPS else (_SEEDS[1], k - _FIRST_CLIPS)
        rng = np.random.default_rng([seed, number])
        build = rng.uniform(-1.0, 1.0, 8)
        person = person_of(1.65 + 0.27 * build[0], build[1:])
        sensor = SENSORS["structured" if number % 4 == 3 else "tof"]
        noise, much = sensor.noise, float(2.0 ** rng.uniform(-1.0, 1.0))
        noise = replace(
            noise,
            constant=noise.constant * much,
            quadratic=noise.quadratic * much,
            flying=min(1.0, noise.flying * much),
            dropout=noise.dropout * much,
        )
        elevation, distance = rng.uniform(-10, 25), rng.uniform(1.5, 4.0)
        around = 180 if number % 2 else 60
        place = aimed(distance, elevation, rng.uniform(-around, around))
        motion = names[rng.integers(len(names))]
        if captures and (number // 4) % 2:
            motion = str(captures[rng.integers(len(captures))])
        clip = load_motion(motion, sensor.fps, _FRAMES / sensor.fps, seed=13 * seed + number)
        room = Room() if rng.random() < 0.5 else Room(floor=False, wall=0.0)
        path = folder / f"{k}.mcap"
        stage = Stage(replace(sensor, noise=noise), place, room)
        simulate(path, person.body(), clip, stage, seed=seed + number)
        yield path
        path.unlink()


def homes(clips: int) -> Iterator[tuple[list[DepthFrame], np.ndarray]]:
    """Simulate people in homes: frames, and joints (T, P, 19, 3)."""
    for k in range(clips):
        rng, model = np.random.default_rng([_SEEDS[1], 1, k]), HOME_MODELS[k % len(HOME_MODELS)]
        clip = sample_clip(rng, HOME_FRAMES, HOME_FPS, HOME_PEOPLE, HOME_WIDTH_PX, model=model, home=True)
        yield _frames_of(clip), clip.joints


def _frames_of(clip: RoomClip) -> list[DepthFrame]:
    frames = zip(clip.stamps_ns, clip.depth, strict=True)
    return [DepthFrame(int(stamp), "", depth, clip.camera) for stamp, depth in frames]


def measure_recording(pipeline: PosePipeline, path: Path) -> Answers:
    """Run over one recording with a truth file."""
    truth, frames = load_truth(path.with_suffix(".npz")), list(DepthReader(path))
    nearest = [int(np.argmin(np.abs(truth.stamps_ns - frame.stamp_ns))) for frame in frames]
    return measure(pipeline, frames, truth.joints[nearest, None])


def measure(pipeline: PosePipeline, frames: Iterable[DepthFrame], joints: np.ndarray) -> Answers:
    """Run over frames with known joints (T, P, 19, 3); leave out whose measured joints are far off."""
    kinds = np.array([[name.split("_")[-1] == kind for kind in KINDS] for name in JOINTS], float)
    rows: list[tuple[np.ndarray | float | bool, ...]] = []
    pipeline.reset()
    for frame, known in zip(frames, joints, strict=True):
        result = pipeline.process_frame(frame)
        people = {person.body_id: person for person in result.people.persons}
        scores = {fitted.body_id: fitted.score for fitted in result.refined}
        for skeleton in result.skeletons:
            person = people[skeleton.body_id]
            assert person.measured is not None, "the default method measures joints"
            away = np.linalg.norm(person.measured.places - known, axis=2).mean(axis=1)
            if away.min(initial=np.inf) > ANOTHER_M:
                continue
            error = np.linalg.norm(skeleton.positions - known[int(np.argmin(away))], axis=1)
            signs = measure_joint_signs(skeleton.positions, skeleton.scale, person).signs
            score = np.full((len(JOINTS), 1), scores[skeleton.body_id])
            design = np.concatenate([kinds, signs, score], axis=1)
            of_seen = error[joints_that_count(skeleton.joint_states)].mean()
            rows.append(
                (error < RIGHT_M, skeleton.joint_confidence, design, of_seen < RIGHT_M,
                 skeleton.confidence, skeleton.source == Source.RECOVERED, skeleton.joint_states)
            )  # fmt: skip
    return Answers(*(np.array(column) for column in zip(*rows, strict=True))) if rows else _nothing()


@dataclass(frozen=True)
class RoomAnswers:
    """Skeletons in rooms, one row each: features of their confidence, and whether they were right.

    Attributes
    ----------
    design : (S, 4)
        `depth_pose.recover.confidence.skeleton_signs`.
    stated : (S,)
    right : (S,) bool
        Mean error of the seen joints, relative to the nearest person, below 10 cm.
    nobody : (S,) bool
        Farther than 40 cm, on average, from every person.
    clip : (S,) int
    """

    design: np.ndarray
    stated: np.ndarray
    right: np.ndarray
    nobody: np.ndarray
    clip: np.ndarray


def measure_rooms(pipeline: PosePipeline, clips: int) -> RoomAnswers:
    """Run over random rooms, and over as many clips of one person as `simulated` makes."""
    rows: list[tuple[np.ndarray, float, bool, bool, int]] = []
    for k in range(clips):
        rng = np.random.default_rng([11, k])
        clip = sample_clip(rng, frames=45, people=1 + k % 4, home=bool(k % 2))
        rows += _rows(pipeline, _frames_of(clip), clip.joints, k)
        print(f"\r{k + 1} of {clips} rooms", end="", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        for k, path in enumerate(simulated(Path(folder), clips, [])):
            truth = load_truth(path.with_suffix(".npz"))
            rows += _rows(pipeline, DepthReader(path), truth.joints[:, None], k)
            print(f"\r{k + 1} of {clips} clips of one", end="", flush=True)
    print()
    return RoomAnswers(*(np.array(column) for column in zip(*rows, strict=True)))


def _rows(
    pipeline: PosePipeline, frames: Iterable[DepthFrame], joints: np.ndarray, clip: int
) -> Iterator[tuple[np.ndarray, float, bool, bool, int]]:
    """Run over one clip with known joints (T, P, 19, 3)."""
    pipeline.reset()
    for frame, known in zip(frames, joints, strict=True):
        for skeleton, signs in _with_signs(pipeline.process_frame(frame)):
            errors = np.linalg.norm(skeleton.positions - known, axis=2)
            error = errors[:, joints_that_count(skeleton.joint_states)].mean(axis=1).min(initial=np.inf)
            yield signs, skeleton.confidence, error < RIGHT_M, error > NOBODY_M, clip


def _with_signs(result: FrameResult) -> Iterator[tuple[Skeleton, np.ndarray]]:
    """Yield the refined skeletons of a frame with the features of their confidence."""
    people = {p.body_id: p for p in result.people.persons}
    for fitted in result.refined:
        for skeleton in result.skeletons:
            if skeleton.body_id == fitted.body_id and skeleton.source == Source.REFINED:
                joints = fitted.body.nodes[JOINT_NODES]
                parts = joints, skeleton.joint_states, skeleton.joint_confidence
                yield skeleton, skeleton_signs(people[skeleton.body_id], *parts)


def report_rooms(answers: RoomAnswers) -> None:
    """Fit to every other clip, and report the calibration of the fit and of the package on the rest."""
    learned = answers.clip % 2 == 0
    weights = regress(answers.design[learned], answers.right[learned])
    for name, value in zip(SKELETON_SIGNS, weights, strict=True):
        print(f'    "{name}": {value:.2f},')
    fitted = logistic(answers.design @ weights)
    rest = ~learned
    for name, stated in (("as stated", answers.stated), ("fitted now", fitted)):
        error = calibration_error(binned(stated[rest], answers.right[rest]))
        sure = float((stated[rest & answers.nobody] > 0.5).sum() / rest.sum())
        print(
            f"    skeletons, {name}: {rest.sum()}, says {stated[rest].mean():.3f}, "
            f"is {answers.right[rest].mean():.3f}, calibration error {error:.3f}, "
            f"area under the curve {area(stated[rest], answers.right[rest]):.3f}; "
            f"on nobody and surer than .5: {sure:.3f}"
        )


def _nothing() -> Answers:
    joints, width = len(JOINTS), len(KINDS) + len(SIGNS) + 1
    return Answers(
        np.zeros((0, joints), bool), np.zeros((0, joints)), np.zeros((0, joints, width)),
        np.zeros(0, bool), np.zeros(0), np.zeros(0, bool), np.zeros((0, joints), np.uint8),
    )  # fmt: skip


def join(parts: list[Answers]) -> Answers:
    """Concatenate recordings."""
    return Answers(*(np.concatenate([getattr(p, f) for p in parts]) for f in Answers.__dataclass_fields__))


def fit(answers: Answers, weights: np.ndarray) -> np.ndarray:
    """Fit the kinds and all features but `FIXED`, whose coefficients are those of the package.

    Uses frames that needed no recovery; ``weights`` (F,) of the frames.
    """
    names = [*KINDS, *SIGNS, "score"]
    now = np.array([*KINDS.values(), *SIGNS.values(), SCORE])
    chosen = ~answers.recovered
    design = answers.design[chosen].reshape(-1, len(names))
    moves = np.eye(len(names))[:, [n not in FIXED for n in names]]
    weight = np.repeat(weights[chosen], len(JOINTS))
    change = regress(design @ moves, answers.right[chosen].ravel(), design @ now, weight)
    return now + moves @ change


def regress(
    design: np.ndarray, right: np.ndarray, known: np.ndarray | float = 0.0, weight: np.ndarray | float = 1.0
) -> np.ndarray:
    """Weighted logistic regression by Newton's method, with a weak pull to 0; adds ``known`` log-odds."""
    weights = np.zeros(design.shape[1])
    for _ in range(60):
        p = logistic(known + design @ weights)
        hessian = design.T @ (design * (weight * p * (1 - p))[:, None]) + np.eye(len(weights))
        weights += np.clip(np.linalg.solve(hessian, design.T @ (weight * (right - p)) - weights), -1.0, 1.0)
    return weights


def binned(stated: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Mean stated confidence, share that is right, and count, in tenths of the confidence."""
    stated, right = np.ravel(stated), np.ravel(right)
    place = np.clip(np.digitize(stated, _BINS) - 1, 0, len(_BINS) - 2)
    return np.array(
        [(stated[m].mean(), right[m].mean(), m.sum()) for k in range(10) if (m := place == k).any()]
    )


def calibration_error(bins: np.ndarray) -> float:
    """Expected calibration error: mean gap between stated and true, weighted by count."""
    return float(np.average(np.abs(bins[:, 0] - bins[:, 1]), weights=bins[:, 2]))


def area(stated: np.ndarray, right: np.ndarray) -> float:
    """Probability that a right one has a higher confidence than a wrong one (area under the curve)."""
    stated, right = np.ravel(stated), np.ravel(right)
    ranks = np.argsort(np.argsort(stated))
    count = int(right.sum())
    wrong = max(len(right) - count, 1)
    return float((ranks[right].sum() - count * (count - 1) / 2) / (max(count, 1) * wrong))


def report(label: str, answers: Answers, weights: np.ndarray) -> None:
    """Print how good the stated and the newly fitted confidence are."""
    trust = np.where(answers.recovered, _TRUST, 1.0)[:, None]
    fitted = trust / (1 + np.exp(-answers.design @ weights))
    seen = answers.states == JointState.SEEN
    print(f"{label}: {len(answers.right)} frames, {answers.right.mean():.3f} of the joints within 10 cm")
    for name, stated, right in (
        ("joints, as stated", answers.stated, answers.right),
        ("joints, fitted now", fitted, answers.right),
        *(
            (
                f"{name}, {which}",
                confidence[chosen],
                answers.right[chosen],
            )
            for name, confidence in (("stated", answers.stated), ("fitted", fitted))
            for which, chosen in (
                ("seen", seen),
                ("hidden", answers.states == JointState.OCCLUDED),
                ("outside", answers.states == JointState.OUTSIDE_IMAGE),
                ("hidden or outside", ~seen),
            )
        ),
        ("recovered joints, as stated", answers.stated[answers.recovered], answers.right[answers.recovered]),
        ("skeletons, as stated", answers.frame_stated, answers.frame_right),
    ):
        if stated.size:
            error = calibration_error(binned(stated, right))
            print(
                f"    {name:28s} says {stated.mean():.3f}, is {right.mean():.3f}, "
                f"calibration error {error:.3f}, area under the curve {area(stated, right):.3f}"
            )


def draw(measured: dict[str, Answers], path: Path) -> None:
    """Draw the reliability of joints and of skeletons, and how often each confidence is stated."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 5.6), layout="constrained")
    axes = figure.subplots(2, 2, height_ratios=[3, 1], sharex=True)
    for column, (title, stated, right) in enumerate(
        (
            ("joints: within 10 cm", "stated", "right"),
            ("skeletons: seen joints within 10 cm", "frame_stated", "frame_right"),
        )
    ):
        top, bottom = axes[:, column]
        top.plot([0, 1], [0, 1], color="0.7", zorder=0)
        for k, (label, answers) in enumerate(measured.items()):
            bins = binned(getattr(answers, stated), getattr(answers, right))
            known = bins[bins[:, 2] >= 15]
            top.plot(known[:, 0], known[:, 1], "o-", label=f"{label}: error {calibration_error(bins):.3f}")
            shares = np.histogram(np.ravel(getattr(answers, stated)), _BINS)[0]
            bottom.bar(_BINS[:-1] + 0.03 + 0.04 * k, shares / shares.sum(), 0.04)
        top.set(title=title, ylabel="share that is right", xlim=(0, 1), ylim=(0, 1.02))
        top.legend(loc="upper left", fontsize=8)
        bottom.set(xlabel="stated confidence", ylabel="share stated", ylim=(0, 1))
        for axis in (top, bottom):
            axis.grid(alpha=0.3)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Simulate, fit, report and draw."""
    parser = make_parser(__doc__)
    parser.add_argument("--bank", type=Path, help="exemplar bank; the set-up's by default")
    parser.add_argument("--clips", type=int, default=104)
    parser.add_argument("--mocap", type=Path, help="BVH files; half of the clips move as one of them")
    parser.add_argument("--rooms", type=int, help="only the skeletons' confidence, in this many rooms")
    parser.add_argument("--check", type=Path, help="recordings with truth files")
    parser.add_argument("-o", "--output", type=Path, default=Path("reliability.png"))
    arguments = parser.parse_args()
    checked = sorted(arguments.check.glob("*.mcap")) if arguments.check else []
    checked = [path for path in checked if path.with_suffix(".npz").exists()]
    if arguments.check and not checked:
        parser.error(f"--check {arguments.check}: no NAME.mcap with its truth NAME.npz in this folder")
    bank = Bank.load(arguments.bank or default_bank_path())
    pipeline = PosePipeline(bank)
    pipeline.warm_up()
    if arguments.rooms:
        report_rooms(measure_rooms(pipeline, arguments.rooms))
        return
    captures = sorted(arguments.mocap.rglob("*.bvh")) if arguments.mocap else []
    parts = []
    with tempfile.TemporaryDirectory() as folder:
        for path in simulated(Path(folder), arguments.clips, captures):
            parts.append(measure_recording(pipeline, path))
            print(f"\r{len(parts)} of {arguments.clips} clips", end="", flush=True)
    at_home = []
    for frames, joints in homes(arguments.clips):
        at_home.append(measure(pipeline, frames, joints))
        print(f"\r{len(at_home)} of {arguments.clips} homes ", end="", flush=True)
    print()
    measured = {"simulated": join(parts), "homes": join(at_home)}
    both = join(list(measured.values()))
    counts = [len(one.right) for one in measured.values()]
    weights = fit(both, np.repeat(0.5 * sum(counts) / np.array(counts), counts))
    if checked:
        measured["recordings"] = join([measure_recording(pipeline, path) for path in checked])
    for name, value in zip([*KINDS, *SIGNS, "score"], weights, strict=True):
        print(f'    "{name}": {value:.2f},')
    for label, answers in measured.items():
        report(label, answers, weights)
    draw(measured, arguments.output)
