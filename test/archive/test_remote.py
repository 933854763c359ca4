"""Recordings on a server: a real one, of Python's own, in a process of its own."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from small_archive import CLIPS

from depth_pose.archive import remote
from depth_pose.archive.inputs import find_sources
from depth_pose.archive.jobs import Setting
from depth_pose.archive.process import process_archive
from depth_pose.archive.remote import fetched, find_remote, is_remote
from depth_pose.core.errors import ConfigError, InputError


@pytest.fixture(scope="module")
def served(clips: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The clips in two folders, one that is no recording, and what is none of them."""
    folder = tmp_path_factory.mktemp("served")
    (folder / "ward").mkdir()
    for k, clip in enumerate(sorted(clips.glob("*.mcap"))):
        shutil.copy(clip, folder / ("ward" if k % 2 else ".") / clip.name)
    (folder / "ward" / "bad.mcap").write_bytes(b"no recording")
    (folder / "readme.txt").write_text("hello")
    return folder


@pytest.fixture(scope="module")
def server(served: Path) -> Iterator[str]:
    command = [sys.executable, "-u", "-m", "http.server", "0", "--bind", "127.0.0.1", "-d", str(served)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        port = re.search(r"port (\d+)", line)
        assert port is not None, line
        yield f"http://127.0.0.1:{port[1]}"
        process.terminate()


def test_what_a_url_means(server: str, served: Path) -> None:
    assert is_remote(server) and is_remote("s3://bucket/a") and not is_remote("a/b.mcap")
    everything = find_sources([f"{server}/"])
    names = {"clip_0", "clip_2", "clip_4", "ward/clip_1", "ward/clip_3", "ward/bad"}
    assert {source.name for source in everything} == names
    assert all(s.size == (served / f"{s.name}.mcap").stat().st_size for s in everything)
    assert [s.name for s in find_sources([f"{server}/ward/clip_1.mcap"])] == ["clip_1"]
    assert {s.name for s in find_sources([f"{server}/ward/*.mcap"])} == {"clip_1", "clip_3", "bad"}
    assert [s.name for s in find_sources([f"file://{served}/clip_0.mcap"])] == ["clip_0"]
    mixed = find_sources([str(served / "clip_0.mcap"), f"{server}/ward/clip_1.mcap"])
    assert [s.place for s in mixed] == [str(served / "clip_0.mcap"), f"{server}/ward/clip_1.mcap"]
    with pytest.raises(ConfigError, match="another recording is called clip_0"):
        find_sources([str(served / "clip_0.mcap"), f"{server}/clip_0.mcap"])
    for url in (f"{server}/none.mcap", f"{server}/none/", "http://127.0.0.1:1/", "nosuch://a/b.mcap"):
        with pytest.raises(InputError, match=re.escape(url)):
            find_sources([url])


_OUTSIDE = ("../up", "/../up", "a/../../up", "/etc/up", "//etc/up", "http://other/up", "%2e%2e/up", "..%2fup")
"""Names of recordings that a listing leads to, elsewhere; as links are written they may be encoded."""

_ENDLESS = """
import http.server, sys, time
NAMES = sys.argv[1:]

class Endless(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def do_HEAD(self):
        if self.path.startswith("/list"):
            return self.do_GET()
        self.send_response(200)
        self.send_header("Transfer-Encoding", "chunked")
        self.end_headers()

    def do_GET(self):
        if self.path.startswith("/list"):
            body = "".join(f'<a href="{name}.mcap">x</a>' for name in NAMES).encode()
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            return self.wfile.write(body) if self.command == "GET" else None
        if self.path.startswith(("/drip", "/long")):
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.send_header("Content-Length", str(1 << 40))
            self.end_headers()
            while self.command == "GET":
                self.wfile.write(b"x" if "drip" in self.path else bytes(1 << 20))
                time.sleep(0.05 if "drip" in self.path else 0)
            return
        if self.path.startswith("/away"):
            self.send_response(302)
            self.send_header("Location", "file:///etc/passwd")
            self.send_header("Content-Length", "0")
            return self.end_headers()
        self.do_HEAD()
        while True:
            self.wfile.write(b"10000\\r\\n" + bytes(65536) + b"\\r\\n")

server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Endless)
print(server.server_port, flush=True)
server.serve_forever()
"""


@pytest.fixture
def hostile() -> Iterator[str]:
    """A server that never ends what it sends, or leads to the reader's own files."""
    command = [sys.executable, "-u", "-c", _ENDLESS, *_OUTSIDE, "good"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        yield f"http://127.0.0.1:{process.stdout.readline().strip()}"
        process.terminate()


def test_an_endless_body_leaves_room_for_others(
    hostile: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(remote, "SPARE_BYTES", shutil.disk_usage(tmp_path).free - (8 << 20))
    with pytest.raises(InputError, match=r"cannot be fetched.*MiB left"), fetched(f"{hostile}/a.mcap"):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_server_that_drips_is_left(hostile: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(remote, "SILENT_S", 0.5)
    monkeypatch.setattr(remote, "LISTED_S", 0.7)
    says = r"cannot be fetched: the server sent only \d+ bytes"
    with pytest.raises(InputError, match=says), fetched(f"{hostile}/drip.mcap"):
        pass
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="drip/ cannot be read"):
        find_remote(f"{hostile}/drip/", ".mcap")


def test_a_list_without_end_is_left(hostile: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(remote, "MOST_LISTED_BYTES", 4 << 20)
    with pytest.raises(InputError, match="its list has more than 4 MiB"):
        find_remote(f"{hostile}/long/", ".mcap")


def test_a_server_does_not_lead_to_our_own_files(hostile: str) -> None:
    with pytest.raises(InputError, match=r"away\.mcap cannot be fetched"), fetched(f"{hostile}/away.mcap"):
        pass


@pytest.mark.parametrize("pattern", ["", "*.mcap", "**/*.mcap"])
def test_names_from_a_server_stay_in_the_folder(hostile: str, tmp_path: Path, pattern: str) -> None:
    names = [source.name for source in find_sources([f"{hostile}/list/{pattern}"])]
    assert "good" in names
    out = tmp_path / "out"
    for name in names:
        assert (out / f"{name}.mcap").resolve().is_relative_to(out.resolve()), name


def test_names_that_lead_elsewhere_are_none() -> None:
    from depth_pose.archive.remote import name_below

    assert name_below("http://a/b/c.mcap", "http://a/b") == "c"
    for path in ("http://a/b/../../c.mcap", "http://a/b//etc/c.mcap", "http://other/c.mcap"):
        assert name_below(path, "http://a/b") is None


def test_skeletons_of_remote_recordings_are_the_same(
    server: str, setting: Setting, alone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two workers; the copies are gone afterwards, and what is done is skipped by its content."""
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    monkeypatch.setattr(tempfile, "tempdir", None)
    sources = find_sources([f"{server}/"])
    rows = process_archive(sources, tmp_path / "out", setting, workers=2)
    states = {row.file: row.state for row in rows}
    assert states.pop("ward/bad") == "failed"
    assert len(states) == CLIPS and set(states.values()) == {"done"}
    for name in states:
        found = tmp_path / "out" / f"{name}.mcap"
        assert messages_of(found) == messages_of(alone / f"{Path(name).name}.mcap")
    assert not [p for p in temporary.iterdir() if p.name.startswith("depth_pose-") and p.suffix == ".mcap"]
    assert not list(temporary.rglob("*.mcap"))
    again = process_archive(sources, tmp_path / "out", setting, workers=0)
    assert {row.state for row in again if row.file != "ward/bad"} == {"skipped"}


def messages_of(path: Path) -> list[bytes]:
    from depth_pose.io.recording import Recording

    recording = Recording(path)
    return [message.data for message in recording.messages(*sorted(recording.topics))]


def test_a_server_that_stops(server: str) -> None:
    (source,) = find_sources([f"{server}/clip_0.mcap"])
    with fetched(source.url) as local:
        assert Path(local).name == "clip_0.mcap"
        assert Path(local).stat().st_size == source.size
    assert not Path(local).exists()
    with pytest.raises(InputError, match="cannot be fetched"), fetched(f"{server}/gone.mcap"):
        pass
    assert find_remote(f"{server}/readme.txt", ".mcap") == []
