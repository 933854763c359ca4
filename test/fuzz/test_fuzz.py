"""Damaged inputs: a short, fixed run of every decoder, and the harness itself."""

from __future__ import annotations

from pathlib import Path

import pytest
from harness import Outcome, attack, find_decoders, make_input, rows

COUNT = 100
"""Inputs of each decoder: half a second of work; `harness.py` tries 10,000."""

FOUND = find_decoders()


@pytest.fixture(scope="module")
def outcomes() -> dict[str, Outcome]:
    return dict(rows([], COUNT, seed=1, keep=None))


@pytest.mark.parametrize("name", FOUND)
def test_damaged_inputs_give_an_answer_or_a_clean_error(name: str, outcomes: dict[str, Outcome]) -> None:
    outcome = outcomes[name]
    assert outcome.crashes == {}
    assert outcome.inputs == outcome.answers + outcome.clean_errors == COUNT
    assert outcome.clean_errors > 0, "not one input was damaged in a way that mattered"


def test_inputs_are_the_same_each_time() -> None:
    seeds = [bytes(range(256)), b"second"]
    first = [make_input(seeds, 1, n) for n in range(200)]
    assert first == [make_input(seeds, 1, n) for n in range(200)]
    assert first != [make_input(seeds, 2, n) for n in range(200)]
    assert len(set(first)) > 150


BAD = """
from harness import Decoder

def wrong(data):
    if data[:1] != b"s":
        raise KeyError("a")

def hangs(data):
    while data[:1] != b"s":
        pass

def bloats(data):
    if data[:1] != b"s":
        bytearray(4 << 30)

def dies(data):
    if data[:1] != b"s":
        import os
        os.abort()

DECODERS = tuple(Decoder(f.__name__, lambda: [b"sound"], f) for f in (wrong, hangs, bloats, dies))
"""


@pytest.mark.parametrize(
    ("name", "says"),
    [("wrong", "KeyError"), ("hangs", "it hung"), ("bloats", "MemoryError"), ("dies", "exit code")],
)
def test_the_harness_finds_what_is_wrong(tmp_path: Path, name: str, says: str) -> None:
    file = tmp_path / "decoders_bad.py"
    file.write_text(BAD)
    ((_, outcome),) = attack([name], file, 40)
    assert outcome.crashes and says in next(iter(outcome.crashes))
