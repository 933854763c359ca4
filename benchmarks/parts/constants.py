"""Constants: each one of the method halved and doubled, and what that changes.

    python benchmarks/accuracy.py constants DATA --frames 20
    python benchmarks/accuracy.py constants DATA DATA2 --only track detect.background

DATA are folders of recordings with truth files, of one person or of several. Every number of
`depth_pose.tuning.Tuning`, and every number in a module of detect, track, denoise, match, refine and
recover that is no kernel and no index, alone or in a short table, is a row: the change of the mean joint
error (mm), of the share of joints within 10 cm (whoever is not found misses all), of the numbers of false
people and of changes of id, and of the processor time of a frame (ms), for half and for double. "same" is a
run whose skeletons are equal bit for bit. For the stages after detection, detection runs once.

    python benchmarks/accuracy.py constants DATA --compiled --only refine._score_kernels

Numbers that kernels have compiled in: each value in a process with compilations of its own, which takes
minutes.
"""

from __future__ import annotations

import ast
import inspect
import os
import pkgutil
import re
import subprocess
import sys
import time
from argparse import Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any

import numpy as np
from command_line import make_parser

from depth_pose.bank import Bank, default_bank_path
from depth_pose.core.config import PipelineConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.evaluate.score_people import match_people, score_matches
from depth_pose.evaluate.truth import KnownPeople, load_known_people
from depth_pose.io.mcap_read import DepthReader
from depth_pose.pipeline import PosePipeline
from depth_pose.track.person_view import FramePeople
from depth_pose.tuning import Tuning
from parts.changed_constant.factors import FACTORS, environment, times

FIRST, LATER = ("detect", "track", "denoise"), ("match", "refine", "recover")
"""Folders of the stage that finds people, and of those after it."""

_TOLD = "{} mm, {} within 10 cm, {} false, {} changes of id, {} ms a frame"

_TABLE = 100
"""Arrays of so many numbers are tables that are computed."""


class Clip:
    """The first frames of a recording with their truth, and the people found in them."""

    def __init__(self, path: Path, most: int) -> None:
        self.frames: list[DepthFrame] = [f for _, f in zip(range(most), DepthReader(path), strict=False)]
        truth = load_known_people(path.with_suffix(".npz"))
        stamps_ns = [f.stamp_ns for f in self.frames]
        rows = [int(np.argmin(np.abs(truth.stamps_ns - stamp_ns))) for stamp_ns in stamps_ns]
        self.truth = KnownPeople(
            truth.joints[rows], truth.names, np.array(stamps_ns), truth.visible[rows], truth.is_room
        )
        self.people: list[FramePeople] = []

    def perceive(self, pipeline: PosePipeline) -> None:
        """Find the people once, for all runs that change only later stages."""
        pipeline.restart()
        self.people = [pipeline.perception.perceive(frame) for frame in self.frames]


def tuned() -> Iterator[tuple[str, str, str, float]]:
    """Give the numbers of the tuning: name, stage, field and value."""
    for stage, values in Tuning()._asdict().items():
        for field, value in values._asdict().items():
            if type(value) in (int, float) and value:
                yield f"{stage}.{field}", stage, field, value


def constants(
    folders: tuple[str, ...] = FIRST + LATER, *, compiled: bool = False
) -> Iterator[tuple[str, ModuleType, str, float]]:
    """Give the numbers that modules, or kernels, define: name, module, variable and value."""
    for folder in folders:
        package = import_module(f"depth_pose.{folder}")
        for found in pkgutil.iter_modules(package.__path__):
            if found.name.endswith("kernels") is compiled:
                module = import_module(f"depth_pose.{folder}.{found.name}")
                for name in defined(module):
                    value = getattr(module, name)
                    if name.isupper() and is_number(value):
                        yield f"{folder}.{found.name}.{name}", module, name, value


def is_number(value: object) -> bool:
    """Check that a value can be halved and doubled: a number other than 0, or a few of them, named or not."""
    match value:
        case tuple():
            return any(map(is_number, value))
        case dict():
            return is_number(tuple(value.values()))
        case np.ndarray():
            return value.dtype.kind == "f" and 0 < value.size < _TABLE
        case _:
            return type(value) in (int, float, np.float32, np.float64) and bool(value)


def defined(module: ModuleType) -> Iterator[str]:
    """Give the variables that a module itself assigns, without indices: imported ones may size arrays."""
    tree = ast.parse(inspect.getsource(module))
    places = [node.slice for node in ast.walk(tree) if isinstance(node, ast.Subscript)]
    places += [part for place in places if isinstance(place, ast.Tuple) for part in place.elts]
    indices = {place.id for place in places if isinstance(place, ast.Name)}
    for statement in tree.body:
        if isinstance(statement, ast.Assign | ast.AnnAssign):
            targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
            for name in ast.walk(ast.Tuple(targets)):
                if isinstance(name, ast.Name) and name.id not in indices:
                    yield name.id


@contextmanager
def changed(module: ModuleType, name: str, value: float) -> Iterator[None]:
    """Give a module's variable another value for a while."""
    before = getattr(module, name)
    setattr(module, name, value)
    try:
        yield
    finally:
        setattr(module, name, before)


def run(pipeline: PosePipeline, clips: list[Clip], *, whole: bool) -> tuple[np.ndarray, str]:
    """Return error (mm), share within 10 cm, false people, changes of id, a frame's ms; and a digest."""
    matches, seconds, count, digest = [], 0.0, 0, sha256()
    for clip in clips:
        pipeline.restart()
        answers = {}
        for frame, people in zip(clip.frames, clip.people, strict=True):
            start = time.process_time()
            if whole:
                result = pipeline.process_frame(frame)
            else:
                result = pipeline.answer(replace(people, persons=tuple(replace(p) for p in people.persons)))
            seconds += time.process_time() - start
            answers[frame.stamp_ns] = result.skeletons
            for skeleton in result.skeletons:
                digest.update(f"{skeleton.body_id} {skeleton.confidence}".encode())
                digest.update(skeleton.positions.tobytes())
        matches.append(match_people(clip.truth, answers))
        count += len(clip.frames)
    score = score_matches(matches)
    numbers = [score.mean_error_mm, score.pck10, score.false, score.switches, 1e3 * seconds / count]
    return np.array(numbers), digest.hexdigest()


def compiled_anew(arguments: Namespace, name: str, factor: float) -> np.ndarray:
    """Return what `run` does, of a process whose kernels have another value of a constant compiled in."""
    program = Path(__file__).resolve().parents[1] / "accuracy.py"
    command = [sys.executable, program, "constants", *arguments.data, "--frames", arguments.frames]
    module, _, variable = name.rpartition(".")
    with TemporaryDirectory() as folder:
        added = environment(f"{module}:{variable}", factor) | {"NUMBA_CACHE_DIR": folder}
        ended = subprocess.run(
            [*map(str, command), "--only", "nothing"],
            env=os.environ | added,
            capture_output=True,
            text=True,
        )
    found = re.match(_TOLD.replace("{}", r"(\S+)"), ended.stdout)
    if found is None:
        raise ValueError(ended.stderr.strip().rpartition("\n")[2])
    return np.array(found.groups(), float)


def sweep_compiled(arguments: Namespace) -> None:
    """Report what numbers in kernels change."""
    print("| | value | half: mm | within 10 cm | false | ids | ms | double: | | | | |\n|" + "---|" * 12)
    base: np.ndarray | None = None

    def change(name: str, factor: float) -> str:
        try:
            mm, share, false, switches, ms = compiled_anew(arguments, name, factor) - base
        except ValueError as error:
            return f"failed: {error} | | | |"
        return f"{mm:+.1f} | {share:+.3f} | {false:+.0f} | {switches:+.0f} | {ms:+.1f}"

    for name, _, _, value in constants(compiled=True):
        if name.startswith(tuple(arguments.only)):
            base = compiled_anew(arguments, name, 1.0) if base is None else base
            told = " | ".join(change(name, factor) for factor in FACTORS)
            print(f"| {name} | {shown(value)} | {told} |", flush=True)


def main() -> None:
    """Run and report."""
    parser = make_parser(__doc__)
    parser.add_argument("data", type=Path, nargs="+", help="folders of NAME.mcap with NAME.npz")
    parser.add_argument("--frames", type=int, default=20, help="of each recording, from its beginning")
    parser.add_argument("--only", nargs="*", default=[""], help="beginnings of names")
    parser.add_argument("--compiled", action="store_true", help="the numbers of kernels")
    arguments = parser.parse_args()
    if arguments.compiled:
        sweep_compiled(arguments)
        return
    bank = Bank.load(default_bank_path())
    pipeline = PosePipeline(bank)
    pipeline.warm_up()
    recordings = [p for folder in arguments.data for p in sorted(folder.glob("*.mcap"))]
    paths = [p for p in recordings if p.with_suffix(".npz").exists()]
    clips = [Clip(path, arguments.frames) for path in paths]
    for clip in clips:
        clip.perceive(pipeline)
    base = {whole: run(pipeline, clips, whole=whole) for whole in (True, False)}
    numbers = (f"{value:.{digits}f}" for value, digits in zip(base[True][0], (1, 3, 0, 0, 1), strict=True))
    print(_TOLD.format(*numbers) + "; half, double:")
    columns = "mm | within 10 cm | false | ids | ms |"
    print(f"| | value | {columns} {columns}\n|{'---|' * 12}")

    def change(pipeline: PosePipeline, *, whole: bool) -> str:
        try:
            numbers, digest = run(pipeline, clips, whole=whole)
        except (ValueError, IndexError) as error:
            return f"out of range: {error} | | | |"
        mm, share, false, switches, ms = numbers - base[whole][0]
        if digest == base[whole][1]:
            return f"same | | | | {ms:+.1f}"
        return f"{mm:+.1f} | {share:+.3f} | {false:+.0f} | {switches:+.0f} | {ms:+.1f}"

    def report(name: str, value: float, changing: Iterator[PosePipeline]) -> None:
        told = [change(pipeline, whole=name.startswith(FIRST)) for pipeline in changing]
        print(f"| {name} | {shown(value)} | {' | '.join(told)} |", flush=True)

    def is_asked(name: str) -> bool:
        return name.startswith(tuple(arguments.only))

    for name, stage, field, value in tuned():
        if is_asked(name):
            report(name, value, retuned(bank, stage, field, value))
    for name, module, variable, value in constants():
        if is_asked(name):
            report(name, value, rebuilt(bank, module, variable, value))


def retuned(bank: Bank, stage: str, field: str, value: float) -> Iterator[PosePipeline]:
    """Give a pipeline with half of a number of the tuning, and one with twice the number."""
    for factor in FACTORS:
        values = getattr(Tuning(), stage)._replace(**{field: times(value, factor)})
        yield PosePipeline(bank, PipelineConfig(), Tuning()._replace(**{stage: values}))


def rebuilt(bank: Bank, module: ModuleType, variable: str, value: float) -> Iterator[PosePipeline]:
    """Give a pipeline while a module's number is half, and one while it is double."""
    for factor in FACTORS:
        with changed(module, variable, times(value, factor)):
            yield PosePipeline(bank)


def shown(value: Any) -> str:
    """Return a number, or the first of a few of them, for a table."""
    match value:
        case tuple() | np.ndarray():
            return f"{shown(next(filter(is_number, value)))}, ..."
        case dict():
            return f"{shown(next(filter(is_number, value.values())))}, ..."
        case _:
            return f"{value:g}"
