"""Generator of recordings' stamps as clocks, drivers and networks spoil them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

START_NS = 1_700_000_000_000_000_000
STEP_NS = 40_000_000
FRAMES = 40


@dataclass(frozen=True)
class StampCase:
    """Frames of a recording in the order in which they were recorded.

    Attributes
    ----------
    name : str
    frames : list of int
        Which frame of the clean recording each is.
    stamps_ns, log_ns : list of int
        Its stamp and log time.
    kept : list of int
        Frames that must come out, in this order.
    says : str
        What must be reported.
    ids : int
        Number of ids of one person.
    """

    name: str
    frames: list[int]
    stamps_ns: list[int]
    log_ns: list[int]
    kept: list[int]
    says: str = ""
    ids: int = 1
    uses_log_times: bool = field(default=False)


def clean() -> tuple[list[int], list[int]]:
    """Frame numbers and stamps of the clean recording."""
    return list(range(FRAMES)), [START_NS + i * STEP_NS for i in range(FRAMES)]


def _log(offset_ns: int = 3_000_000) -> list[int]:
    return [START_NS + i * STEP_NS + offset_ns for i in range(FRAMES)]


def cases(seed: int = 0) -> Iterator[StampCase]:
    """Yield clean, swapped, late, zero, far, silent, jumping, drifting and jittering stamps."""
    rng = np.random.default_rng(seed)
    frames, stamps = clean()
    yield StampCase("clean", frames, stamps, _log(), frames)
    for at in (0, 5, int(rng.integers(8, 30)), FRAMES - 2):
        order = [*frames[:at], at + 1, at, *frames[at + 2 :]]
        yield StampCase(f"pair swapped at {at}", order, [stamps[i] for i in order], _log(), frames, "sorted")
    order = [i + 1 if i % 10 == 4 else i - 1 if i % 10 == 5 else i for i in frames]
    yield StampCase("four pairs swapped", order, [stamps[i] for i in order], _log(), frames, "sorted")
    order = [*frames[:10], 12, 10, 11, *frames[13:]]
    yield StampCase("two places late", order, [stamps[i] for i in order], _log(), frames, "sorted")
    for name, wrong, says in (
        ("100 ms back", -100_000_000, "before that of an earlier"),
        ("400 ms back", -400_000_000, "before that of an earlier"),
        ("3 s back", -3_000_000_000, "does not follow"),
        ("zero", -START_NS, "does not follow"),
        ("1 s ahead", 1_000_000_000, "does not follow"),
        ("an hour ahead", 3_600_000_000_000, "does not follow"),
    ):
        for bad in ([int(rng.integers(5, 35))], [8, 16, 24, 32], [0], [FRAMES - 3]):
            if bad == [0] and abs(wrong) < 60_000_000_000:
                continue
            spoilt = [max(0, s + wrong) if i in bad else s for i, s in enumerate(stamps)]
            kept = [i for i in frames if i not in bad]
            yield StampCase(f"{name} at {bad}", frames, spoilt, _log(), kept, says)
    for value in (0, START_NS):
        same = [value] * FRAMES
        yield StampCase(f"all {value}", frames, same, _log(), frames, "times at which", uses_log_times=True)
    for name, step, ids in (
        ("silence of .4 s", 400_000_000, 1),
        ("silence of 1 s", 1_000_000_000, 1),
        ("silence of 1.9 s", 1_900_000_000, 1),
        ("silence after the first frame", 900_000_000, 1),
        ("silence of a minute", 60_000_000_000, 2),
        ("clock an hour ahead", 3_600_000_000_000, 2),
        ("clock set back by 10 s", -10_000_000_000, 2),
        ("clock set back by 0.3 s", -300_000_000 - STEP_NS, 2),
        ("played twice", -20 * STEP_NS, 2),
    ):
        begins = 1 if "first" in name else 20
        moved = [s + step * (i >= begins) for i, s in enumerate(stamps)]
        yield StampCase(name, frames, moved, _log(), frames, "", ids)
    drift = [START_NS + round(i * STEP_NS * 1.02) for i in frames]
    yield StampCase("drift of 2 %", frames, drift, _log(), frames)
    jitter = [s + int(rng.integers(-15_000_000, 15_000_000)) for s in stamps]
    yield StampCase("jitter of 15 ms", frames, jitter, _log(), frames)
    twice = sorted(frames + [7, 19, 30])
    yield StampCase(
        "some twice", twice, [stamps[i] for i in twice], [START_NS + 10**6 * i for i in range(43)], twice
    )
