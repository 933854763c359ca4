"""The manual: it builds, it is short, and what it names is there."""

from __future__ import annotations

import os
import re
import runpy
import shlex
import subprocess
import sys
from collections.abc import Iterator
from html import unescape
from pathlib import Path

import pytest
from typer.main import get_command

from depth_pose.cli.app import app
from depth_pose.core.config import PipelineConfig
from depth_pose.core.skeleton import JOINTS

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = sorted(DOCS.glob("*.md"))
SITE = "https://depth-pose.github.io/depth_pose/"
SOURCE = "https://github.com/depth-pose/depth_pose/blob/main/"
MOST_BYTES = 120_000
MOST_README_LINES = 120


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The pages, built with every warning an error."""
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", folder],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_the_pages_are_built_with_the_api(site: Path) -> None:
    assert {page.stem for page in PAGES} == {p.parent.name for p in site.glob("*/index.html")} | {"index"}
    text = (site / "python" / "index.html").read_text(encoding="utf-8")
    for name in ("depth_pose.Tracker", "depth_pose.Camera.from_matrix", "depth_pose.Skeleton.to_pandas"):
        assert f'id="{name}"' in text


def test_the_command_reference_has_every_command_and_option(site: Path) -> None:
    html = (site / "commands" / "index.html").read_text(encoding="utf-8")
    text = unescape(re.sub(r"<[^>]+>", "", html))
    waiting, seen = [(get_command(app), ())], 0
    while waiting:
        command, names = waiting.pop()
        if hasattr(command, "commands"):
            waiting += [(inner, (*names, name)) for name, inner in command.commands.items()]
            continue
        assert f'id="{"-".join(names)}"' in html, names
        for option in {o for p in command.params if not getattr(p, "hidden", False) for o in p.opts}:
            assert not option.startswith("--") or option in text, (names, option)
            seen += 1
    assert seen > 200
    assert "wide.css" in html and "pre-wrap" in (site / "stylesheets" / "wide.css").read_text()


def test_the_table_of_joints_has_each_of_ours_once() -> None:
    page = (DOCS / "joints.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+) \| `(\w+)` \|(.*)\|$", page, re.MULTILINE)
    assert [(int(i), name) for i, name, _ in rows] == list(enumerate(JOINTS))
    for column in range(4):
        cells = [row.split("|")[column].strip() for _, _, row in rows]
        numbers = [int(cell.split()[0]) for cell in cells if cell[0].isdigit()]
        assert len(numbers) == len(set(numbers)) and max(numbers) < (32, 17, 33, 24)[column]
    sides = [(name, row.split("|")) for _, name, row in rows if name.startswith("left_")]
    other = {name: row.split("|") for _, name, row in rows}
    for name, cells in sides:  # COCO and MediaPipe count left, right; SMPL as well
        for column in (1, 2, 3):
            pair = [c.split()[0] for c in (cells[column], other["right_" + name[5:]][column])]
            if pair[0].isdigit():
                assert int(pair[1]) == int(pair[0]) + 1, (name, column)


def test_links_into_the_pages_lead_somewhere(site: Path) -> None:
    text = README + (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    links = re.findall(rf"{re.escape(SITE)}(\w*)/?(?:#([\w-]+))?", text)
    assert len(links) > 10
    for page, anchor in links:
        html = (site / page / "index.html").read_text(encoding="utf-8")
        assert not anchor or f'id="{anchor}"' in html, (page, anchor)


def test_links_to_sources_lead_somewhere() -> None:
    text = README + "".join(page.read_text(encoding="utf-8") for page in PAGES)
    for path in re.findall(rf"{re.escape(SOURCE)}([\w./-]+)", text):
        assert (ROOT / path).exists(), path


def test_it_is_short() -> None:
    assert sum(page.stat().st_size for page in PAGES) <= MOST_BYTES
    assert len(README.splitlines()) < MOST_README_LINES


def test_promises_name_tests_that_are_there() -> None:
    text = (DOCS / "faults.md").read_text(encoding="utf-8")
    named = re.findall(r"`(test/[\w/]+\.py)::(\w+)`", text)
    assert len(named) > 15
    for path, name in named:
        assert f"def {name}(" in (ROOT / path).read_text(encoding="utf-8"), (path, name)


def test_settings_that_are_named_exist() -> None:
    known = PipelineConfig().as_mapping()
    sections = "|".join(known)
    for page in PAGES:
        for section, name in re.findall(rf"`({sections})\.([a-z_]+)\b", page.read_text(encoding="utf-8")):
            assert name in known[section], (page.name, section, name)


def test_the_table_of_settings_is_current() -> None:
    """``python tools/settings_table.py`` writes it."""
    page = (DOCS / "settings.md").read_text(encoding="utf-8")
    tool = runpy.run_path(str(ROOT / "tools" / "settings_table.py"))
    assert tool["with_table"](page) == page
    assert tool["table"]() in page


def test_benchmarks_that_are_named_exist() -> None:
    """Each script, and the part of it that is its first argument."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for script, part in re.findall(r"(benchmarks/[\w/]+\.py)(?: ([a-z][\w-]+))?", text):
            assert (ROOT / script).is_file(), (page.name, script)
            if part and f"python {script} {part}" in text:
                assert f'"{part}"' in (ROOT / script).read_text(encoding="utf-8"), (page.name, script, part)


def commands() -> Iterator[tuple[str, list[str]]]:
    """Yield the ``depth-pose`` lines of the manual's and the README's shell blocks, as words."""
    for page in [*PAGES, ROOT / "README.md"]:
        for block in re.findall(r"```bash\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
            for line in block.splitlines():
                words = shlex.split(line, comments=True)
                if words and words[0].endswith("depth-pose"):
                    yield page.name, words[1:]


def test_commands_and_options_that_are_shown_exist() -> None:
    shown = list(commands())
    assert len(shown) > 40
    for page, words in shown:
        command = get_command(app)
        while hasattr(command, "commands"):
            name, *words = words
            assert name in command.commands, (page, name)
            command = command.commands[name]
        options = {option for parameter in command.params for option in parameter.opts}
        for word in words:
            if re.match(r"--?[a-z]", word):
                assert word.partition("=")[0] in options, (page, command.name, word)
