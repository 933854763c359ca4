"""The manual: it builds, it is short, and what it names is there."""

from __future__ import annotations

import os
import re
import runpy
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.main import get_command

from depth_pose.cli.app import app
from depth_pose.core.config import PipelineConfig

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
