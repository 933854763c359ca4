"""Archives with names and links that nobody means: each recording once, each with its line in the report."""

from __future__ import annotations

import csv
import os
import shutil
from pathlib import Path

import pytest
from small_archive import CLIPS

from command import caller
from depth_pose.archive.inputs import find_sources
from depth_pose.archive.jobs import Setting, work_on
from depth_pose.io.mcap_write import SkeletonWriter
from depth_pose.io.recording import read_metadata
from depth_pose.offline import NOTE

ODD = ("a b", "new\nline", "[red]x", "-rf", "bad\udcff", "$x^{", "sub/=1+1", "sub/ü" + 60 * "x")


@pytest.fixture
def odd(clips: Path, tmp_path: Path) -> Path:
    """Recordings with odd names, links in circles, and one that leads nowhere."""
    assert CLIPS
    folder = tmp_path / "in"
    (folder / "sub").mkdir(parents=True)
    for name in ODD:
        shutil.copy(clips / "clip_0.mcap", folder / f"{name}.mcap")
    os.symlink("..", folder / "sub" / "circle")
    os.symlink("/nowhere", folder / "dangling.mcap")
    return folder


def test_a_link_to_a_folder_above_is_not_followed_in_circles(odd: Path) -> None:
    names = {*ODD, "dangling"}
    assert {source.name for source in find_sources([odd])} == names
    assert {source.name for source in find_sources([f"{odd}/**/*.mcap"])} == names


def test_odd_names_have_skeletons_and_a_line_each(
    odd: Path,
    bank_path: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = odd / "out"  # inside the input
    command = ["run", str(odd), "-o", str(out), "--bank", str(bank_path), "--workers", "0"]
    for state in ("done", "skipped"):
        done = caller(monkeypatch, capsys)(*command)
        assert done.returncode == 1 and "Traceback" not in done.stderr  # for what leads nowhere
        with (out / "report.csv").open(encoding="utf-8", newline="") as stream:
            rows = {line["file"]: line for line in csv.DictReader(stream)}
        assert rows.pop("dangling")["state"] == "failed"
        assert set(rows) == {name.encode("utf-8", "backslashreplace").decode() for name in ODD}
        assert {line["state"] for line in rows.values()} == {state}
        assert all(line["ms_per_frame"] for line in rows.values())
        assert (out / "sheet.png").is_file()
    assert len(list(out.rglob("*.mcap"))) == len(ODD)


@pytest.mark.parametrize("row", ["{", "[]", "1", '{"frames": 1}', '{"frames": 1e999}', "[" * 100_000])
def test_an_output_that_says_odd_things_of_itself_is_made_anew(
    clips: Path, setting: Setting, tmp_path: Path, row: str
) -> None:
    output = tmp_path / "out.mcap"
    arguments = ("clip_0", str(clips / "clip_0.mcap"), str(output), setting, lambda share: None)
    assert work_on(*arguments).state == "done"
    good = output.read_bytes()
    note = read_metadata(str(output), NOTE)
    with SkeletonWriter(output) as writer:
        writer.write_metadata(NOTE, {**note, "row": row})
    assert work_on(*arguments).state == "done"
    assert output.read_bytes() == good
    assert work_on(*arguments).state == "skipped"
