"""The page of promises names tests that there are."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "trust.md").read_text(encoding="utf-8")


def test_every_test_that_is_named_is_there() -> None:
    named = re.findall(r"\[([^]]+)\]\(\.\./(test/[\w/]+\.py)\)", PAGE)
    assert len(named) > 60
    for name, path in named:
        function = f"def test_{name.replace(' ', '_')}("
        assert function in (ROOT / path).read_text(encoding="utf-8"), (name, path)


def test_every_row_has_something_that_holds_it() -> None:
    rows = [line.split("|") for line in PAGE.splitlines() if line.startswith("| ")]
    promised = [row for row in rows if row[1].strip() != "what is promised"]
    assert len(promised) > 20
    assert all("](../test/" in row[2] or "python " in row[2] for row in promised)
