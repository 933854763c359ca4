"""Archives: the same skeletons as one by one, with workers that are killed, stopped and begun again."""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import distributed
import pytest
from small_archive import CLIPS, FRAMES

from command import environment
from depth_pose.archive.inputs import find_sources
from depth_pose.archive.jobs import Setting, content_hash
from depth_pose.archive.process import Progress, process_archive
from depth_pose.archive.report import COLUMNS, Report
from depth_pose.archive.sheet import save_archive_sheet
from depth_pose.core import workers as working
from depth_pose.core.config import PipelineConfig
from depth_pose.core.errors import ConfigError
from depth_pose.io.recording import Recording
from depth_pose.io.schemas import PEOPLE_TOPIC, SKELETON_TOPIC

pytestmark = pytest.mark.slow


def messages(path):
    return list(Recording(path).messages(PEOPLE_TOPIC, SKELETON_TOPIC))


def lines_of(folder):
    with (folder / "report.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


def assert_same(made, alone):
    for k in range(CLIPS):
        assert messages(made / f"clip_{k}.mcap") == messages(alone / f"clip_{k}.mcap")
        assert len(messages(made / f"clip_{k}.mcap")) == 2 * FRAMES


@pytest.fixture(scope="module")
def here(clips, setting, tmp_path_factory):
    """The archive's skeletons, made in this process."""
    folder = tmp_path_factory.mktemp("here")
    rows = process_archive(find_sources([clips]), folder, setting, workers=0)
    assert [row.state for row in rows] == CLIPS * ["done"], rows
    return folder


@pytest.fixture
def begun(here, tmp_path):
    """A copy of it that may be changed."""
    return Path(shutil.copytree(here, tmp_path / "begun"))


def test_same_skeletons_as_one_by_one(here, alone):
    assert_same(here, alone)


def test_two_workers_one_of_them_killed_and_a_bad_file(clips, setting, alone, here, tmp_path, monkeypatch):
    archive = Path(shutil.copytree(clips, tmp_path / "archive"))
    (archive / "clip_bad.mcap").write_bytes(b"no recording")
    sources = find_sources([archive])
    begun = []

    class Watched(working.Worker):
        def begin(self, index, task):
            super().begin(index, task)
            begun.append(task[0])
            if len(begun) == 1:
                os.kill(self.process.pid, signal.SIGKILL)

    monkeypatch.setattr(working, "Worker", Watched)
    told: list[Progress] = []
    rows = process_archive(sources, tmp_path / "out", setting, workers=2, progress=told.append)
    assert [row.file for row in rows] == [source.name for source in sources]
    assert [row.state for row in rows] == [*CLIPS * ["done"], "failed"]
    (warning,) = rows[-1].warnings
    assert warning.startswith(f"{archive}/clip_bad.mcap is not a supported recording")
    assert sorted(begun) == sorted([*(s.name for s in sources), begun[0]])  # nothing else twice
    assert told[-1] == Progress(len(sources), CLIPS * FRAMES, pytest.approx(sum(s.size for s in sources)))
    assert_same(tmp_path / "out", alone)
    for clip in here.glob("*.mcap"):
        assert (tmp_path / "out" / clip.name).read_bytes() == clip.read_bytes()
    assert len(list((tmp_path / "out").iterdir())) == CLIPS


def test_done_is_skipped_by_content(clips, setting, here, begun, tmp_path):
    archive = Path(shutil.copytree(clips, tmp_path / "archive"))
    (begun / "clip_1.mcap").unlink()
    shutil.copy(begun / "clip_0.mcap", begun / "clip_2.mcap")  # made from another recording
    cut = (begun / "clip_3.mcap").read_bytes()
    (begun / "clip_3.mcap").write_bytes(cut[: len(cut) // 2])
    os.utime(archive / "clip_4.mcap")
    rows = process_archive(find_sources([archive]), begun, setting, workers=0)
    assert [row.state for row in rows] == ["skipped", "done", "done", "done", "skipped"]
    assert (rows[0].frames, rows[0].people, rows[0].answered) == (FRAMES, 1, FRAMES)
    for clip in here.glob("*.mcap"):
        assert (begun / clip.name).read_bytes() == clip.read_bytes()


def test_other_settings_are_done_again(clips, setting, begun):
    raw = PipelineConfig.from_mapping({"smooth": {"enabled": False}})
    changed = dataclasses.replace(setting, config=raw)
    sources = find_sources([clips / "clip_0.mcap"])
    for state in ("done", "skipped"):
        (row,) = process_archive(sources, begun, changed, workers=0)
        assert row.state == state


@pytest.mark.parametrize("wrong", [{"bank_id": "0" * 16}, {"version": "0.0.0"}])
def test_another_bank_or_version_ends_the_run(clips, setting, tmp_path, wrong):
    with pytest.raises(ConfigError, match=r"is the bank|has depth_pose"):
        process_archive(find_sources([clips]), tmp_path, dataclasses.replace(setting, **wrong), workers=0)


def test_a_cluster_loses_a_worker(clips, setting, here, tmp_path):
    killed: list[int] = []

    def kill_one(row):
        if not killed:
            killed.append(max(client.run(os.getpid).values()))
            os.kill(killed[0], signal.SIGKILL)

    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        address = cluster.scheduler_address
        rows = process_archive(find_sources([clips]), tmp_path, setting, scheduler=address, collect=kill_one)
        assert killed
        assert killed[0] not in client.run(os.getpid, on_error="ignore").values()
    assert {row.state for row in rows} <= {"done", "skipped"}
    for clip in here.glob("*.mcap"):
        assert (tmp_path / clip.name).read_bytes() == clip.read_bytes()


def start(*arguments):
    command = [sys.executable, "-m", "depth_pose.cli", "run", *map(str, arguments)]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment(),
        start_new_session=True,
    )  # fmt: skip


def processes_of(session):
    """Count the processes of a session."""
    found = 0
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        found += int(fields[3]) == session and fields[0] != "Z"
    return found


def wait_until(reached, seconds):
    end = time.monotonic() + seconds
    while not reached():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_stopped_and_gone_on(clips, bank_path, here, tmp_path, how):
    """Ctrl-C, which goes to all processes, and a kill -9 of the first: no orphans, whole files, go on."""
    archive = Path(shutil.copytree(clips, tmp_path / "archive"))
    for attempt in range(10):
        out = tmp_path / f"out{attempt}"
        command = (archive, "-o", out, "--bank", bank_path, "--workers", "1")
        run = start(*command)
        wait_until(lambda out=out, run=run: list(out.glob("*.mcap")) or run.poll() is not None, 300)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(run.pid, how) if how == signal.SIGINT else os.kill(run.pid, how)
        text, _ = run.communicate(timeout=300)
        wait_until(lambda run=run: processes_of(run.pid) == 0, 300)
        made = {path.name: path.read_bytes() for path in out.glob("*.mcap")}
        if len(made) < CLIPS:  # else this process stood still until all was done
            break
    assert 0 < len(made) < CLIPS
    if how == signal.SIGINT:
        assert run.returncode == 130, text
        assert "the same command continues" in text
    for name, content in made.items():
        assert content == (here / name).read_bytes()
    (archive / "bad.mcap").write_bytes(b"no recording")
    run = start(*command[:-1], "0")
    text, _ = run.communicate(timeout=300)
    assert run.returncode == 1, text
    assert "bad.mcap is not a supported recording" in text
    lines = lines_of(out)
    assert [line["file"] for line in lines] == ["bad", *(f"clip_{k}" for k in range(CLIPS))]
    skipped = {f"{line['file']}.mcap" for line in lines if line["state"] == "skipped"}
    assert skipped == set(made)
    assert {line["state"] for line in lines if f"{line['file']}.mcap" not in made} == {"failed", "done"}
    for clip in here.glob("*.mcap"):
        assert (out / clip.name).read_bytes() == clip.read_bytes()
    left = {path.name for path in out.iterdir()} - {path.name for path in here.iterdir()}
    assert left == {"report.csv", "sheet.png"}


def test_report(clips, setting, begun):
    """A line for each, in order; what those took that are skipped is taken from the report before."""
    (begun / "clip_1.mcap").unlink()
    sources = find_sources([clips])
    names = [source.name for source in sources]
    for states in (["skipped", "done", *["skipped"] * 3], ["skipped"] * CLIPS):
        report = Report(begun / "report.csv")
        process_archive(sources, begun, setting, workers=0, collect=report.add)
        rows = report.finish(names)
        assert [row.state for row in rows] == states
    lines = lines_of(begun)
    broken_off = Report(begun / "report.csv")
    broken_off.add(rows[2])
    assert broken_off.finish(names) == rows[2:3]
    assert lines_of(begun) == lines
    assert tuple(lines[0]) == COLUMNS
    assert [line["file"] for line in lines] == names
    for line in lines:
        assert (line["frames"], line["people"], line["answered"]) == (str(FRAMES), "1", str(FRAMES))
        assert 0.2 < float(line["confidence"]) <= 1.0
        assert bool(line["ms_per_frame"]) == (line["file"] == "clip_1")


def test_sheet(clips, here, tmp_path):
    assert save_archive_sheet(find_sources([clips]), here, tmp_path / "sheet.png") == CLIPS
    assert (tmp_path / "sheet.png").read_bytes().startswith(b"\x89PNG")


def test_hash_sees_ends_and_sizes(tmp_path):
    """Of a large file the beginning, the end, the size and blocks between; of a small one every byte."""
    size = 12 << 20
    file = tmp_path / "a.mcap"
    hashes = set()
    for at in (None, 0, size - 1, size // 7 * 3):
        content = bytearray(size)
        if at is not None:
            content[at] = 1
        file.write_bytes(content)
        hashes.add(content_hash(file))
    file.write_bytes(bytes(size + 1))
    hashes.add(content_hash(file))
    assert len(hashes) >= 4
    small = bytearray(5_000_000)
    file.write_bytes(small)
    before = content_hash(file)
    small[3_333_333] = 1
    file.write_bytes(small)
    assert content_hash(file) != before


def test_two_passes_are_another_setting(clips, setting, begun):
    sources = find_sources([clips / "clip_0.mcap"])
    for state in ("done", "skipped"):
        (row,) = process_archive(sources, begun, dataclasses.replace(setting, passes=2), workers=0)
        assert row.state == state


def test_settings_have_their_digest():
    one = Setting(None, "0", PipelineConfig())
    assert one.digest == Setting(None, "1", PipelineConfig()).digest
    assert one.digest != Setting(None, "0", PipelineConfig(), "/depth").digest
