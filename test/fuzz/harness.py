"""Feed damaged inputs to what reads files and messages: an answer or a clean error, soon, in little memory.

    python test/fuzz/harness.py                        # 10,000 inputs a decoder, all decoders
    python test/fuzz/harness.py mcap image --count 500 --seed 7 --keep crashes/

Decoders are in the files ``decoders_*.py`` beside this one, each with a tuple ``DECODERS``. Inputs are seeds
that the decoder's file makes, changed by a few mutations; number and seed give the same input again. Each
decoder is run in a process of its own, with a limit on its memory; a watchdog ends it where one input takes
too long, also within compiled code.
"""

from __future__ import annotations

import argparse
import contextlib
import faulthandler
import importlib.util
import json
import logging
import os
import resource
import signal
import struct
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
SOURCE = HERE.parents[1] / "src"
sys.path[:0] = [str(HERE), *([] if str(SOURCE) in sys.path else [str(SOURCE)])]

from depth_pose.core.errors import DepthPoseError  # noqa: E402

COUNT = 10_000
"""Inputs of each decoder, unless told otherwise."""

LIMIT_S = 5.0
"""Longest that one input may take, seconds of processor time: a hundred times what a good one takes."""

_STUCK_S = 300.0
"""Seconds by the clock after which an input hangs: one that waits takes no processor time, but a machine that
stands still for a while proves nothing."""

LIMIT_MB = 768
"""Memory that a decoder may take beyond what it has once it read its seeds, MB."""

_MOST_TOLD = 5


@dataclass(frozen=True)
class Decoder:
    """What is attacked.

    Attributes
    ----------
    name : str
    seeds : callable
        Makes the good inputs, of which all others are made.
    decode : callable
        Reads one. For files see `from_file`.
    errors : tuple of types
        What it may raise.
    """

    name: str
    seeds: Callable[[], Sequence[bytes]]
    decode: Callable[[bytes], object]
    errors: tuple[type[Exception], ...] = (DepthPoseError,)


def from_file(read: Callable[[Path], object], name: str = "input") -> Callable[[bytes], object]:
    """Make a decoder of what reads a file: the input is written to a file of this name."""

    def decode(data: bytes) -> object:
        path = Path(tempfile.gettempdir()) / f"fuzz_{os.getpid()}" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
        return read(path)

    return decode


@dataclass
class Outcome:
    """What came of a decoder's inputs.

    Attributes
    ----------
    inputs : int
        Inputs that were tried.
    answers : int
        Those that were read in spite of all.
    clean_errors : int
        Those refused with an error that is ours.
    slowest_ms : float
        The longest that one took, milliseconds.
    memory_mb : float
        The most memory taken beyond what the seeds take, MB.
    crashes : Counter of str
        Anything else: unexpected exceptions by type and place, hangs, dead processes.
    examples : dict of str to int
        For each of these, the number of an input that shows it.
    """

    inputs: int = 0
    answers: int = 0
    clean_errors: int = 0
    slowest_ms: float = 0.0
    memory_mb: float = 0.0
    crashes: Counter[str] = field(default_factory=Counter)
    examples: dict[str, int] = field(default_factory=dict)


# What an input is


def make_input(seeds: Sequence[bytes], seed: int, number: int) -> bytes:
    """Make one input: a seed with one to four mutations."""
    rng = np.random.default_rng([seed, number])
    data = bytearray(seeds[int(rng.integers(len(seeds)))])
    for _ in range(int(rng.integers(1, 5))):
        if data:
            MUTATIONS[int(rng.integers(len(MUTATIONS)))](data, rng, seeds)
    return bytes(data)


def _place(data: bytearray, rng: np.random.Generator) -> int:
    """Choose a place: half the time among the first 200 bytes, or the last, where headers and indexes are."""
    near = int(rng.integers(min(200, len(data))))
    return (near, len(data) - 1 - near, *rng.integers(len(data), size=2).tolist())[int(rng.integers(4))]


def _flip(data: bytearray, rng: np.random.Generator, _: Sequence[bytes]) -> None:
    data[_place(data, rng)] ^= 1 << int(rng.integers(8))


def _byte(data: bytearray, rng: np.random.Generator, _: Sequence[bytes]) -> None:
    data[_place(data, rng)] = int(rng.choice([0, 1, 0x7F, 0x80, 0xFF, int(rng.integers(256))]))


_INTEGERS = (0, 1, 2, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 1 << 24, (1 << 31) - 1, 1 << 31, (1 << 32) - 1)


def _integer(data: bytearray, rng: np.random.Generator, _: Sequence[bytes]) -> None:
    """Write a number of 4 bytes where one may be: lengths, sizes, offsets."""
    value = int(rng.choice(_INTEGERS)) if rng.random() < 0.8 else len(data)
    packed = struct.pack("<I" if rng.random() < 0.8 else ">I", value & 0xFFFFFFFF)
    _overwrite(data, _place(data, rng), packed)


def _long(data: bytearray, rng: np.random.Generator, _: Sequence[bytes]) -> None:
    value = int(rng.choice([0, 1, (1 << 31), (1 << 32) + 1, (1 << 40), (1 << 63) - 1]))
    _overwrite(data, _place(data, rng), struct.pack("<Q", value))


def _float(data: bytearray, rng: np.random.Generator, _: Sequence[bytes]) -> None:
    value = float(rng.choice([0.0, -1.0, 1e-310, 5e-324, 1e300, np.inf, -np.inf, np.nan, 1e9]))
    packed = (
        struct.pack("<d", value) if rng.random() < 0.5 else np.float32(np.clip(value, -3e38, 3e38)).tobytes()
    )
    _overwrite(data, _place(data, rng) & ~3, packed)


def _overwrite(data: bytearray, at: int, new: bytes) -> None:
    new = new[: len(data) - at]
    data[at : at + len(new)] = new


def _cut(data: bytearray, rng: np.random.Generator, _: Sequence[bytes]) -> None:
    del data[_place(data, rng) :]


def _drop(data: bytearray, rng: np.random.Generator, _: Sequence[bytes]) -> None:
    at = _place(data, rng)
    del data[at : at + int(rng.integers(1, 33))]


def _repeat(data: bytearray, rng: np.random.Generator, _: Sequence[bytes]) -> None:
    at = _place(data, rng)
    piece = bytes(data[at : at + int(rng.integers(1, 257))])
    data[at:at] = piece * int(rng.integers(1, 9))


def _insert(data: bytearray, rng: np.random.Generator, _: Sequence[bytes]) -> None:
    at = _place(data, rng)
    data[at:at] = rng.bytes(int(rng.integers(1, 17)))


def _noise(data: bytearray, rng: np.random.Generator, _: Sequence[bytes]) -> None:
    _overwrite(data, _place(data, rng), rng.bytes(int(rng.integers(1, 65))))


def _splice(data: bytearray, rng: np.random.Generator, seeds: Sequence[bytes]) -> None:
    other = seeds[int(rng.integers(len(seeds)))]
    if other:
        data[_place(data, rng) :] = other[int(rng.integers(len(other))) :]


MUTATIONS = (
    _flip,
    _flip,
    _byte,
    _integer,
    _integer,
    _long,
    _float,
    _cut,
    _drop,
    _repeat,
    _insert,
    _noise,
    _splice,
)


# Running, in the child


def _attack(decoder: Decoder, count: int, seed: int, report: Path, keep: Path | None) -> None:
    """Try a decoder's inputs; writes the outcome, and before each input its number, to a file."""
    logging.disable(logging.CRITICAL)
    seeds = list(decoder.seeds())
    for data in seeds:
        decoder.decode(data)  # must be readable; kernels are compiled, libraries loaded
    used = _memory_mb()
    _limit_memory(LIMIT_MB)
    faulthandler.register(signal.SIGPROF, chain=True)  # says where, and ends the process
    outcome = Outcome()
    with report.open("wb", buffering=0) as progress:
        for number in range(count):
            data = make_input(seeds, seed, number)
            progress.seek(0)
            progress.write(struct.pack("<Q", number))
            faulthandler.dump_traceback_later(_STUCK_S, exit=True)
            signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
            start = time.perf_counter()
            crash = _try(decoder, data, outcome)
            outcome.slowest_ms = max(outcome.slowest_ms, 1e3 * (time.perf_counter() - start))
            faulthandler.cancel_dump_traceback_later()
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            outcome.inputs += 1
            if crash is not None:
                _note(outcome, crash, number, data, decoder, keep)
    outcome.memory_mb = _memory_mb() - used
    report.with_suffix(".json").write_text(json.dumps(vars(outcome)))


def _try(decoder: Decoder, data: bytes, outcome: Outcome) -> str | None:
    """Read one input; gives what must not be."""
    try:
        decoder.decode(data)
        outcome.answers += 1
    except decoder.errors:
        outcome.clean_errors += 1
    except Exception as error:
        at = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__} in {Path(at.filename).name}, line {at.lineno}: {str(error)[:80]}"
    return None


def _note(
    outcome: Outcome, crash: str, number: int, data: bytes, decoder: Decoder, keep: Path | None
) -> None:
    outcome.crashes[crash] += 1
    outcome.examples.setdefault(crash, number)
    if keep is not None and outcome.examples[crash] == number:
        keep.mkdir(parents=True, exist_ok=True)
        (keep / f"{decoder.name}_{number}").write_bytes(data)


def _memory_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _limit_memory(more_mb: int) -> None:
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + (more_mb << 20)
    resource.setrlimit(resource.RLIMIT_AS, (limit, resource.RLIM_INFINITY))


# Running, from outside


def find_decoders() -> dict[str, Path]:
    """Find all decoders: their names, each with its file."""
    found: dict[str, Path] = {}
    for file in sorted(HERE.glob("decoders_*.py")):
        for decoder in _load(file):
            assert decoder.name not in found, f"two decoders are called {decoder.name}"
            found[decoder.name] = file
    return found


def _load(file: Path) -> tuple[Decoder, ...]:
    sys.modules.setdefault("harness", sys.modules[__name__])  # one class `Decoder`, also as a script
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[file.stem] = module
    spec.loader.exec_module(module)
    decoders: tuple[Decoder, ...] = module.DECODERS
    return decoders


def attack(
    names: Sequence[str], file: Path, count: int = COUNT, seed: int = 1, keep: Path | None = None
) -> Iterator[tuple[str, Outcome]]:
    """Try the inputs of a file's decoders, each in a process of its own; gives their outcomes."""
    with tempfile.TemporaryDirectory(prefix="fuzz_") as folder:
        command = [sys.executable, __file__, *names, "--child", str(file), "--count", str(count)]
        command += ["--seed", str(seed), "--reports", folder]
        command += ["--keep", str(keep)] if keep else []
        environment = {**os.environ, "TMPDIR": folder, "PYTHONWARNINGS": "ignore"}
        started = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)
        with started as done:
            assert done.stdout is not None
            for line in done.stdout:
                name, code = line.split()
                yield name, _outcome(Path(folder) / name, int(code))
        if done.returncode:
            raise SystemExit(f"{file} cannot be run")


def _outcome(report: Path, code: int) -> Outcome:
    """Read what a decoder's process has left."""
    with contextlib.suppress(OSError):
        found = json.loads(report.with_suffix(".json").read_text())
        return Outcome(**{**found, "crashes": Counter(found["crashes"])})
    said = report.with_suffix(".err").read_text()
    number = struct.unpack("<Q", report.read_bytes())[0] if report.exists() else -1
    last = "\n".join(said.splitlines()[-12:])
    hung = "Timeout" in said or code == -signal.SIGPROF
    why = f"input {number}: it hung" if hung else f"exit code {code}"
    what = f"{why}\n{last}" if number >= 0 else f"its seeds cannot be read\n{last}"
    return Outcome(max(number, 0), crashes=Counter([what]), examples={what: number})


def _be_child(given: argparse.Namespace) -> None:
    """Load a file of decoders once, and fork a process for each; tells which has ended, and how."""
    decoders = {decoder.name: decoder for decoder in _load(given.child)}
    for name in given.names:
        report = given.reports / name
        process = os.fork()
        if not process:
            with report.with_suffix(".err").open("wb") as said:
                os.dup2(said.fileno(), 2)
            try:
                _attack(decoders[name], given.count, given.seed, report, given.keep)
            except BaseException:
                traceback.print_exc()
                os._exit(1)
            os._exit(0)
        print(name, os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]), flush=True)


def rows(names: Sequence[str], count: int, seed: int, keep: Path | None) -> Iterator[tuple[str, Outcome]]:
    """Attack the decoders of these names, or all; gives each one's outcome."""
    found = find_decoders()
    unknown = set(names) - set(found)
    if unknown:
        raise SystemExit(f"there is no decoder {', '.join(sorted(unknown))}; there are {', '.join(found)}")
    wanted = names or list(found)
    for file in dict.fromkeys(found[name] for name in wanted):
        yield from attack([name for name in wanted if found[name] == file], file, count, seed, keep)


def main() -> None:
    """Run from the command line; exit code 1 where anything crashed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="decoders; all by default")
    parser.add_argument("--count", type=int, default=COUNT, help="inputs of each")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for an input of each crash")
    parser.add_argument("--child", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--reports", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        _be_child(given)
        return
    bad = 0
    print("| decoder | inputs | answers | clean errors | crashes | slowest, ms | memory, MB |")
    print("|---|---|---|---|---|---|---|")
    for name, o in rows(given.names, given.count, given.seed, given.keep):
        cells = (name, o.inputs, o.answers, o.clean_errors, o.crashes.total())
        print(f"| {' | '.join(map(str, cells))} | {o.slowest_ms:.0f} | {o.memory_mb:.0f} |", flush=True)
        for crash, number in o.crashes.most_common(_MOST_TOLD):
            print(f"{name}: {number} times, first input {o.examples[crash]}: {crash}", file=sys.stderr)
        bad += o.crashes.total()
    raise SystemExit(1 if bad else 0)


if __name__ == "__main__":
    main()
